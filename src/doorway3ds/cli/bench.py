"""`3ds bench`: how fast and how large a decision is on this machine."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from doorway3ds.cli._camera import require_range
from doorway3ds.errors import CallError

RESULTS = Path("benchmarks/results")


def bench(
    network: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME[+NAME]", help="Up to two, side by side; default doornet."),
    ] = None,
    image: Annotated[
        Path | None, typer.Option(help="A picture; default: a made-up 640x480 JPEG.")
    ] = None,
    repeat: Annotated[int, typer.Option(help="Decisions per network.")] = 200,
    starts: Annotated[int, typer.Option(help="Cold starts per network; 0 leaves them out.")] = 5,
    threads: Annotated[int | None, typer.Option(min=1, help="For the networks.")] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where the JSON result goes.")] = RESULTS,
) -> None:
    """Measure latency by stage, cold start and peak memory; two networks also as a ratio.

    The networks take turns, picture by picture, so that what else the machine does meets both.
    """
    networks = network or ["doornet"]
    if len(networks) > 2:
        raise CallError(f"--network may be given once or twice, got {len(networks)} times")
    require_range("--repeat", repeat, 3, 100_000)
    require_range("--starts", starts, 0, 1000)

    from doorway3ds import benchmark
    from doorway3ds.files import write_bytes
    from doorway3ds.images import read_image

    source = benchmark.made_up_jpeg() if image is None else image
    height, width = read_image(source).image.shape[:2]
    data = source if isinstance(source, bytes) else source.read_bytes()
    results = benchmark.measure_decisions(networks, data, repeat, threads)
    for result in results:
        result["process"] = benchmark.measure_starts(result, data, starts) if starts else None
    report: dict[str, Any] = {
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "machine": benchmark.machine(threads),
        "image": {"name": str(image or "made up"), "width": width, "height": height},
        "repeat": repeat,
        "networks": results,
        "ratio": benchmark.ratio(results[0], results[1]) if len(results) == 2 else None,
    }
    name = f"{datetime.now():%Y-%m-%d-%H%M%S}.json"
    path = write_bytes(out / name, (json.dumps(report, indent=2) + "\n").encode())
    typer.echo(benchmark.table(report))
    typer.echo(f"written to {path}")
