"""Options that several commands share, declared once: type, bounds and help."""

from __future__ import annotations

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
