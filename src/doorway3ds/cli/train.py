"""`3ds train`: networks from pictures. Needs the extra `train`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from doorway3ds.cli.shared.options import (
    Batch,
    Board,
    Epochs,
    EvalLayout,
    Group,
    HalfOpen,
    Install,
    Licence,
    Patience,
    Pattern,
    PerClass,
    PlacesFile,
    Precision,
    Rate,
    Resume,
    TrainOut,
    TrainThreads,
    Validation,
    Weights,
)
from doorway3ds.cli.shared.training import running, say
from doorway3ds.errors import CallError

app = typer.Typer(
    help="Train networks from images.\n\nExample: 3ds train cnn-srin pictures", no_args_is_help=True
)


@app.callback()
def top() -> None:
    """Train networks from pictures; each command writes an ONNX file that `3ds look` uses."""


@app.command()
def doornet(
    datasets: Annotated[
        list[Path], typer.Argument(help="Folders with doorways.csv or boxes.csv beside images/.")
    ],
    teachers: Annotated[
        Path, typer.Option(help="Folder with the ONNX files that training starts from.")
    ],
    out: TrainOut = Path("runs/doornet"),
    recipe: Annotated[
        Path | None, typer.Option(help="YAML file.  [default: the packaged one]")
    ] = None,
    hold_out: Annotated[
        str | None,
        typer.Option(metavar="K/N", help="Keep fold K of N of the places for calibration."),
    ] = None,
    report: Annotated[
        int | None,
        typer.Option(metavar="K", help="Keep fold K, too, from training and from calibration."),
    ] = None,
    marks: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="CSV with exact openings for pictures that lack them."),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="CARD", help="doornet.json of a held-out run, for one on everything."),
    ] = None,
    init: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Weights of an earlier run to start from.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Instead of the recipe's.")] = None,
    patience: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="End a stage after so many epochs without gain on held-out places, keep the best; "
            "0: never.  [default: the recipe's]",
        ),
    ] = None,
    precision: Precision = "auto",
    tensorboard: Board = False,
    resume: Resume = False,
    threads: TrainThreads = None,
) -> None:
    """Train doornet: p_open, opening columns, depth and floor in one network."""
    from dataclasses import replace

    from doorway3ds.lab.datasets.samples import parse_split
    from doorway3ds.lab.train.doornet.recipe import read_recipe
    from doorway3ds.lab.train.doornet.run import Teachers, train_doornet

    fold = parse_split(hold_out) if hold_out else None
    if report is not None and (fold is None or not 1 <= report <= fold[1] or report - 1 == fold[0]):
        raise CallError("--report is another fold of those that --hold-out K/N counts")
    chosen = read_recipe(recipe)
    given = {"seed": seed, "patience": patience}
    changed: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    chosen = replace(chosen, fit=replace(chosen.fit, **changed))
    epochs = sum(stage.epochs for stage in chosen.fit.stages)
    with running(
        out,
        epochs,
        {},
        precision=precision,
        threads=threads,
        resume=resume,
        tensorboard=tensorboard,
    ) as run:
        card = train_doornet(
            datasets,
            Teachers.in_folder(teachers),
            chosen,
            out,
            hold_out=fold,
            report=None if report is None else report - 1,
            marks=marks,
            calibration=calibration,
            init=init,
            resume=resume,
            precision=precision,
            watcher=run.watcher,
            team=run.team,
            command=run.facts["command"],
        )
        if run.team.leads:
            _say_written("doornet", out, card)


@app.command()
def limits(
    folder: Annotated[Path, typer.Argument(help="Folder of a training with --hold-out.")],
    dataset: Annotated[Path, typer.Argument(help="Photographs with doorways.csv.")],
    split: Annotated[str, typer.Option(metavar="K/N", help="The fold that was held out.")],
) -> None:
    """Choose the limits of the opening method for a trained doornet, on its held-out places."""
    from doorway3ds.lab.train.doornet.tune import tune_run

    found = tune_run(folder, dataset, split, lambda line: typer.echo(line, err=True))
    typer.echo(f"{folder / 'doornet.onnx'} now carries {found}")


@app.command("cnn-srin")
def cnn_srin(
    dataset: Annotated[
        Path, typer.Argument(help="Folder with no-door/ and open-door/, or a CSV: image, class.")
    ],
    out: TrainOut = Path("runs/cnn-srin"),
    epochs: Epochs = 20,
    learning_rate: Rate = 1e-3,
    batch: Batch = 32,
    weights: Weights = "imagenet",
    copies: Annotated[
        int, typer.Option(min=0, help="Augmented copies of each training picture.")
    ] = 0,
    fine_tune: Annotated[
        int, typer.Option(min=0, metavar="EPOCHS", help="Then train VGG16's top block, too.")
    ] = 0,
    validation: Validation = 0.2,
    patience: Patience = 0,
    group: Group = "auto",
    group_pattern: Pattern = None,
    places: PlacesFile = None,
    half_open: HalfOpen = "leave-out",
    layout: EvalLayout = None,
    limit: PerClass = None,
    seed: int = 0,
    precision: Precision = "auto",
    licence: Licence = None,
    install: Install = True,
    tensorboard: Board = False,
    resume: Resume = False,
    threads: TrainThreads = None,
) -> None:
    """Train the paper's classifier on pictures with and without an open doorway."""
    from doorway3ds.lab.datasets.doors import read_door_pictures
    from doorway3ds.lab.datasets.places import Choice
    from doorway3ds.lab.datasets.readers import read_places
    from doorway3ds.lab.train.paper.srinrun import SrinOptions, SrinTraining

    options = SrinOptions(
        epochs,
        learning_rate,
        batch,
        weights,
        validation,
        patience,
        seed,
        precision,
        copies=copies,
        fine_tune=fine_tune,
    )
    with running(
        out,
        epochs + fine_tune,
        {"data": str(dataset), "licence": licence},
        precision=precision,
        threads=threads,
        resume=resume,
        tensorboard=tensorboard,
    ) as run:
        pictures = read_door_pictures(
            dataset,
            Choice(group, group_pattern, half_open, limit, seed),
            layout=layout,
            places=None if places is None else read_places(places),
            seen=run.seen,
        )
        if run.team.leads:
            say(
                f"{len(pictures.samples)} pictures, {len(set(pictures.groups))} groups by "
                f"{pictures.grouping}; left out: {len(pictures.left_out)}, "
                f"{list(pictures.left_out.values()).count('half open')} of them half open"
            )
        card = SrinTraining(pictures, options, run)()
        if run.team.leads:
            accuracy = card["held_out"]["wilson"]["accuracy"]
            said = (
                f"held-out accuracy {accuracy['value']:.3f} "
                f"({accuracy['low']:.3f} to {accuracy['high']:.3f}, n = {accuracy['n']})"
            )
            _finish("cnn-srin", out, card, said, install)


