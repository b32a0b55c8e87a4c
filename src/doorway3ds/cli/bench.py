"""`3ds bench`: how fast and how large a decision is on this machine."""

from __future__ import annotations

import tempfile
from datetime import datetime
from pathlib import Path
from typing import Any

import typer

from doorway3ds.cli.shared.options import expand
from doorway3ds.decide.options import PACKAGED
from doorway3ds.errors import CallError
from doorway3ds.options import THREADS, setting

RESULTS = Path("benchmarks/results")
PAPER = ("cnn-srin", "densedepth")


@expand
def bench(
    network: list[str] | None = setting(
        None,
        "Network to measure; give it twice to compare two; default: doornet.",
        metavar="NAME[+NAME]",
    ),
    against_paper: bool = setting(
        False,
        "Compare one network with the paper's pair. Untrained files stand in for what is not "
        "installed (needs the extra train).",
    ),
    image: Path | None = setting(None, "Image to decide on; default: a made-up 640x480 JPEG."),
    repeat: int | None = setting(
        None, "Decisions per network; default: 200, with --against-paper 20.", low=3, high=100_000
    ),
    starts: int = setting(5, "Cold starts per network; 0 leaves them out.", low=0, high=1000),
    threads: int | None = setting(None, "CPU threads of the networks; default: all.", **THREADS),
    out: Path = setting(RESULTS, "Folder for the JSON result.", metavar="DIR"),
) -> None:
    """Measure latency by stage, cold start and peak memory; two networks also as a ratio.

    The networks take turns, image by image, so that other load on the machine affects both alike.

    Example: 3ds bench --repeat 50
    """
    networks = network or [PACKAGED]
    if len(networks) > (1 if against_paper else 2):
        allowed = "once with --against-paper" if against_paper else "once or twice"
        raise CallError(f"--network may be given {allowed}, got {len(networks)} times")
    if repeat is None:
        repeat = 20 if against_paper else 200

    from doorway3ds.files import write_json
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
        "ratios": [benchmark.ratio(other, results[-1]) for other in results[:-1]],
    }
    name = f"{datetime.now():%Y-%m-%d-%H%M%S}.json"
    path = write_json(out / name, report, 2)
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
