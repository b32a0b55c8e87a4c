"""`3ds eval`: measure methods and networks on marked images."""

from __future__ import annotations

import atexit
import datetime
import json
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doorway3ds.cli.shared.options import Mirror, expand
from doorway3ds.cli.shared.output import apart, print_tables, report_files, say, write_numbers
from doorway3ds.cli.shared.progress import Progress
from doorway3ds.cli.shared.training import command_line
from doorway3ds.decide.options import PACKAGED
from doorway3ds.errors import CallError
from doorway3ds.files import read_text, write_bytes
from doorway3ds.lab.evaluate.options import DataOptions, MarkOptions, ReportOptions
from doorway3ds.options import MANY, setting

if TYPE_CHECKING:
    from doorway3ds.lab.datasets.samples import Dataset, Sample
    from doorway3ds.lab.evaluate.report.html import Report, Table
    from doorway3ds.networks.base import Network

app = typer.Typer(
    help="Measure methods and networks on marked images, with confidence intervals.\n\n"
    "Example: 3ds eval direction rooms --method opening,paper",
    no_args_is_help=True,
)

Data = Annotated[
    str,
    typer.Argument(
        help="Folder with doorways.csv, boxes.csv or a folder per class, or bag://FILE with marks."
    ),
]
Networks = Annotated[
    list[str] | None,
    typer.Option(
        "--network",
        metavar="NAME|FILE",
        help="Network, NAME[+NAME] or an .onnx file; repeatable; default: doornet. {k} is the "
        "fold.",
    ),
]


@app.command()
@expand
def direction(
    data: Data,
    pictures: MarkOptions,
    report: ReportOptions,
    method: str = setting("opening,paper", "Methods to compare, separated by commas."),
    network: Networks = None,
    mirror: Mirror = False,
    answers: list[Path] | None = setting(
        None,
        "Score stored answers (3ds look --json, --save-answers, or a folder of "
        "3ds batch) instead; repeatable.",
        metavar="FILE|DIR",
    ),
    truth_depth: bool = setting(False, "Use true depth; the columns stay the network's."),
    no_gate: bool = setting(False, "Assume every image shows a doorway."),
    save_answers: Path | None = setting(
        None, "Write every answer, one JSON object per line.", metavar="FILE"
    ),
) -> None:
    """Measure bearing, range, way and gates against marked openings, methods side by side.

    If the data set names what an image without a doorway shows (closed door, window, mirror,
    wardrobe ...), false alarms are reported by kind.

    --network none --truth-depth --method paper measures the paper's selection on true depth.

    Example: 3ds eval direction rooms --method opening,paper --out report
    """
    from doorway3ds.lab.evaluate import direction as scores
    from doorway3ds.lab.evaluate import kinds, runners, stored
    from doorway3ds.lab.evaluate.report import pages
    from doorway3ds.networks.averaged import Mirrored

    _apart(pictures, report, save_answers, answers)
    dataset = _dataset(data, pictures)
    runs: runners.DirectionRuns = runners.Runs()
    if answers:
        if network or mirror or truth_depth or no_gate or pictures.folds:
            raise CallError("--answers scores what is stored; leave the network's options out")
        chosen, _ = next(_parts(dataset, pictures))
        dataset = chosen
        runs = runners.match_answers(_progress(chosen.samples), stored.read_answers(answers))
    else:
        methods = [name.strip() for name in method.split(",")]
        names = network or [PACKAGED]
        for part, k in _parts(dataset, pictures):
            for name in names:
                loaded = None if name == "none" else _network(name, k)
                if loaded is not None and mirror:
                    loaded, name = Mirrored(loaded), f"{name}, mirrored average"
                label = "true depth" if loaded is None else name
                answer = runners.methods_on(loaded, label, methods, truth_depth, no_gate)
                known = loaded is not None and not no_gate
                runs.add(runners.run_direction(_progress(part.samples), answer, known))
    scored = {label: scores.score(r, report.repeats) for label, r in runs.records.items()}
    first, *others = runs.records
    differences = {
        label: scores.difference(runs.records[first], runs.records[label], report.repeats)
        for label in others
    }
    by_kind = {label: kinds.score(r, report.repeats) for label, r in runs.records.items()}
    result = pages.direction_json(scored, differences, by_kind)
    tables = [pages.direction_table(scored)]
    if differences:
        tables.append(pages.difference_table(differences, first))
    tables += pages.kind_tables(by_kind)
    if save_answers is not None:
        lines = [json.dumps(answer) for column in runs.answers.values() for answer in column]
        write_bytes(save_answers, ("\n".join(lines) + "\n").encode())
    page = _page("Direction", dataset, runs.left_out, tables)
    if report.out is not None:
        page.reasons = True
        samples = {s.name: s for s in dataset.samples}
        pages.add_direction_pictures(page, samples, runs.records, scored)
    _finish(page, result, report)