@app.command()
def densedepth(
    dataset: Annotated[
        Path,
        typer.Argument(help="Folder of pictures with depth, or DenseDepth's own nyu_data.zip."),
    ],
    out: TrainOut = Path("runs/densedepth"),
    unit_m: Annotated[
        float | None,
        typer.Option(metavar="M", help="Metres per count of depth, where the data do not say."),
    ] = None,
    setting: Annotated[
        str, typer.Option(help="nyu: 480x640, 0.1 to 10 m. kitti: 384x1280, 1 to 80 m.")
    ] = "nyu",
    epochs: Epochs = 20,
    learning_rate: Rate = 1e-4,
    batch: Batch = 4,
    weights: Weights = "imagenet",
    freeze_encoder: Annotated[
        bool,
        typer.Option("--freeze-encoder", help="As the paper's text; its code trains it."),
    ] = False,
    augment: Annotated[
        bool, typer.Option("--augment/--no-augment", help="Mirrored, colour channels swapped.")
    ] = True,
    half_decoder: Annotated[
        bool, typer.Option("--half-decoder", help="Half as many filters: the code's own default.")
    ] = False,
    validation: Validation = 0.1,
    patience: Patience = 0,
    group: Group = "auto",
    group_pattern: Pattern = None,
    limit: Annotated[int | None, typer.Option(min=2, help="At most so many pictures.")] = None,
    seed: int = 0,
    precision: Precision = "auto",
    licence: Licence = None,
    install: Install = True,
    tensorboard: Board = False,
    resume: Resume = False,
    threads: TrainThreads = None,
) -> None:
    """Train the paper's depth network (DenseNet-169) on pictures with depth."""
    from doorway3ds.lab.datasets.places import Choice
    from doorway3ds.lab.train.paper.densedepth import SETTINGS
    from doorway3ds.lab.train.paper.depthpairs import read_depth_pairs
    from doorway3ds.lab.train.paper.depthrun import DepthOptions, DepthTraining

    if setting not in SETTINGS:
        raise CallError(f"--setting must be {', '.join(SETTINGS)}, got {setting!r}")
    options = DepthOptions(
        epochs,
        learning_rate,
        batch,
        weights,
        validation,
        patience,
        seed,
        precision,
        setting=setting,
        freeze_encoder=freeze_encoder,
        augment=augment,
        filters=832 if half_decoder else None,
    )
    with running(
        out,
        epochs,
        {"data": str(dataset), "licence": licence},
        precision=precision,
        threads=threads,
        resume=resume,
        tensorboard=tensorboard,
    ) as run:
        if not run.team.leads:
            run.team.told(None)  # until the leader has unpacked what is packed
        pairs = read_depth_pairs(
            dataset,
            SETTINGS[setting],
            Choice(group, group_pattern, limit=limit, seed=seed),
            unit_m=unit_m,
            unpack=out / "data",
            seen=run.seen,
        )
        if run.team.leads:
            run.team.told(None)
            say(
                f"{len(pairs.samples)} pictures, {len(set(pairs.groups))} groups by "
                f"{pairs.grouping}; median depth {pairs.median_m:.2f} m; "
                f"left out: {len(pairs.left_out)}"
            )
        card = DepthTraining(pairs, options, run)()
        if run.team.leads:
            delta1, rmse = (card["held_out"]["metrics"][key]["value"] for key in ("delta1", "rmse"))
            said = f"held out: delta1 {delta1:.3f}, RMSE {rmse:.3f} m"
            # of another size than `3ds look` feeds, a file for KITTI is not installed
            _finish("densedepth", out, card, said, install and setting == "nyu")


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
