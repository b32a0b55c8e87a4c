"""`3ds sim`: simulated homes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from doorway3ds.cli.shared.options import expand
from doorway3ds.errors import CallError, UserError
from doorway3ds.options import MANY, SEED, setting

app = typer.Typer(
    no_args_is_help=True,
    help="Render simulated homes with exact truth, play trials, run a virtual NAO.\n\n"
    "Example: 3ds sim render --out homes --count 10",
)


def parse_size(text: str) -> tuple[int, int]:
    """'320x240' as (320, 240)."""
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(p.isdigit() for p in parts):
        raise CallError(f"--size must look like 320x240, got '{text}'")
    width, height = int(parts[0]), int(parts[1])
    if not (32 <= width <= 1024 and 32 <= height <= 768):
        raise CallError(f"--size must be from 32x32 to 1024x768, got {text}")
    return width, height


def parse_scenes(text: str) -> list[str]:
    """Names of scenes of trials, separated by commas."""
    from doorway3ds.lab.sim.stages.scenarios import SCENES

    names = text.split(",")
    for name in names:
        if name not in SCENES:
            raise CallError(f"--scenes: expected some of {', '.join(SCENES)}, got {name!r}")
    return names


@app.callback()
def main() -> None:
    """Simulated homes: images with exact truth."""


@app.command()
@expand
def render(
    out: Annotated[
        Path, typer.Option(help="Folder to write; an interrupted run continues where it stopped.")
    ],
    count: int = setting(100, "Number of images.", low=1, high=MANY),
    seed: int = setting(0, "Seed of the homes.", **SEED),
    size: str = setting("320x240", "WIDTHxHEIGHT of the images."),
    workers: int = setting(2, "Number of processes.", low=1, high=1024),
    hazards: float = setting(
        0.0, "Share of homes with stairs, glass, mirrors, people ...", low=0, high=1
    ),
    low: float = setting(0.0, "Share of views from 0.3 to 0.6 m.", low=0, high=1),
    scenes: str | None = setting(
        None, "Scenes of `3ds sim trial`, comma separated, instead of homes drawn at random."
    ),
) -> None:
    """Render images of simulated homes with depth, floor and doorways.

    Example: 3ds sim render --out homes --count 10
    """
    from rich.console import Console
    from rich.progress import Progress

    from doorway3ds.lab.sim.pictures.dataset import home_jobs, render_dataset
    from doorway3ds.lab.sim.pictures.view import write_contact_sheet
    from doorway3ds.lab.sim.trials.pictures import stage_jobs

    pixels = parse_size(size)
    if scenes is None:
        jobs = home_jobs(out, count, seed, pixels, hazards, low)
    elif hazards:
        raise CallError("--scenes names what is in view; leave --hazards out")
    else:
        jobs = stage_jobs(out, count, seed, pixels, parse_scenes(scenes), low)
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("images", total=count)
        total = render_dataset(out, jobs, workers, lambda n: bar.advance(task, n))
    typer.echo(f"{total} images in {out}, some of them on {write_contact_sheet(out)}")


@app.command()
@expand
def view(
    out: Annotated[
        Path, typer.Option(help="Image to write; its truth goes into truth/ beside it.")
    ],
    home: int = setting(..., "Seed of the home.", **SEED),
    x: float = setting(
        ..., "Position along x in the home's plan, in metres.", low=-1000, high=1000
    ),
    y: float = setting(
        ..., "Position along y in the home's plan, in metres.", low=-1000, high=1000
    ),
    heading_deg: float = setting(..., "Heading: 0 looks along x, 90 along y.", low=-360, high=360),
    camera: str = setting("nao-v5-top", "Camera preset."),
    pitch_deg: float | None = setting(
        None, "Pitch, + up, instead of the preset's.", low=-90, high=90
    ),
    size: str = setting("640x480", "WIDTHxHEIGHT of the image."),
) -> None:
    """Render one image from a given place.

    Example: 3ds sim view --out view.png --home 7 --x 2 --y 1.5 --heading-deg 90
    """
    from dataclasses import replace

    from doorway3ds.camera.presets import preset
    from doorway3ds.lab.sim.homes.apartment import generate
    from doorway3ds.lab.sim.pictures.view import photograph, save
    from doorway3ds.lab.sim.render.renderer import Eye

    lens, pose = preset(camera, *parse_size(size))
    if pitch_deg is not None:
        pose = replace(pose, pitch_deg=pitch_deg)
    eye = Eye(x, y, heading_deg, pose)
    at = eye.lens()
    if generate(home).room_at(float(at[0]), float(at[1])) is None:
        raise UserError(f"({x:g}, {y:g}) is in no room of home {home}; choose a place inside one")
    for path in save(photograph(home, lens, eye), home, out):
        typer.echo(path)


@app.command()
@expand
def nao(
    listen: str = setting("tcp://127.0.0.1:9559", "Address on which NAOqi answers.", metavar="URL"),
    seed: int = setting(0, "Seed of the homes.", **SEED),
    scenario: str = setting("doorway", "Scene in front of the robot; see docs/robot.md."),
    robot: str = setting("nao", "Model: nao or pepper.", choices=("nao", "pepper")),
) -> None:
    """Run a virtual NAO that NAOqi scripts can turn and look through, until Ctrl-C.

    Example: 3ds sim nao --scenario doorway --seed 7
    """
    import re
    import threading
    from importlib import import_module

    from doorway3ds.cli.shared.robot import ended_by_sigterm
    from doorway3ds.lab.sim.robot.nao import VirtualNao
    from doorway3ds.lab.sim.stages.scenarios import SCENES

    if not re.fullmatch(r"tcp://[^:/]+:\d{1,5}", listen):
        raise CallError(f"--listen must look like tcp://127.0.0.1:9559, got '{listen}'")
    if scenario not in SCENES:
        raise CallError(f"--scenario must be one of {', '.join(SCENES)}, got {scenario!r}")

    import_module("qi")  # missing, it is said before a home is built

    from doorway3ds.lab.sim.robot.world import Studio, World

    with ended_by_sigterm(), Studio() as studio:
        world = World.of_scene(studio, scenario, seed, model=robot)
        depth = world.depth if world.body.model.depth_fov_deg else None
        virtual = VirtualNao(world.body, world.picture, depth=depth)
        virtual.on_speech = lambda text: typer.echo(f"says: {text}", err=True)
        try:
            url = virtual.listen(listen)
        except RuntimeError as error:
            raise UserError(f"cannot listen at {listen}: {reason_of(error)}") from error
        try:
            typer.echo(f"virtual {robot} at {url}: {SCENES[scenario]}, seed {seed}")
            threading.Event().wait()
        finally:
            virtual.close()


def reason_of(error: RuntimeError) -> str:
    """Why libqi could not listen, without the C++ files that it names."""
    lines = [line.partition(" [")[0].strip() for line in str(error).splitlines()]
    reason = next((line for line in reversed(lines) if line), "no reason given")
    if "in use" in reason:
        return "another program listens there; stop it or choose another port with --listen"
    return reason.rpartition(": ")[2].lower()


@app.command()
@expand
def trial(
    out: Annotated[
        Path,
        typer.Option(help="Folder for episodes and tables; an interrupted run continues in it."),
    ],
    episodes: int = setting(60, "Episodes of each scene.", low=1, high=MANY),
    scenes: str | None = setting(
        None,
        "Scenes to play, separated by commas; default: all; see docs/robot.md.",
        metavar="NAME,...",
    ),
    network: str = setting("truth", "Network: truth, or one of `3ds models`.", metavar="NAME"),
    method: str = setting(
        "both", "Method: opening, paper or both.", choices=("opening", "paper", "both")
    ),
    seed: int = setting(0, "Seed of the first episode.", **SEED),
    workers: int = setting(2, "Number of processes.", low=1, high=1024),
    film: bool = setting(False, "Also write a GIF of each scene."),
) -> None:
    """Play the closed loop in many homes; both methods meet the same stages.

    Example: 3ds sim trial --out trial --episodes 10 --scenes doorway,blocked
    """
    from rich.console import Console
    from rich.progress import Progress

    from doorway3ds.files import write_bytes
    from doorway3ds.lab.sim.stages.scenarios import SCENES
    from doorway3ds.lab.sim.trials.trials import METHODS, plot, run_trials, table

    names = list(SCENES) if scenes is None else parse_scenes(scenes)
    chosen = METHODS if method == "both" else tuple(m for m in METHODS if m == method)
    asked = None if network == "truth" else network
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("stages", total=episodes * len(names))
        played = run_trials(
            out, names, episodes, seed, chosen, asked, workers, lambda n: bar.advance(task, n)
        )
    text = table(played)
    write_bytes(out / "trial.md", text.encode())
    typer.echo(text, nl=False)
    typer.echo(f"{plot(played, out / 'trial.png')}", err=True)
    if film:
        from doorway3ds.lab.sim.trials.trial import film_scene

        for name in names:
            typer.echo(f"{film_scene(name, seed, asked, out / f'{name}.gif')}", err=True)