@app.command()
@expand
def classifier(
    data: Data,
    pictures: MarkOptions,
    report: ReportOptions,
    network: Networks = None,
    mirror: Mirror = False,
    threshold: float = setting(
        0.5, "Probability from which a doorway counts as open.", low=0, high=1
    ),
) -> None:
    """Measure p_open against open or not: accuracy, AUC, calibration, false alarms by kind.

    Example: 3ds eval classifier rooms --network doornet --folds 5
    """
    from doorway3ds.lab.evaluate import classifier as scores
    from doorway3ds.lab.evaluate import runners
    from doorway3ds.lab.evaluate.report import pages
    from doorway3ds.networks.averaged import Mirrored

    _apart(pictures, report)
    dataset = _dataset(data, pictures)
    runs: runners.Runs[str, scores.ClassifierRecord] = runners.Runs()
    for part, k in _parts(dataset, pictures):
        loaded = {name: _network(name, k, ["p_open"]) for name in network or [PACKAGED]}
        if mirror:
            loaded = {f"{name}, mirrored average": Mirrored(n) for name, n in loaded.items()}
        runs.add(runners.run_classifier(_progress(part.samples), loaded))
    scored = {name: scores.score(r, threshold, report.repeats) for name, r in runs.records.items()}
    result = {
        "task": "classifier",
        "runs": [{"network": name, **vars(s)} for name, s in scored.items()],
    }
    page = _page("Classifier", dataset, runs.left_out, [pages.classifier_table(scored)])
    if report.out is not None:
        samples = {s.name: s for s in dataset.samples}
        pages.add_classifier_pictures(page, samples, runs.records, scored)
    _finish(page, result, report)


