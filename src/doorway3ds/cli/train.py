"""`3ds train`: networks from images. Needs the extra `train`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doorway3ds.cli.shared.options import expand
from doorway3ds.cli.shared.output import say
from doorway3ds.cli.shared.training import running as run_of
from doorway3ds.lab.train.options import (
    ClassOptions,
    DepthOptions,
    DoornetOptions,
    FileOptions,
    PairOptions,
    RunOptions,
    SrinOptions,
)
from doorway3ds.options import setting

if TYPE_CHECKING:
    from doorway3ds.lab.datasets.places import Pictures

Out = Annotated[Path, typer.Option(help="Folder for checkpoints, logs and the result.")]

app = typer.Typer(
    help="Train networks from images.\n\nExample: 3ds train cnn-srin images", no_args_is_help=True
)


@app.callback()
def top() -> None:
    """Train networks from images; each command writes an ONNX file that `3ds look` uses."""


@app.command()
@expand
def doornet(
    running: RunOptions,
    options: DoornetOptions,
    datasets: Annotated[
        list[Path], typer.Argument(help="Folders with doorways.csv or boxes.csv beside images/.")
    ],
    teachers: Annotated[
        Path, typer.Option(help="Folder with the ONNX files that training starts from.")
    ],
    out: Out = Path("runs/doornet"),
) -> None:
    """Train doornet: p_open, opening columns, depth and floor in one network.

    Example: 3ds train doornet rooms homes --teachers teachers --hold-out 1/5
    """
    from dataclasses import replace

    from doorway3ds.lab.train.doornet.recipe import read_recipe
    from doorway3ds.lab.train.doornet.run import DoorNetTraining, Teachers

    recipe = read_recipe(options.recipe)
    given = {"seed": options.seed, "patience": options.patience}
    changed: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    recipe = replace(recipe, fit=replace(recipe.fit, **changed))
    with run_of(out, sum(stage.epochs for stage in recipe.fit.stages), running) as run:
        card = DoorNetTraining(datasets, Teachers.in_folder(teachers), recipe, run, options)()
        if run.team.leads:
            _say_written("doornet", out, card)


@app.command()
def limits(
    folder: Annotated[Path, typer.Argument(help="Folder of a training with --hold-out.")],
    datasets: Annotated[list[Path], typer.Argument(help="Data sets that it was trained on.")],
) -> None:
    """Choose the presets cautious, balanced and eager of a trained doornet.

    Uses the places that the training held out; `balanced` is the default preset.

    Example: 3ds train limits runs/doornet rooms homes
    """
    from doorway3ds.lab.train.doornet.tune import tune_run

    found = tune_run(folder, datasets, lambda line: typer.echo(line, err=True))
    for name, point in found.items():
        typer.echo(f"{name}: {point}")


@app.command("cnn-srin")
@expand
def cnn_srin(
    dataset: Annotated[
        Path, typer.Argument(help="Folder with no-door/ and open-door/, or a CSV: image, class.")
    ],
    pictures: ClassOptions,
    options: SrinOptions,
    running: FileOptions,
    out: Out = Path("runs/cnn-srin"),
) -> None:
    """Train the paper's classifier on images with and without an open doorway.

    Example: 3ds train cnn-srin images --epochs 20
    """
    from doorway3ds.lab.datasets.doors import read_door_pictures
    from doorway3ds.lab.train.paper.srinrun import SrinTraining

    epochs, facts = options.epochs + options.fine_tune, _facts(dataset, running)
    with run_of(out, epochs, running, **facts) as run:
        found = read_door_pictures(
            dataset,
            pictures.choice(options.seed),
            layout=pictures.layout,
            places=pictures.read_places(),
            seen=run.seen,
        )
        if run.team.leads:
            half = list(found.left_out.values()).count("half open")
            say(f"{_read(found)}; left out: {len(found.left_out)}, {half} of them half open")
        card = SrinTraining(found, options, run)()
        if run.team.leads:
            accuracy = card["held_out"]["wilson"]["accuracy"]
            said = (
                f"held-out accuracy {accuracy['value']:.3f} "
                f"({accuracy['low']:.3f} to {accuracy['high']:.3f}, n = {accuracy['n']})"
            )
            _finish("cnn-srin", out, card, said, running.install)


@app.command()
@expand
def densedepth(
    dataset: Annotated[
        Path,
        typer.Argument(help="Folder of images with depth, or DenseDepth's own nyu_data.zip."),
    ],
    pictures: PairOptions,
    options: DepthOptions,
    running: FileOptions,
    out: Out = Path("runs/densedepth"),
    unit_m: float | None = setting(
        None,
        "Metres per count of depth, if the data do not say.",
        metavar="M",
        low=1e-9,
        high=1000,
    ),
) -> None:
    """Train the paper's depth network (DenseNet-169) on images with depth.

    Example: 3ds train densedepth nyu_data.zip --epochs 20
    """
    from doorway3ds.lab.train.paper.densedepth import SETTINGS
    from doorway3ds.lab.train.paper.depthpairs import read_depth_pairs
    from doorway3ds.lab.train.paper.depthrun import DepthTraining

    facts = _facts(dataset, running)
    with run_of(out, options.epochs, running, **facts) as run:
        if not run.team.leads:
            run.team.told(None)  # until the leader has unpacked what is packed
        pairs = read_depth_pairs(
            dataset,
            SETTINGS[options.setting],
            pictures.choice(options.seed),
            unit_m=unit_m,
            unpack=out / "data",
            seen=run.seen,
        )
        if run.team.leads:
            run.team.told(None)
            depth = f"median depth {pairs.median_m:.2f} m"
            say(f"{_read(pairs)}; {depth}; left out: {len(pairs.left_out)}")
        card = DepthTraining(pairs, options, run)()
        if run.team.leads:
            delta1, rmse = (card["held_out"]["metrics"][key]["value"] for key in ("delta1", "rmse"))
            said = f"held out: delta1 {delta1:.3f}, RMSE {rmse:.3f} m"
            # of another size than `3ds look` feeds, a file for KITTI is not installed
            install = running.install and options.setting == "nyu"
            _finish("densedepth", out, card, said, install)


def _facts(dataset: Path, running: FileOptions) -> dict[str, Any]:
    return {"data": str(dataset), "licence": running.licence}


def _read(found: Pictures) -> str:
    count = len(set(found.groups))
    return f"{len(found.samples)} images, {count} groups by {found.grouping}"


def _finish(name: str, out: Path, card: dict[str, Any], said: str, install: bool) -> None:
    """Says how good it is and what was written, and installs it."""
    from doorway3ds.lab.train.engine import outcome

    typer.echo(f"near-copies across the split: {card['near_copies_across_the_split']}")
    typer.echo(said)
    _say_written(name, out, card)
    if install:
        path = out / f"{name}.onnx"
        typer.echo(f"{name}: installed {outcome.install(name, path, card['licence'])}")


def _say_written(name: str, out: Path, card: dict[str, Any]) -> None:
    typer.echo(
        f"{out / f'{name}.onnx'}: {card['bytes'] / 1e6:.1f} MB, ONNX Runtime and Keras differ by "
        f"{card['parity']:.1e} of the largest output; report: {out / 'report.html'}"
    )
