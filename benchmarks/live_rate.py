"""How many decisions a second come from a 640x480 video, and where the time goes?

    python benchmarks/live_rate.py

Makes a film, and measures, each in processes of its own as a user would start them,
- `3ds live FILM --json`: decisions a second and median milliseconds of each stage;
- `3ds serve FILM` with the page closed: decisions a second and mean milliseconds of each stage;
  of both also the processor's milliseconds for a decision, over all threads, which what else the
  machine does changes little;
- in this process: decoding alone, and everything one after the other, without work ahead.
Figures are medians over --repeat runs of each.

The film that is served plays at 120 frames a second, so that its own pace is no limit.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from datetime import datetime
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from films import made_up_film
from serve_load import serving

from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.lab.benchmark import machine
from doorway3ds.live.tracker import Tracker
from doorway3ds.networks import load
from doorway3ds.sources import open_source

RESULTS = Path(__file__).parent / "results"
WARM_UP = 30  # frames
WANTED = 30.0  # decisions a second


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=300, help="of each run of 3ds live")
    parser.add_argument("--seconds", type=float, default=8.0, help="of each look at 3ds serve")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--network", default="doornet")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--out", type=Path, default=RESULTS / "live_rate.json")
    given = parser.parse_args()
    options = ["--network", given.network]
    if given.threads is not None:
        options += ["--threads", str(given.threads)]

    with tempfile.TemporaryDirectory() as folder:
        film = str(made_up_film(Path(folder, "film.mp4")))
        fast = str(made_up_film(Path(folder, "fast.mp4"), 120.0, 10.0))
        # Turn about, so that what else the machine does falls on all alike.
        runs: dict[str, list[dict[str, Any]]] = {"live": [], "serve": [], "in turn": []}
        for _ in range(given.repeat):
            runs["live"].append(live(film, options, given.frames))
            runs["serve"].append(serve(fast, options, given.seconds))
            runs["in turn"].append(in_turn(film, given.network, given.threads, given.frames))
    report = {
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "machine": machine(given.threads),
        "network": given.network,
        "picture": [640, 480],
        "repeat": given.repeat,
        **{name: _joined(parts) for name, parts in runs.items()},
    }
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    for name in runs:
        part = report[name]
        rates = part["per_s"]
        stages = ", ".join(f"{stage} {ms:.1f}" for stage, ms in part["stages_ms"].items())
        print(
            f"{name:8} {rates['median']:6.1f} decisions/s (runs {rates['lowest']:.1f} to "
            f"{rates['highest']:.1f}; wanted {WANTED:g}), "
            f"processor {part['processor_ms']:.1f} ms each; ms: {stages}"
        )
    print(f"written to {given.out}")


def live(film: str, options: list[str], frames: int) -> dict[str, Any]:
    """The command, its lines timed as they come out of the pipe."""
    call = [sys.executable, "-m", "doorway3ds.cli.main", "live", film, "--json", "--loop"]
    call += ["--frames", str(frames + WARM_UP), *options]
    times, lines, cpu_s = [], [], [0.0, 0.0]
    with subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            times.append(time.perf_counter())
            lines.append(line)
            if len(lines) in (WARM_UP + 1, frames + WARM_UP):
                cpu_s = [cpu_s[1], processor_s(process.pid)]
    if process.returncode:
        sys.exit("3ds live failed")
    return {
        "per_s": (frames - 1) / (times[-1] - times[WARM_UP]),
        "processor_ms": 1e3 * (cpu_s[1] - cpu_s[0]) / (frames - 1),
        "stages_ms": _medians([json.loads(line)["timings_ms"] for line in lines[WARM_UP:]]),
    }


def serve(film: str, options: list[str], seconds: float) -> dict[str, Any]:
    """The server with nobody watching, by what its /metrics say before and after."""
    with serving(film, "--loop", *options) as (process, url), httpx.Client(timeout=30) as client:
        time.sleep(2)
        before, begun = _metrics(client, url), time.perf_counter()
        cpu_s = processor_s(process.pid)
        time.sleep(seconds)
        after, spent = _metrics(client, url), time.perf_counter() - begun
        cpu_s = processor_s(process.pid) - cpu_s
    gone = {key: value - before.get(key, 0.0) for key, value in after.items()}
    stage = re.compile(r'doorway3ds_stage_seconds_sum\{stage="(\w+)"\}')
    stages = {m[1]: gone[m[0]] for m in map(stage.fullmatch, gone) if m}
    count = 'doorway3ds_stage_seconds_count{{stage="{}"}}'
    return {
        "per_s": gone["doorway3ds_source_frames"] / spent,
        "processor_ms": 1e3 * cpu_s / gone["doorway3ds_source_frames"],
        "stages_ms": {s: 1e3 * sum_s / gone[count.format(s)] for s, sum_s in stages.items()},
    }


def processor_s(pid: int) -> float:
    """Processor time of a process so far, all its threads; by Linux's /proc."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _metrics(client: httpx.Client, url: str) -> dict[str, float]:
    text = client.get(f"{url}/metrics").text
    pairs = (line.rpartition(" ") for line in text.splitlines() if not line.startswith("#"))
    return {name: float(value) for name, _, value in pairs}


def in_turn(film: str, network: str, threads: int | None, frames: int) -> dict[str, Any]:
    """Read, network, geometry, tracker and line one after the other."""
    pipeline, tracker = Pipeline(load(network, threads=threads)), Tracker()
    spent: list[dict[str, float]] = []
    cpu_s = 0.0
    with open_source(film, loop=True) as source:
        for number in range(WARM_UP + frames):
            if number == WARM_UP:
                cpu_s = time.process_time()
            marks = [time.perf_counter()]
            frame = source.read()
            assert frame is not None
            marks.append(time.perf_counter())
            decision = pipeline.decide(frame)
            marks.append(time.perf_counter())
            tracked = tracker.update(decision)
            marks.append(time.perf_counter())
            json.dumps({**decision.to_dict("film"), "tracked": tracked.to_dict()})
            marks.append(time.perf_counter())
            decode, _, track, line = (float(ms) for ms in np.diff(marks) * 1e3)
            steps = {"decode": decode, **decision.timings_ms, "tracker": track, "line": line}
            spent.append({**steps, "total": (marks[-1] - marks[0]) * 1e3})
        cpu_s = time.process_time() - cpu_s
    kept = spent[WARM_UP:]
    return {
        "per_s": 1e3 * len(kept) / sum(step["total"] for step in kept),
        "processor_ms": 1e3 * cpu_s / len(kept),
        "stages_ms": _medians(kept),
    }


def _medians(samples: list[dict[str, float]]) -> dict[str, float]:
    return {key: float(np.median([sample[key] for sample in samples])) for key in samples[0]}


def _joined(parts: list[dict[str, Any]]) -> dict[str, Any]:
    rates = [part["per_s"] for part in parts]
    return {
        "per_s": {
            "median": float(np.median(rates)),
            "lowest": min(rates),
            "highest": max(rates),
            "runs": rates,
        },
        "processor_ms": float(np.median([part["processor_ms"] for part in parts])),
        "stages_ms": _medians([part["stages_ms"] for part in parts]),
    }


if __name__ == "__main__":
    main()