@app.command()
@expand
def depth(
    data: Data,
    pictures: DataOptions,
    report: ReportOptions,
    network: Networks = None,
    mirror: bool = setting(False, "Also evaluate the average of both mirrorings."),
) -> None:
    """Measure depth: delta1-3, AbsRel, RMSE and log10, over the whole image and the Eigen crop.

    Example: 3ds eval depth nyu --network densedepth
    """
    from doorway3ds.lab.evaluate import depth as scores
    from doorway3ds.lab.evaluate import runners
    from doorway3ds.lab.evaluate.report import pages

    _apart(pictures, report)
    dataset = _dataset(data, pictures)
    runs: runners.Runs[runners.Protocol, scores.DepthRecord] = runners.Runs()
    for part, k in _parts(dataset, pictures):
        loaded = {name: _network(name, k, ["depth"]) for name in network or [PACKAGED]}
        runs.add(runners.run_depth(_progress(part.samples), loaded, mirror, pages.WORST // 2))
    scored = {protocol: scores.score(r, report.repeats) for protocol, r in runs.records.items()}
    page = _page("Depth", dataset, runs.left_out, [pages.depth_table(scored)])
    if report.out is not None:
        worst = {name: cases[: pages.WORST // 2] for name, cases in runs.worst.items()}
        pages.add_depth_pictures(page, runs.records, worst)
    _finish(page, pages.depth_json(scored), report)


@app.command()
@expand
def overview(
    datasets: Annotated[list[Path], typer.Argument(help="Folders with doorways.csv or boxes.csv.")],
    held_out: Annotated[
        Path, typer.Option(metavar="FILE", help="held-out.csv of a training with --hold-out.")
    ],
    network: Networks = None,
    preset: str | None = setting(None, "Operating point of the networks' files.", metavar="NAME"),
    repeats: int = setting(2000, "Bootstrap resamples; 0 = no intervals.", low=0, high=MANY),
    sheets: Path | None = setting(
        None, "Write the worst images of each set there, as PNG.", metavar="DIR"
    ),
    json_file: Path | None = setting(
        None, "Write the numbers as JSON; - for stdout.", metavar="FILE", names=("--json",)
    ),
) -> None:
    """Print one table over several data sets, of the images that a training has not seen.

    RUN/half-{k}.onnx measures each half of the places by calibration and limits of the other.
    Further networks are also compared with the first: paired differences with their intervals.

    Example: 3ds eval overview rooms homes --held-out runs/doornet/held-out.csv
    """
    from doorway3ds.lab.evaluate import overview as tables
    from doorway3ds.networks.registry import load

    apart({"--json": json_file}, [held_out])
    names = network or [PACKAGED]
    rows: list[tables.Row] = []
    for part in tables.held_sets(datasets, tables.read_held(held_out)):
        rows += tables.compare(part, names, load, preset, repeats, sheets, _progress)
    if json_file is not None:
        write_numbers(json_file, {"rows": rows})
    if str(json_file) != "-":
        typer.echo(tables.table(rows), nl=False)


def _apart(
    pictures: DataOptions,
    report: ReportOptions,
    save_answers: Path | None = None,
    answers: Sequence[Path] | None = None,
) -> None:
    """Before anything takes long: no file that is written replaces another, or one that is read."""
    written = {**report_files("--out", report.out), "--json": report.json_file}
    marks = pictures.marks if isinstance(pictures, MarkOptions) else None
    apart(
        {**written, "--save-answers": save_answers},
        [*(answers or ()), pictures.images, pictures.places, marks],
    )


def _dataset(data: str, options: DataOptions) -> Dataset:
    from doorway3ds.camera.choice import choose_camera
    from doorway3ds.lab.datasets import readers
    from doorway3ds.lab.datasets import samples as datasets

    of_image = None if options.places is None else readers.read_places(options.places)
    marks = options.marks if isinstance(options, MarkOptions) else None
    if data.startswith("bag://"):
        dataset = _bag(data, marks, of_image)
    elif marks is not None:
        raise CallError("--marks belongs to a bag; a folder has its own doorways.csv")
    else:
        dataset = readers.read_dataset(Path(data), options.layout, of_image)
    if isinstance(options, MarkOptions):
        dataset = datasets.at_least(dataset, options.min_confidence)
    if options.camera is None and options.fov_deg is None:
        return dataset
    choice = choose_camera(options)
    return datasets.with_camera(dataset, choice.fit, choice.pose)


def _bag(uri: str, marks: Path | None, of_image: dict[str, str] | None) -> Dataset:
    from doorway3ds.lab.datasets.bags import read_bag

    folder = tempfile.TemporaryDirectory(prefix="3ds-bag-")
    atexit.register(folder.cleanup)  # reports show its images once more
    return read_bag(uri, marks, Path(folder.name), of_image)


def _parts(dataset: Dataset, options: DataOptions) -> Iterator[tuple[Dataset, int | None]]:
    """The selected samples, fold by fold where folds are asked for, with the fold from 1."""
    from doorway3ds.lab.datasets import samples as datasets

    split, folds, images = options.split, options.folds, options.images
    if sum(option is not None for option in (split, folds, images)) > 1:
        raise CallError("--split, --folds and --images each select images; pass one of them")
    if folds is not None:
        for fold in range(folds):
            yield datasets.held_out(dataset, fold, folds), fold + 1
    elif split is not None:
        fold, count = datasets.parse_split(split)
        yield datasets.held_out(dataset, fold, count), fold + 1
    elif images is not None:
        lines = read_text(images).splitlines()
        names = [line.strip() for line in lines if line.strip() and not line.startswith("#")]
        yield datasets.only_named(dataset, names), None
    else:
        yield dataset, None


def _network(name: str, k: int | None, needs: Sequence[str] = ()) -> Network:
    from doorway3ds.networks.registry import load

    if "{k}" in name and k is None:
        raise CallError("{k} in --network stands for the fold; give --folds N or --split K/N")
    return load(name.replace("{k}", str(k)), needs=needs)


def _progress(samples: Sequence[Sample]) -> Iterator[Sample]:
    with Progress(len(samples)) as bar:
        for done, sample in enumerate(samples):
            bar(done)
            yield sample


def _page(
    title: str, dataset: Dataset, left_out: dict[str, str], tables: Sequence[Table]
) -> Report:
    from doorway3ds.lab.evaluate.report.html import Report

    facts = {
        "data": f"{dataset.path} ({dataset.layout})",
        "command": command_line(),
        "date": datetime.date.today().isoformat(),
    }
    if not dataset.places_known:
        facts["places"] = "unknown: each image counts as its own, so intervals are too narrow"
    if dataset.layout == "boxes":
        facts["marks"] = "boxes hold frame and leaf: their middles and edges are rough"
    if left_out:
        name, why = next(iter(left_out.items()))
        facts["left out"] = f"{len(left_out)} images, first {name}: {why}"
    return Report(f"{title} on {dataset.path.name}", facts, list(tables))


def _finish(page: Report, result: dict[str, Any], options: ReportOptions) -> None:
    from rich.console import Console

    from doorway3ds.lab.evaluate.report.html import write_report

    result = {**page.facts, **result}
    if options.out is not None:
        say(f"wrote {write_report(page, options.out, result)}")
    if options.json_file is not None:
        write_numbers(options.json_file, result)
    if str(options.json_file) == "-":
        return
    console = Console()
    print_tables(console, page.tables)
    for name in ("places", "marks", "left out"):
        if name in page.facts:
            console.print(f"{name}: {page.facts[name]}", highlight=False, markup=False)
