"""`3ds sim`: simulated homes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from doorway3ds.errors import UserError

app = typer.Typer(no_args_is_help=True, help="Simulated homes: pictures with exact truth.")


def parse_size(text: str) -> tuple[int, int]:
    """'320x240' as (320, 240)."""
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(p.isdigit() for p in parts):
        raise UserError(f"--size must look like 320x240, got '{text}'")
    width, height = int(parts[0]), int(parts[1])
    if not (32 <= width <= 1024 and 32 <= height <= 768):
        raise UserError(f"--size must be from 32x32 to 1024x768, got {text}")
    return width, height


@app.callback()
def main() -> None:
    """Simulated homes: pictures with exact truth."""


@app.command()
def render(
    out: Annotated[Path, typer.Option(help="Folder to write; a cut run goes on where it stopped.")],
    count: Annotated[int, typer.Option(min=1, help="Pictures.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Other seeds, other homes.")] = 0,
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT of the pictures.")] = "320x240",
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 2,
) -> None:
    """Render pictures of simulated homes with depth, floor and doorways."""
    from rich.console import Console
    from rich.progress import Progress

    from doorway3ds.sim.dataset import render_dataset

    pixels = parse_size(size)
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("pictures", total=count)
        total = render_dataset(out, count, seed, pixels, workers, lambda n: bar.advance(task, n))
    typer.echo(f"{total} pictures in {out}")
