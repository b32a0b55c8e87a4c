"""`3ds calibrate`: a camera file from images of a board."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from doorway3ds.cli.shared.options import expand
from doorway3ds.errors import CallError, UserError
from doorway3ds.options import Options, setting

if TYPE_CHECKING:
    from doorway3ds.camera.board import Board
    from doorway3ds.camera.calibration import Calibration

_MODELS = {
    "plumb_bob": "plumb_bob",
    "rational_polynomial": "rational_polynomial",
    "fisheye": "equidistant",
}
GOOD_RMS_PX = 0.5  # per 640 columns; above it something moved, blurred or was not flat
GOOD_COVERAGE = 0.5


@dataclass(frozen=True)
class BoardOptions(Options):
    """The board that is printed or seen."""

    panel: ClassVar[str] = "Board"

    board: str = setting(
        "9x6",
        "Chessboard: inner corners; ChArUco: squares. Columns x rows.",
    )
    square_mm: float = setting(25.0, "Side of a square.", low=0.1, high=10_000)
    charuco: bool = setting(False, "The board is a ChArUco board.")
    marker_mm: float | None = setting(
        None, "Side of a ChArUco marker; default: 0.75 of the square.", low=0.1, high=10_000
    )
    dictionary: str = setting("DICT_4X4_50", "OpenCV's name of the ChArUco markers' dictionary.")

    def pattern(self) -> Board:
        """The board; CallError if there is none like that."""
        from doorway3ds.camera.board import Board

        size = re.fullmatch(r"(\d+)x(\d+)", self.board)
        if size is None:
            raise CallError(f"--board is columns x rows, as in 9x6, got '{self.board}'")
        if not self.charuco and self.marker_mm is not None:
            raise CallError("--marker-mm belongs to a ChArUco board; add --charuco")
        marker_mm = 0.75 * self.square_mm if self.marker_mm is None else self.marker_mm
        try:
            return Board(
                int(size[1]),
                int(size[2]),
                self.square_mm / 1e3,
                marker_mm / 1e3 if self.charuco else None,
                self.dictionary,
            )
        except UserError as error:
            raise CallError(str(error)) from error

    def given(self) -> str:
        """The options that a call needs for this board, as typed."""
        words = f"--board {self.board} --square-mm {self.square_mm:g}"
        if self.charuco:
            words += " --charuco"
            words += "" if self.marker_mm is None else f" --marker-mm {self.marker_mm:g}"
            if self.dictionary != "DICT_4X4_50":
                words += f" --dictionary {self.dictionary}"
        return words


@expand
def calibrate(
    pattern: BoardOptions,
    images: Annotated[
        list[str] | None, typer.Argument(metavar="IMAGES...", help="Images or folders of them.")
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(_MODELS),
            help="Lens model; default: the one that predicts held-out views best.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="The camera_info YAML to write.")] = Path("camera.yaml"),
    name: Annotated[str | None, typer.Option(help="The camera's name; default: of --out.")] = None,
    board_pdf: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Board to print on A4 at 100 %; nothing else is done."),
    ] = None,
) -> None:
    """Make a camera file from images of a chessboard or ChArUco board.

    Ten to twenty sharp images of a flat board, tilted, at several distances, also near the
    image's corners. `3ds look --camera camera.yaml` then uses the file. --board-pdf prints a board.

    Example: 3ds calibrate board/*.jpg --board 9x6 --out camera.yaml
    """
    if model is not None and model not in _MODELS:
        raise CallError(f"--model must be one of {', '.join(_MODELS)}, got '{model}'")
    board = pattern.pattern()
    if board_pdf is not None:
        if images:
            raise CallError("--board-pdf prints a board and takes no images; leave one of them out")
        _print_board(board, pattern.given(), board_pdf)
        return
    if not images:
        raise CallError("name images of a board, or --board-pdf FILE to print one")

    from doorway3ds.camera.calibration import calibrate as run
    from doorway3ds.cli.shared.inputs import expand as images_of

    inputs, errors = images_of(images)
    if errors:
        raise UserError(errors[0])
    found = run(
        _pictures(inputs), board, name or out.stem, None if model is None else _MODELS[model]
    )
    _report(found, out)


def _print_board(board: Board, options: str, path: Path) -> None:
    from doorway3ds.camera.board import RULER_MM, printable
    from doorway3ds.files import write_bytes

    call = f"3ds calibrate IMAGES... {options}"
    check = f"Print at 100 %: this line must measure {RULER_MM} mm. Then glue it to something flat."
    write_bytes(path, printable(board, (check, call)))
    typer.echo(f"wrote {path}; print it on A4 at 100 % and check its ruler, then: {call}")


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
        f"reprojection error {found.rms_px:.3f} px over {len(found.errors_px)} pictures; "
        f"fx {camera.fx:.1f} fy {camera.fy:.1f} cx {camera.cx:.1f} cy {camera.cy:.1f}, "
        f"field of view {camera.hfov_deg:.1f} x {camera.vfov_deg:.1f} deg"
    )
    if found.rms_px > GOOD_RMS_PX * max(1.0, camera.width / 640):
        sys.stderr.write(
            "3ds: the error is large; leave out the worst pictures, keep the board flat and still\n"
        )
    if found.coverage < GOOD_COVERAGE:
        sys.stderr.write(
            f"3ds: the board covers {found.coverage:.0%} of the picture over all pictures; "
            "show it near the corners too, where lenses distort most\n"
        )
    typer.echo(f"wrote {out}")


def _pictures(inputs: list[Any]) -> Iterator[tuple[str, Any]]:
    from doorway3ds.images.codec import as_stored, read_image

    for item in inputs:
        # As stored: a camera file is of the sensor, however the camera was held.
        yield item.name, as_stored(read_image(item.read(), name=item.name))
