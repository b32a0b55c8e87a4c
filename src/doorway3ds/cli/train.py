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

    from doorway3ds.evaluate.datasets import parse_split
    from doorway3ds.train.recipe import read_recipe
    from doorway3ds.train.run import Teachers, train_doornet

    keras.config.set_image_data_format("channels_first")
    if threads:
        torch.set_num_threads(threads)
    chosen = read_recipe(recipe)
    if seed is not None:
        chosen = replace(chosen, fit=replace(chosen.fit, seed=seed))
    card = train_doornet(
        datasets,
        Teachers.in_folder(teachers),
        chosen,
        out,
        hold_out=parse_split(hold_out) if hold_out else None,
        calibration=calibration,
        resume=resume,
        command=shlex.join(["3ds", *sys.argv[1:]]),
    )
    typer.echo(
        f"{out / 'doornet.onnx'}: {card['bytes'] / 1e6:.1f} MB, "
        f"ONNX Runtime and Keras differ by {card['parity']:.1e} of each output's largest value"
    )
