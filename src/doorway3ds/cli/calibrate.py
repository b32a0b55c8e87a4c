"""`3ds calibrate`: a camera file from pictures of a board."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from doorway3ds.errors import CallError, UserError

_MODELS = {
    "plumb_bob": "plumb_bob",
    "rational_polynomial": "rational_polynomial",
    "fisheye": "equidistant",
}
GOOD_RMS_PX = 0.5  # per 640 columns; above it something moved, blurred or was not flat
GOOD_COVERAGE = 0.5


def calibrate(
    images: Annotated[
        list[str], typer.Argument(metavar="IMAGES...", help="Pictures or folders of them.")
    ],
    board: Annotated[
        str, typer.Option(help="Chessboard: inner corners; ChArUco: squares. Columns x rows.")
    ] = "9x6",
    square_mm: Annotated[float, typer.Option(help="Side of a square.")] = 25.0,
    charuco: Annotated[
        bool, typer.Option("--charuco", help="The board is a ChArUco board.")
    ] = False,
    marker_mm: Annotated[
        float | None, typer.Option(help="Side of a ChArUco marker; default: 0.75 of the square.")
    ] = None,
    dictionary: Annotated[
        str, typer.Option(help="OpenCV's name of the ChArUco markers' dictionary.")
    ] = "DICT_4X4_50",
    model: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(_MODELS),
            help="Lens model; default: the one that predicts held-out views best.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="The camera_info YAML to write.")] = Path("camera.yaml"),
    name: Annotated[str | None, typer.Option(help="The camera's name; default: of --out.")] = None,
) -> None:
    """Make a camera file from pictures of a chessboard or ChArUco board.

    Ten to twenty sharp pictures of a flat board, tilted, at several distances, also near the
    picture's corners. `3ds look --camera camera.yaml` then uses the file.

    Example: 3ds calibrate board/*.jpg --board 9x6 --out camera.yaml
    """
    from doorway3ds.camera.calibration import Board
    from doorway3ds.camera.calibration import calibrate as run
    from doorway3ds.camera.info import check_lens, write_camera_info
    from doorway3ds.cli.shared.inputs import expand

    size = re.fullmatch(r"(\d+)x(\d+)", board)
    if size is None:
        raise CallError(f"--board is columns x rows, as in 9x6, got '{board}'")
    if not charuco and marker_mm is not None:
        raise CallError("--marker-mm belongs to a ChArUco board; add --charuco")
    if model is not None and model not in _MODELS:
        raise CallError(f"--model must be one of {', '.join(_MODELS)}, got '{model}'")
    side = square_mm / 1e3
    marker = (0.75 * side if marker_mm is None else marker_mm / 1e3) if charuco else None
    try:
        pattern = Board(int(size[1]), int(size[2]), side, marker, dictionary)
    except UserError as error:
        raise CallError(str(error)) from error

    inputs, errors = expand(images)
    if errors:
        raise UserError(errors[0])
    found = run(
        _pictures(inputs), pattern, name or out.stem, None if model is None else _MODELS[model]
    )
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
