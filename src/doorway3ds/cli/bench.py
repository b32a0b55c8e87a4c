"""`3ds bench`: how fast and how large a decision is on this machine."""

from __future__ import annotations

import json
import tempfile
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from doorway3ds.errors import CallError
from doorway3ds.options import require_range

RESULTS = Path("benchmarks/results")
PAPER = ("cnn-srin", "densedepth")


def bench(
    network: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME[+NAME]", help="Up to two, side by side; default doornet."),
    ] = None,
    against_paper: Annotated[
        bool,
        typer.Option(
            "--against-paper",
            help="One network beside the paper's pair; untrained files of the same size stand in "
            "for those of the pair that are not installed (needs the extra train).",
        ),
    ] = False,
    image: Annotated[
        Path | None, typer.Option(help="A picture; default: a made-up 640x480 JPEG.")
    ] = None,
    repeat: Annotated[
        int | None,
        typer.Option(help="Decisions per network.  [default: 200; 20 with --against-paper]"),
    ] = None,
    starts: Annotated[int, typer.Option(help="Cold starts per network; 0 leaves them out.")] = 5,
    threads: Annotated[int | None, typer.Option(min=1, help="For the networks.")] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where the JSON result goes.")] = RESULTS,
) -> None:
    """Measure latency by stage, cold start and peak memory; two networks also as a ratio.

    The networks take turns, picture by picture, so that what else the machine does meets both.

    Example: 3ds bench --repeat 50
    """
    networks = network or ["doornet"]
    if len(networks) > (1 if against_paper else 2):
        allowed = "once with --against-paper" if against_paper else "once or twice"
        raise CallError(f"--network may be given {allowed}, got {len(networks)} times")
    if repeat is None:
        repeat = 20 if against_paper else 200
    require_range("--repeat", repeat, 3, 100_000)
    require_range("--starts", starts, 0, 1000)

    from doorway3ds.files import write_bytes
    from doorway3ds.images.codec import read_image
    from doorway3ds.lab import benchmark

    source = benchmark.made_up_jpeg() if image is None else image
    height, width = read_image(source).image.shape[:2]
    data = source if isinstance(source, bytes) else source.read_bytes()
    with tempfile.TemporaryDirectory() as folder:
        if against_paper:
            networks = [_paper_pair(Path(folder)), *networks]
        results = benchmark.measure_decisions(networks, data, repeat, threads)
        for result in results:
            result["process"] = benchmark.measure_starts(result, data, starts) if starts else None
        if against_paper:
            results[0]["name"] = "+".join(PAPER)
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


def _paper_pair(folder: Path) -> str:
    """The paper's two networks for `--network`; what is not installed is made in `folder`."""
    from doorway3ds.networks.registry import find

    parts = []
    for name in PAPER:
        path = find(name).path
        if not path.is_file():
            from doorway3ds.lab.train.paper.convert import write_untrained

            path = folder / f"{name}.onnx"
            write_untrained(name, path)
        parts.append(str(path))
    return "+".join(parts)
