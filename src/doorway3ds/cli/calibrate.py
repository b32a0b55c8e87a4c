"""`3ds calibrate`: a camera file from images of a board."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any
from urllib.parse import urlsplit

import typer

from doorway3ds.arguments import listed
from doorway3ds.camera.options import BoardOptions, LensOptions
from doorway3ds.cli.shared.options import expand
from doorway3ds.cli.shared.output import apart, complain, quiet_decoders
from doorway3ds.errors import CallError, UserError
from doorway3ds.options import setting

if TYPE_CHECKING:
    from rich.console import RenderableType

    from doorway3ds.camera.board import Board
    from doorway3ds.camera.calibration import Calibration
    from doorway3ds.camera.guide import Guide

_MODELS = {
    "plumb_bob": "plumb_bob",
    "rational_polynomial": "rational_polynomial",
    "fisheye": "equidistant",
}


@expand
def calibrate(
    pattern: BoardOptions,
    lens: LensOptions,
    images: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="IMAGE", help="Images, folders of them, or one webcam, stream or film."
        ),
    ] = None,
    model: str | None = setting(
        None,
        f"Lens model: {listed(list(_MODELS))}; default: the one that predicts held-out views best.",
        choices=tuple(_MODELS),
        metavar="MODEL",
    ),
    out: Path = setting(Path("camera.yaml"), "camera_info YAML file to write."),
    name: str | None = setting(None, "Name of the camera; default: that of --out."),
    board_pdf: Path | None = setting(
        None, "Board to print on A4 at 100 %; nothing else is done.", metavar="FILE"
    ),
    check: str | None = setting(
        None,
        "Instead, check the focal length of --camera by the edges of this room.",
        metavar="IMAGE",
    ),
) -> None:
    """Make a camera file from images of a chessboard or ChArUco board.

    Ten to twenty sharp images of a flat board, tilted, at several distances, also near the
    image's corners. `3ds look --camera camera.yaml` then uses the file. --board-pdf prints a board.

    From a webcam (webcam://0), a stream or a film, frames are taken as soon as the board is sharp,
    still and in a new place. It ends once there are enough, or on Ctrl-C with those it has.

    Example: 3ds calibrate board/*.jpg --board 9x6 --out camera.yaml
    """
    if check is not None:
        if images or board_pdf is not None or lens == LensOptions():
            raise CallError("--check IMAGE takes --camera or --fov-deg to check, and nothing else")
        _check(check, lens)
        return
    if lens != LensOptions():
        raise CallError("--camera and --fov-deg name a camera to check; add --check IMAGE")
    board = pattern.pattern()
    if board_pdf is not None:
        if images:
            raise CallError("--board-pdf prints a board and takes no images; leave one of them out")
        _print_board(board, pattern.given(), board_pdf)
        return
    if not images:
        raise CallError("name images of a board, or --board-pdf FILE to print one")

    apart({"--out": out}, images)
    kind = None if model is None else _MODELS[model]
    if len(images) == 1 and _is_source(images[0]):
        _report(_guided(images[0], board, name or out.stem, kind), out)
        return

    from doorway3ds.camera.calibration import calibrate as run
    from doorway3ds.cli.shared.inputs import images_of

    inputs, errors = images_of(images)
    if errors:
        raise UserError(errors[0])
    _report(run(_pictures(inputs), board, name or out.stem, kind), out)


def _check(name: str, lens: LensOptions) -> None:
    """Says how far the camera's focal length is from that of a room's edges."""
    from doorway3ds.camera.choice import choose_camera
    from doorway3ds.camera.vanishing import check_focal
    from doorway3ds.images.codec import read_image
    from doorway3ds.sources.base import View

    frame = View(choose_camera(lens).fit).of_picture(read_image(name))
    found = check_focal(frame.image, frame.camera)
    if found is None:
        raise UserError(
            f"the lines of {name} do not determine a focal length; take a room's corner or a wall "
            "at a slant, with long edges in all three directions"
        )
    fx = frame.camera.fx
    typer.echo(
        f"{name}: its lines fit a focal length of {fx * found.factor:.0f} px "
        f"({fx * found.low:.0f} to {fx * found.high:.0f}); {frame.camera.name} has {fx:.0f}, "
        f"deviation {1 / found.factor - 1:+.0%}" + ("; they agree" if found.agrees else "")
    )
    if not found.agrees:
        raise UserError(
            f"{frame.camera.name} does not fit the lines of {name}; check that the camera is this "
            "one, not zoomed or cropped, or calibrate it"
        )


def _is_source(name: str) -> bool:
    """Whether it is something that goes on, rather than images."""
    from doorway3ds.images.codec import SUFFIXES, is_image

    path = Path(urlsplit(name).path if "://" in name else name)
    if path.suffix.lower() in SUFFIXES:
        return False
    return "://" in name or (path.is_file() and not is_image(path))


def _guided(uri: str, board: Board, name: str, model: str | None) -> Calibration:
    """Takes frames of a source until they suffice, it ends, or Ctrl-C."""
    from doorway3ds.camera.calibration import MIN_PICTURES, calibrate_views
    from doorway3ds.camera.guide import Guide, incomplete
    from doorway3ds.sources import SourceLost, open_source

    quiet_decoders()
    guide = Guide(board)
    with open_source(uri) as source, _Shown(guide, source.name) as shown:
        source.notice = shown.say
        try:
            for number, frame in enumerate(source, 1):
                source.require_sensor()
                shown.update(guide.look(f"frame {number}", frame.image, frame.stamp_s))
                if guide.done:
                    break
        except KeyboardInterrupt:
            pass  # with what there is
        except SourceLost as error:
            if len(guide.views) < MIN_PICTURES:
                raise
            shown.say(str(error))
    if guide.size is None or len(guide.views) < MIN_PICTURES:
        raise UserError(
            f"{len(guide.views)} frames with the board were taken, at least {MIN_PICTURES} are "
            f"needed; of the last one: {guide.hint}; check --board, too"
        )
    if guide.missing:
        complain(incomplete(guide.missing))
    return calibrate_views(guide.views, guide.size, name, model)


class _Shown:
    """How far a guide is: in one place of a terminal, elsewhere a line for each frame taken."""

    def __init__(self, guide: Guide, title: str) -> None:
        from rich.console import Console
        from rich.live import Live

        self._guide, self._title = guide, title
        self._console = Console()
        utf = self._console.encoding.lower().startswith("utf")
        self._marks = ("■", "·") if utf else ("#", ".")
        watched = sys.stdout is not None and sys.stdout.isatty()
        self._live = Live(console=self._console, auto_refresh=False) if watched else None

    def __enter__(self) -> _Shown:
        if self._live is not None:
            self._live.start()
            self.update(False)
        return self

    def __exit__(self, *error: object) -> None:
        if self._live is not None:
            self._live.stop()

    def update(self, taken: bool) -> None:
        if self._live is not None:
            self._live.update(self._panel(), refresh=True)
        elif taken:
            from doorway3ds.camera.guide import COLUMNS, ROWS

            guide = self._guide
            typer.echo(
                f"{guide.views[-1].name} taken: zones {len(guide.zones)} of {COLUMNS * ROWS}, "
                f"tilts {self._tilts()}, distances x{guide.spread:.1f}"
            )

    def say(self, line: str) -> None:
        if self._live is not None:
            self._console.print(line, markup=False)
        else:
            complain(line)

    def _tilts(self) -> str:
        from doorway3ds.camera.guide import TILTS

        return " ".join(side for side in TILTS if side in self._guide.tilts) or "none"

    def _panel(self) -> RenderableType:
        from rich.panel import Panel
        from rich.table import Table

        from doorway3ds.camera.guide import COLUMNS, FEWEST, ROWS, SPREAD, TILTS

        guide, (full, blank) = self._guide, self._marks
        zones = [full if zone in guide.zones else blank for zone in range(COLUMNS * ROWS)]
        rows = [" ".join(zones[row * COLUMNS :][:COLUMNS]) for row in range(ROWS)]
        lines = Table.grid(padding=(0, 2))
        lines.add_row("zones", "\n".join(rows))
        lines.add_row("tilts", f"{self._tilts()} (of {' '.join(TILTS)})")
        lines.add_row("distances", f"x{guide.spread:.1f} (of x{SPREAD:g})")
        lines.add_row("frames", f"{len(guide.views)} (of {FEWEST})")
        lines.add_row("now", guide.hint)
        return Panel(lines, title=self._title, subtitle="Ctrl-C: calibrate with these", width=70)


def _print_board(board: Board, options: str, path: Path) -> None:
    from doorway3ds.camera.board import print_lines, printable
    from doorway3ds.files import write_bytes

    lines = print_lines(options)
    write_bytes(path, printable(board, lines))
    typer.echo(f"wrote {path}; print it on A4 at 100 % and check its ruler, then: {lines[-1]}")


def _report(found: Calibration, out: Path) -> None:
    """Writes the camera file and says how good it is."""
    from doorway3ds.camera.info import check_lens, write_camera_info

    check_lens(found.camera, str(out))
    write_camera_info(found.camera, out)

    camera = found.camera
    for picture, off_px in found.errors_px.items():
        typer.echo(f"{picture}: {off_px:.3f} px")
    for picture in found.without_board:
        typer.echo(f"{picture}: no board found")
    if found.held_out_px:
        scores = ", ".join(f"{kind} {px:.3f} px" for kind, px in found.held_out_px.items())
        typer.echo(f"{camera.distortion_model} chosen; error in held-out views: {scores}")
    typer.echo(
        f"reprojection error {found.rms_px:.3f} px over {len(found.errors_px)} images; "
        f"fx {camera.fx:.1f} fy {camera.fy:.1f} cx {camera.cx:.1f} cy {camera.cy:.1f}, "
        f"field of view {camera.hfov_deg:.1f} x {camera.vfov_deg:.1f} deg"
    )
    for doubt in found.doubts:
        complain(doubt)
    typer.echo(f"wrote {out}")


def _pictures(inputs: list[Any]) -> Iterator[tuple[str, Any]]:
    from doorway3ds.images.codec import as_stored, read_image

    for item in inputs:
        # As stored: a camera file is of the sensor, however the camera was held.
        yield item.name, as_stored(read_image(item.read(), name=item.name))
