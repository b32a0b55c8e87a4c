"""Does `3ds live` hold its rate, and its memory, for as long as one likes?

    python benchmarks/soak_live.py --minutes 30

Runs a 640x480 film at 30 frames a second round and round through source, pipeline and tracker, as
`3ds live --json` does, once as fast as it goes and then paced, and writes samples of resident
memory (RSS), rate and latency as JSON, and as a plot where matplotlib is installed.

--source takes any other source; --method and --network are those of `3ds live`.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from films import made_up_film
from rss import mb_per_hour, plot

from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.lab.benchmark import machine
from doorway3ds.live.feed import Feed
from doorway3ds.live.tracker import Tracker
from doorway3ds.networks import load
from doorway3ds.sources import open_source
from doorway3ds.types import Frame, Perception

RESULTS = Path(__file__).parent / "results"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--source", help="default: a made-up film of 20 s")
    parser.add_argument("--network", default="doornet")
    parser.add_argument("--method", default="opening", choices=("opening", "paper"))
    parser.add_argument("--threads", type=int)
    parser.add_argument("--out", type=Path, default=RESULTS / "soak_live.json")
    given = parser.parse_args()

    with tempfile.TemporaryDirectory() as folder:
        source = given.source or str(made_up_film(Path(folder) / "film.mp4"))
        pipeline = Pipeline(load(given.network, threads=given.threads), method=given.method)
        half = given.minutes * 30
        report = {
            "date": datetime.now().astimezone().isoformat(timespec="seconds"),
            "machine": machine(given.threads),
            "network": pipeline.network.name,
            "method": given.method,
            "source": given.source or "made-up film, 640x480, 30 a second",
            "minutes": given.minutes,
            "fast": soak(source, pipeline, half, pace=False),
            "paced": soak(source, pipeline, half, pace=True),
        }
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    for name in ("fast", "paced"):
        part = report[name]
        print(
            f"{name}: {part['per_s']:.1f} decisions/s, {part['skipped']} of "
            f"{part['decisions'] + part['skipped']} frames skipped, median {part['median_ms']:.1f} "
            f"ms, 95th percentile {part['p95_ms']:.1f} ms; RSS {part['rss_mb'][0]:.0f} to "
            f"{part['rss_mb'][-1]:.0f} MB, {part['mb_per_hour']:+.1f} MB an hour in the second "
            f"half"
        )
    plot(
        given.out.with_suffix(".png"),
        f"3ds live, {report['network']}",
        {
            f"{name}, {report[name]['per_s']:.0f} decisions/s": (
                report[name]["at_s"],
                report[name]["rss_mb"],
            )
            for name in ("fast", "paced")
        },
    )
    print(f"written to {given.out}")


def soak(uri: str, pipeline: Pipeline, seconds: float, pace: bool) -> dict[str, Any]:
    """Decides for that long; a sample every hundredth of it, every second at least."""
    tracker = Tracker()
    times: list[float] = []
    rss: list[float] = []
    took = np.full(100_000, np.nan)  # of fixed size: nothing here may grow with the hours
    every = max(seconds / 100, 1.0)

    def see(frame: Frame, name: str) -> tuple[Frame, str, Perception]:
        return frame, name, pipeline.perceive(frame)

    with (
        open_source(uri, loop=True, pace=pace) as source,
        Feed(source, see, ahead=1 if pace else 2) as feed,
        Path(os.devnull).open("w") as sink,
    ):
        start = last = time.monotonic()
        decisions = 0
        while (now := time.monotonic()) - start < seconds:
            if now - last >= every or not times:
                times.append(now - start)
                rss.append(resident_mb())
                last = now
            seen = feed.read(1.0)
            if seen is None:
                continue
            frame, name, perception = seen
            begun = time.perf_counter()
            tracked = tracker.update(pipeline.conclude(frame, perception))
            line = {**tracked.raw.to_dict(name), "tracked": tracked.to_dict()}
            sink.write(json.dumps(line) + "\n")
            spent = (time.perf_counter() - begun) * 1e3
            took[decisions % took.size] = spent + sum(perception.timings_ms.values())
            decisions += 1
        seconds = time.monotonic() - start
        skipped = source.skipped
    return {
        "per_s": decisions / seconds,
        "decisions": decisions,
        "skipped": skipped,
        "median_ms": float(np.nanmedian(took)),
        "p95_ms": float(np.nanquantile(took, 0.95)),
        "mb_per_hour": mb_per_hour(times, rss),
        "at_s": times,
        "rss_mb": rss,
    }


def resident_mb() -> float:
    """Of this process, by Linux's /proc."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


if __name__ == "__main__":
    main()
