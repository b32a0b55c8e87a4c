"""`3ds look`: images in, one decision each, and an annotated image."""

from __future__ import annotations

import csv
import io
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doorway3ds.camera.options import CameraOptions
from doorway3ds.cli.shared.inputs import Input, images_of
from doorway3ds.cli.shared.options import expand
from doorway3ds.cli.shared.output import complain, linked, say
from doorway3ds.cli.shared.progress import Progress
from doorway3ds.cli.shared.robot import open_eyes
from doorway3ds.cli.shared.viewer import Rerun, viewer_of
from doorway3ds.compat import StrEnum
from doorway3ds.decide.options import DecideOptions
from doorway3ds.errors import CallError, UserError
from doorway3ds.options import setting

if TYPE_CHECKING:
    from doorway3ds.camera.choice import CameraChoice
    from doorway3ds.camera.vanishing import FocalWatch
    from doorway3ds.decide.pipeline import Pipeline
    from doorway3ds.draw.viewer import Viewer
    from doorway3ds.types import Decision

OUT = Path("3ds-out")
COLUMNS = (
    "image", "method", "network", "camera_name", "camera_assumed", "p_open", "open", "reason",
    "turn_deg", "bearing_deg", "range_m", "clear", "floor_from_m", "look", "score", "cut",
    "left_deg", "right_deg", "left_px", "right_px",
)  # fmt: skip


class Style(StrEnum):
    """Which images `3ds look` writes."""

    PAGE = "page"
    OVERLAY = "overlay"


@expand
def look(
    images: Annotated[
        list[str],
        typer.Argument(
            metavar="IMAGE", help="Files, folders, http(s) addresses, bag://FILE, or - for stdin."
        ),
    ],
    camera: CameraOptions,
    decide: DecideOptions,
    as_json: bool = setting(
        False, "Print one JSON object per image, one per line.", names=("--json",)
    ),
    as_csv: bool = setting(
        False, "Print CSV: a header, then one line per image.", names=("--csv",)
    ),
    recursive: bool = setting(False, "Also search the subfolders of a folder."),
    out: Path | None = setting(
        None,
        f"Folder for annotated images; default ./{OUT}, none with --json or --csv.",
        metavar="DIR",
    ),
    style: Style = setting(Style.PAGE, "Write the annotated page alone, or also the marked image."),
    faint: bool = setting(False, "Also draw candidates that score below 0.1."),
    depth_dir: Path | None = setting(None, "Folder for depth maps in metres, .npy.", metavar="DIR"),
    rerun: Rerun = None,
) -> None:
    """Report for each image whether a doorway is open, where, and how far to turn.

    Exit status: 0 every image was answered, 1 some were not, 2 wrong call.

    docs/reasons.md says what each reason asks you to do.

    Example: 3ds look photo.jpg --camera nao-v6-top --json
    """
    from doorway3ds.camera.choice import choose_camera
    from doorway3ds.camera.vanishing import FocalWatch
    from doorway3ds.decide.pipeline import build_pipeline

    choice = choose_camera(camera)
    pipeline = build_pipeline(decide)
    if as_json and as_csv:
        raise CallError("--json and --csv both choose the output format; give one of them")
    if out is None and not (as_json or as_csv):
        out = OUT
    for folder in (out, depth_dir):
        try:
            if folder is not None:
                folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CallError(f"cannot make the folder {folder}: {error.strerror}") from error

    bags = [name for name in images if name.startswith("bag://")]
    inputs, errors = images_of((name for name in images if name not in bags), recursive)
    for message in errors:
        complain(message)
    total, failed = len(inputs) + len(errors), len(errors)
    line = _json if as_json else _row if as_csv else _words
    files = _Files(out, depth_dir, style, faint)
    if as_csv:
        sys.stdout.write(_csv_line(COLUMNS) + "\n")
    lens = FocalWatch()
    start = time.monotonic()
    with viewer_of(rerun) as viewer, Progress(len(inputs)) as progress:
        job = _Job(pipeline, choice, line, files, viewer, lens)
        for done, image in enumerate(inputs):
            progress(done)
            try:
                decision = job.decide(image)
                progress.clear()
                job.answer(image, decision)
            except UserError as error:
                progress.clear()
                complain(str(error))
                failed += 1
        progress.clear()
        for bag in bags:
            held, damaged = job.bag(bag, camera)
            total, failed = total + held, failed + damaged
    if lens.doubt is not None:
        complain(lens.doubt)
    if total > 1:
        answered = f"{total - failed} of {total} answered in {time.monotonic() - start:.1f} s"
        say(answered + (f", annotated images in {out}" if out is not None else ""))
    if failed:
        raise typer.Exit(1)


