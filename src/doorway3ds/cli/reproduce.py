"""`3ds reproduce`: the paper's experiments, as far as data allow, beside what it prints."""

from __future__ import annotations

import datetime
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from doorway3ds.camera.options import LensOptions
from doorway3ds.cli.shared.options import Network, expand
from doorway3ds.cli.shared.output import print_tables, say
from doorway3ds.cli.shared.progress import Progress
from doorway3ds.cli.shared.training import Watch, command_line
from doorway3ds.decide.options import PACKAGED
from doorway3ds.errors import CallError
from doorway3ds.lab.train.options import ClassOptions, SrinOptions, StartOptions
from doorway3ds.options import THREADS, setting

if TYPE_CHECKING:
    from doorway3ds.lab.datasets.doors import DoorPictures
    from doorway3ds.lab.evaluate.paper.reproduce import Answer
    from doorway3ds.lab.evaluate.report.html import Report
    from doorway3ds.lab.train.paper.srinrun import EpochScores


@expand
def reproduce(
    camera: LensOptions,
    classes: ClassOptions,
    training: StartOptions,
    pictures: Path | None = setting(
        None,
        "Twelve images for Tables 1 and 2, in a folder per class or without classes.",
        metavar="DIR",
    ),
    network: Network = PACKAGED,
    dataset: Path | None = setting(
        None,
        "Data set to train CNN-SRIN on for 10, 20 and 30 epochs; needs --out.",
        metavar="DATASET",
    ),
    threads: int | None = setting(None, "CPU threads; default: all.", **THREADS),
    as_json: bool = setting(False, "Print one JSON object instead.", names=("--json",)),
    out: Path | None = setting(
        None, "Write report.html, report.json and PNGs there.", metavar="DIR"
    ),
) -> None:
    """Recompute the paper's tables, beside the published ones, as far as data allow.

    Without options it recomputes what needs no data: the angles of Tables 3 and 4. Twelve images
    stand in for Tables 1 and 2, assumed to be of the paper's camera (60.9 degrees across) unless
    --camera or --fov-deg says otherwise; a data set of two classes stands in for the training.
    It reports what cannot be rerun without the authors' images.

    Example: 3ds reproduce --pictures twelve --out report
    """
    if dataset is not None and out is None:
        raise CallError("--dataset trains; add --out DIR for its features and checkpoints")
    if dataset is not None:
        from doorway3ds.lab.train.engine import backend as engine
        from doorway3ds.lab.train.engine import outcome

        engine.start(threads)  # a missing extra is told before anything takes long
        outcome.require_plots()
    from doorway3ds.lab.evaluate.paper import printed
    from doorway3ds.lab.evaluate.paper import reproduce as tables
    from doorway3ds.lab.evaluate.report.html import Report

    rows = [tables.recompute(row) for row in printed.ROWS]
    facts = {
        "paper": printed.SOURCE,
        "command": command_line(),
        "date": datetime.date.today().isoformat(),
    }
    shown = [tables.angle_table(rows)]
    answers: list[Answer] = []
    if pictures is not None:
        facts |= {"pictures": str(pictures), "network": network}
        answers = _answers(pictures, network, camera, threads)
        shown.append(tables.pictures_table(answers))
    here = tables.count(answers)
    shown.append(tables.confusion_table(here))
    scored, curve = None, b""
    if dataset is not None and out is not None:
        from doorway3ds.lab.datasets.doors import read_door_pictures

        with Progress() as seen:
            found = read_door_pictures(
                dataset,
                classes.choice(training.seed),
                layout=classes.layout,
                places=classes.read_places(),
                seen=seen,
            )
        options = SrinOptions(**asdict(training))
        trained = _train(found, options, out / "cnn-srin")
        facts |= {
            "data": f"{dataset}: {_of_classes(found)}",
            "near-copies across the split": str(trained.leaks),
            "first weights": training.weights,
        }
        scored, curve = trained.scored, outcome.curves(trained.history, "accuracy")
    shown.append(tables.epochs_table(scored))
    notes = [tables.verdict(rows), tables.floor_verdict(printed.ROWS), *printed.NOT_RERUN]
    if answers and here is None:
        notes.append("The twelve images lie in no class folders: no counts are made.")
    if scored is not None and training.weights == "none":
        notes.append("VGG16 was random (--weights none): its accuracy says nothing of the paper's.")
    report = Report("The paper's experiments, repeated", facts, shown, notes=notes)
    if curve:
        report.add_plot("epochs", "Accuracy by epoch", curve)
    _show(report, tables.result(rows, answers, scored), as_json, out)


def _answers(folder: Path, network: str, options: LensOptions, threads: int | None) -> list[Answer]:
    from doorway3ds.camera.choice import choose_camera
    from doorway3ds.decide.options import DecideOptions, Method
    from doorway3ds.decide.pipeline import build_pipeline
    from doorway3ds.lab.evaluate.paper import printed
    from doorway3ds.lab.evaluate.paper import reproduce as tables

    if options == LensOptions():
        options = LensOptions(fov_deg=printed.FOV_DEG)
    samples = tables.read_pictures(folder, choose_camera(options).fit)
    pipeline = build_pipeline(DecideOptions(network, threads=threads, method=Method.PAPER))
    with Progress() as seen:
        return tables.answer_pictures(samples, pipeline.decide, seen)


def _of_classes(found: DoorPictures) -> str:
    """ "3 no-door and 3 open-door images, 6 groups by near-duplicates"."""
    labels = found.labels
    counts = " and ".join(f"{labels.count(name)} {name}" for name in sorted(set(labels)))
    return f"{counts} images, {len(set(found.groups))} groups by {found.grouping}"


def _train(found: DoorPictures, options: SrinOptions, folder: Path) -> EpochScores:
    from doorway3ds.lab.evaluate.paper import printed
    from doorway3ds.lab.train.engine.training import Run
    from doorway3ds.lab.train.paper.srinrun import score_epochs

    say(_of_classes(found))
    epochs = sorted(printed.VALIDATION_ACCURACY)
    with Progress() as seen:
        run = Run(folder, watcher=Watch(epochs[-1]), seen=seen)
        return score_epochs(found, options, run, epochs)


def _show(report: Report, result: dict[str, Any], as_json: bool, out: Path | None) -> None:
    from rich.console import Console

    from doorway3ds.lab.evaluate.report.html import write_report

    result = {**report.facts, **result}
    if out is not None:
        say(f"wrote {write_report(report, out, result)}")
    if as_json:
        sys.stdout.write(json.dumps(result, allow_nan=False) + "\n")
        return
    console = Console()
    for table in report.tables:
        print_tables(console, [table])
        console.print()
    for note in report.notes:
        console.print(f"- {note}", highlight=False, markup=False)
