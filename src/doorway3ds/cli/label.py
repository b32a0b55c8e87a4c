"""`3ds label`: mark the open doorways in a folder of images, on a local page."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from doorway3ds.camera.options import LensOptions
from doorway3ds.cli.shared.listening import ListenOptions
from doorway3ds.cli.shared.options import expand
from doorway3ds.cli.shared.output import quiet_decoders
from doorway3ds.decide.options import DecideOptions, NetworkOptions
from doorway3ds.options import setting

if TYPE_CHECKING:
    from doorway3ds.camera.choice import FitCamera
    from doorway3ds.web.label.pictures import Guesser


@dataclass(frozen=True)
class _Listen(ListenOptions):
    """As of `3ds serve`, on another port."""

    port: int = setting(8001, "Port to listen on; 0 takes a free one.", low=0, high=65535)


@expand
def label(
    folder: Annotated[
        Path,
        typer.Argument(help="Folder of images of any size and camera; folders in it are places."),
    ],
    network: NetworkOptions,
    camera: LensOptions,
    listen: _Listen,
    classes: Path | None = setting(
        None,
        "Instead, sort the marked images into open-door/, half-open-door/, closed-door/ and "
        "no-door/ there, as links or copies.",
        metavar="DIR",
    ),
    guess: bool = setting(True, "Draw what the network would mark.", names=("--guess/--no-guess",)),
) -> None:
    """Mark open doorways by hand on a local page, until Ctrl-C: two clicks and a key per image.

    Every mark is saved at once into FOLDER/doorways.csv, which `3ds eval` and `3ds train` read;
    a later call continues where it stopped.

    Example: 3ds label images
    """
    from doorway3ds.camera.choice import choose_camera
    from doorway3ds.web.label.pictures import Pictures
    from doorway3ds.web.label.table import Table

    choice = choose_camera(camera)
    if classes is not None:
        _export(folder, classes)
        return
    guesser = None
    if guess:
        guesser = _guesser(folder, network, choice.fit if choice.given else None)
    pictures = Pictures(folder, guesser)
    table = Table(folder)
    for name in pictures.left_out:
        typer.echo(f"left out: {name!r}, a name that a CSV file cannot hold", err=True)

    from doorway3ds.draw.words import counted
    from doorway3ds.web.label.app import create_label_app, label_settings

    quiet_decoders()
    listening = listen.open()
    with listening.bound:
        settings = label_settings(listening.token, listening.shared)
        app = create_label_app(settings, pictures, table)
        try:
            listening.serve(app, "labelling at")
        finally:
            marked = len(set(pictures.names) & set(table.states()))
            typer.echo(
                f"{table.path}: {marked} of {counted(len(pictures), 'image')} marked", err=True
            )


def _guesser(folder: Path, network: NetworkOptions, fit: FitCamera | None) -> Guesser:
    from doorway3ds.decide.pipeline import build_pipeline
    from doorway3ds.lab.datasets.readers import folder_camera
    from doorway3ds.web.label.guess import guesser

    pipeline = build_pipeline(DecideOptions(**asdict(network)))
    return guesser(pipeline, fit or folder_camera(folder))


def _export(folder: Path, out: Path) -> None:
    from doorway3ds.errors import UserError
    from doorway3ds.web.label.classes import export_classes
    from doorway3ds.web.label.pictures import Pictures
    from doorway3ds.web.label.table import Table

    table = Table(folder)
    states = table.states()
    if not states:
        raise UserError(f"{table.path} marks no image yet; start with: 3ds label {folder}")
    counts = export_classes(Pictures(folder), states, out)
    told = ", ".join(f"{counts[name]} {name}" for name in sorted(counts))
    typer.echo(f"{out}: {told}")