@dataclass(frozen=True)
class _Job:
    """How each image is decided on, and said."""

    pipeline: Pipeline
    choice: CameraChoice
    line: Callable[[str, Decision], str]
    files: _Files
    viewer: Viewer | None
    lens: FocalWatch

    def bag(self, uri: str, camera: CameraOptions) -> tuple[int, int]:
        """Answers each image of a bag; returns how many it holds and how many are damaged."""
        number = 0
        with open_eyes(uri, camera) as source:
            source.notice = complain
            stem = Path(uri.partition("?")[0]).stem
            for frame in source:
                number += 1
                image = Input(source.frame_name, f"{stem}-{number:06d}")
                self.answer(image, self.pipeline.decide(frame))
            return number + source.damaged, source.damaged

    def decide(self, image: Input) -> Decision:
        """The decision on one image, with the time that reading it took."""
        from doorway3ds.sources.base import View

        name = "standard input" if image.name == "-" else image.shown
        view = View(self.choice.fit, self.choice.pose_of)
        return self.pipeline.decide_file(image.read(), view, name)

    def answer(self, image: Input, decision: Decision) -> None:
        """The line, and the annotated image, depth map and recording that are asked for."""
        sys.stdout.write(self.line(image.shown, decision) + "\n")
        sys.stdout.flush()
        if self.viewer is not None:
            self.viewer.add(decision)
        self.files.write(image, decision)
        self.lens.look(decision.frame.image, decision.frame.camera)


@dataclass(frozen=True)
class _Files:
    """Which files are written of each image."""

    out: Path | None
    depth_dir: Path | None
    style: Style
    faint: bool

    def write(self, image: Input, decision: Decision) -> None:
        """The annotated images and the depth map, if they are asked for."""
        if self.out is not None:
            from doorway3ds.draw import annotate, overlay
            from doorway3ds.images.codec import write_image

            # Another name than the input's: --out may be the folder that holds the photographs.
            page = annotate(decision, faint=self.faint)
            write_image(self.out / f"{image.stem}_3ds.jpg", page)
            if self.style is Style.OVERLAY:
                marked = overlay(decision, faint=self.faint)
                write_image(self.out / f"{image.stem}_3ds-overlay.jpg", marked)
        if self.depth_dir is not None:
            depth = decision.perception.depth_m
            if depth is None:
                raise UserError(
                    f"{image.shown}: network {decision.perception.network} returns no depth"
                )
            from doorway3ds.files import write_array

            write_array(self.depth_dir / f"{image.stem}.npy", depth)


def _words(name: str, decision: Decision) -> str:
    return f"{name}: {linked(str(decision), decision.reason, sys.stdout)}"


def _json(name: str, decision: Decision) -> str:
    return json.dumps(decision.to_dict(name), allow_nan=False)


def _row(name: str, decision: Decision) -> str:
    """The JSON's values in CSV, those of the best candidate beside them; nothing for null."""
    said = decision.to_dict(name)
    camera = {f"camera_{key}": value for key, value in said.pop("camera").items()}
    best = said["openings"][0] if said["openings"] else {}
    values = {**best, **said, **camera}
    found = (values.get(column) for column in COLUMNS)
    return _csv_line([str(v).lower() if isinstance(v, bool) else v for v in found])


def _csv_line(values: Sequence[Any]) -> str:
    line = io.StringIO()
    csv.writer(line, lineterminator="").writerow(values)
    return line.getvalue()
