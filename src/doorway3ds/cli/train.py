"""`3ds train`: networks from pictures. Needs the extra `train`."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="Train networks from pictures.", no_args_is_help=True)


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
    out: Annotated[Path, typer.Option(help="Folder for checkpoints, logs and the result.")] = Path(
        "runs/doornet"
    ),
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
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="CARD", help="doornet.json of a held-out run, for one on everything."),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Instead of the recipe's.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on after the last stage.")] = False,
    threads: Annotated[int | None, typer.Option(help="CPU threads.  [default: all]")] = None,
) -> None:
    """Train doornet: p_open, opening columns, depth and floor in one network."""
    import os
    from dataclasses import replace

    # the back end is chosen when Keras is first imported
    os.environ["KERAS_BACKEND"] = "torch"
    import keras
    import torch

    from doorway3ds.errors import CallError
    from doorway3ds.evaluate.datasets import parse_split
    from doorway3ds.train.recipe import read_recipe
    from doorway3ds.train.run import Teachers, train_doornet

    keras.config.set_image_data_format("channels_first")
    if threads:
        torch.set_num_threads(threads)
    fold = parse_split(hold_out) if hold_out else None
    if report is not None and (fold is None or not 1 <= report <= fold[1] or report - 1 == fold[0]):
        raise CallError("--report is another fold of those that --hold-out K/N counts")
    chosen = read_recipe(recipe)
    if seed is not None:
        chosen = replace(chosen, fit=replace(chosen.fit, seed=seed))
    card = train_doornet(
        datasets,
        Teachers.in_folder(teachers),
        chosen,
        out,
        hold_out=fold,
        report=None if report is None else report - 1,
        calibration=calibration,
        resume=resume,
        command=shlex.join(["3ds", *sys.argv[1:]]),
    )
    typer.echo(
        f"{out / 'doornet.onnx'}: {card['bytes'] / 1e6:.1f} MB, "
        f"ONNX Runtime and Keras differ by {card['parity']:.1e} of each output's largest value"
    )


@app.command()
def limits(
    folder: Annotated[Path, typer.Argument(help="Folder of a training with --hold-out.")],
    dataset: Annotated[Path, typer.Argument(help="Photographs with doorways.csv.")],
    split: Annotated[str, typer.Option(metavar="K/N", help="The fold that was held out.")],
) -> None:
    """Choose the limits of the opening method for a trained doornet, on its held-out places."""
    from doorway3ds.train.tune import tune_run

    found = tune_run(folder, dataset, split, lambda line: typer.echo(line, err=True))
    typer.echo(f"{folder / 'doornet.onnx'} now carries {found}")
