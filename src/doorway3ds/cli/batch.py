"""`3ds batch`: decides for very many images and writes a table."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from doorway3ds.camera.options import CameraOptions
from doorway3ds.cli.shared.options import expand
from doorway3ds.cli.shared.output import complain, say
from doorway3ds.cli.shared.progress import CountedBar
from doorway3ds.decide.options import DecideOptions
from doorway3ds.errors import CallError, UserError
from doorway3ds.options import setting


@expand
def batch(
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="SOURCE",
            help="Images, folders (recursive), patterns, .txt lists, .tar and .parquet shards, "
            "films, bags, and s3://, gs:// or https:// URLs.",
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the Parquet data set.")],
    camera: CameraOptions,
    decide: DecideOptions,
    workers: int | None = setting(None, "Processes; default: one for each core.", low=1, high=1024),
    ray: str | None = setting(None, "Decide on a Ray cluster instead.", metavar="ADDRESS|auto"),
    annotate: Path | None = setting(None, "Write annotated images there.", metavar="DIR"),
    depth_dir: Path | None = setting(
        None, "Write depth maps in metres there, .npy.", metavar="DIR"
    ),
    report: bool = setting(False, "Write _report/report.html into DIR."),
) -> None:
    """Decide for very many images and write the answers as Parquet.

    Repeat an interrupted call to continue it: images whose content and settings are unchanged are
    not decided again. A damaged image becomes a row with an error.

    Example: 3ds batch recordings/ --out answers --report

    Exit status: 0 every image was answered, 1 some were not, 2 wrong call.

    docs/reasons.md says what each reason asks you to do.
    """
    from doorway3ds.camera.choice import choose_camera
    from doorway3ds.decide.pipeline import build_pipeline
    from doorway3ds.images.codec import SUFFIXES
    from doorway3ds.lab.batch.items import count_items
    from doorway3ds.lab.batch.rows import counts
    from doorway3ds.lab.batch.run import Outcome, lens_doubt, run_batch
    from doorway3ds.lab.batch.worker import Job
    from doorway3ds.networks.session import available_threads
    from doorway3ds.sources.base import View

    choice = choose_camera(camera)
    make = partial(build_pipeline, replace(decide, threads=decide.threads or 1))
    settings = {
        **asdict(replace(decide, threads=None)),
        **asdict(camera),
        "network": _digests(decide.network),
        "camera": _camera(camera.camera),
    }
    make()  # a wrong network or option is said once, here, and not by every worker
    view = View(choice.fit if choice.given else None, choice.pose_of)
    job = Job(make, view, annotate, depth_dir)
    with CountedBar(lambda: count_items(sources)) as bar:
        outcome = run_batch(
            sources,
            out,
            job,
            settings,
            workers=workers or available_threads(),
            ray=ray,
            told=lambda now: bar(
                now.answered + now.kept + now.errors, f"{now.errors} errors" if now.errors else ""
            ),
        )
    if outcome == Outcome(0, 0, 0):
        raise UserError(f"no image in {', '.join(sources)}; expected {', '.join(sorted(SUFFIXES))}")
    if outcome.answered and (doubt := lens_doubt(sources, job)) is not None:
        complain(doubt)
    by_folder = counts(out)
    for where, count in by_folder.items():
        say(
            f"{where}: {count['images']} images, {count['open']} open, {count['turn']} turns, "
            f"{count['blocked']} blocked, {count['unsure']} unsure, {count['errors']} errors"
        )
    say(
        f"{outcome.answered} answered, {outcome.kept} unchanged, {outcome.errors} errors; "
        f"rows in {out}"
    )
    if report:
        from doorway3ds.lab.batch.report import write_batch_report

        path = write_batch_report(
            out, sources, {"sources": " ".join(sources), "network": decide.network}
        )
        say(f"report in {path}")
    if any(count["errors"] for count in by_folder.values()):
        raise typer.Exit(1)


def _digests(network: str) -> dict[str, str]:
    """The networks by their content: a file trained again is another setting."""
    from doorway3ds.files import digest
    from doorway3ds.networks.registry import find

    files = {
        name: None if name.endswith(".onnx") else find(name).found() for name in network.split("+")
    }
    return {name: digest(file or Path(name)) for name, file in files.items()}


def _camera(camera: str | None) -> str | None:
    """A camera file by its content: a calibration made again is another setting."""
    if camera is None or not Path(camera).is_file():
        return camera
    from doorway3ds.files import digest

    try:
        return digest(Path(camera))
    except OSError as error:
        raise CallError(f"cannot read the camera file {camera}: {error.strerror}") from error
