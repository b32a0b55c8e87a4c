"""Options that several commands share, declared once: type, bounds and help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

# reproduce, eval
Network = Annotated[
    str, typer.Option(metavar="NAME[+NAME]", help="See `3ds models`; or an .onnx file.")
]
Mirror = Annotated[
    bool,
    typer.Option("--mirror", help="Average over both mirrorings: steadier, at twice the time."),
]

# Pictures in classes: train, reproduce.
EvalLayout = Annotated[str | None, typer.Option(help="As of `3ds eval`; told if left out.")]
HalfOpen = Annotated[str, typer.Option(help="Half-open doors: leave-out, open or not-open.")]
PlacesFile = Annotated[Path | None, typer.Option(metavar="FILE", help="CSV: image, place.")]
PerClass = Annotated[int | None, typer.Option(min=1, help="At most so many per class.")]

# A training: train, reproduce.
TrainOut = Annotated[Path, typer.Option(help="Folder for checkpoints, logs and the result.")]
Weights = Annotated[
    str,
    typer.Option(
        metavar="imagenet|none|FILE",
        help="First weights: Keras' download, random, or an HDF5 file of Keras 1 or 2.",
    ),
]
Epochs = Annotated[int, typer.Option(min=1)]
Rate = Annotated[float, typer.Option(help="Of Adam.")]
Batch = Annotated[int, typer.Option(min=1, help="Pictures per step.")]
Validation = Annotated[float, typer.Option(min=0.01, max=0.9, help="Share held out.")]
Patience = Annotated[
    int,
    typer.Option(min=0, help="Stop after so many epochs without gain, keep the best; 0: never."),
]
Group = Annotated[
    str,
    typer.Option(
        help="What is never split: auto (places named by the data, else near-duplicates), near, "
        "folder."
    ),
]
Pattern = Annotated[
    str | None, typer.Option(metavar="REGEX", help="Place = its first group, in the file's name.")
]
Precision = Annotated[str, typer.Option(help="auto (bfloat16 on a GPU), float32, bfloat16.")]
Licence = Annotated[str | None, typer.Option(help="Of the pictures; noted on the card.")]
Resume = Annotated[bool, typer.Option("--resume", help="Go on from the checkpoint in --out.")]
TrainThreads = Annotated[int | None, typer.Option(min=1, help="CPU threads.  [default: all]")]
Board = Annotated[
    bool, typer.Option("--tensorboard", help="Write OUT/tensorboard, too, beside the CSV logs.")
]
Install = Annotated[
    bool, typer.Option("--install/--no-install", help="Let `--network` find the file by name.")
]
