"""Images a second and memory of `3ds batch`, by number of worker processes, side by side.

    python benchmarks/batch_rate.py --images 2000 --workers 1 2

Images are links to the examples under as many names. Each count of workers is a whole process,
start included, run in turns; memory is the sum over the process and its workers, sampled four times
a second.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

EXAMPLES = sorted((Path(__file__).resolve().parents[1] / "examples").glob("*.jpg"))


def tree_mb(pid: int) -> float:
    """Resident memory of a process and all below it, in MB (Linux)."""
    total, waiting = 0.0, [pid]
    while waiting:
        one = waiting.pop()
        try:
            status = Path(f"/proc/{one}/status").read_text()
            children = Path(f"/proc/{one}/task/{one}/children").read_text().split()
        except OSError:  # it ended between the two
            continue
        total += next((int(line.split()[1]) for line in status.splitlines() if "VmRSS" in line), 0)
        waiting += map(int, children)
    return total / 1024


def measure(folder: Path, workers: int, network: str) -> tuple[float, float, float]:
    """Seconds of one batch, its highest memory in MB, and that of its first third."""
    with tempfile.TemporaryDirectory() as out:
        call = [sys.executable, "-m", "doorway3ds.cli.main", "batch", str(folder), "--out", out]
        call += ["--network", network]
        start = time.monotonic()
        batch = subprocess.Popen([*call, "--workers", str(workers)], stderr=subprocess.DEVNULL)
        samples = []
        while batch.poll() is None:
            samples.append(tree_mb(batch.pid))
            time.sleep(0.25)
        seconds = time.monotonic() - start
    if batch.returncode:
        sys.exit(f"3ds batch ended with status {batch.returncode}")
    return seconds, max(samples), max(samples[: len(samples) // 3 + 1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=2000)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, os.cpu_count() or 1])
    parser.add_argument("--network", default="doornet")
    parser.add_argument("--repeat", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for index in range(given.images):
            example = EXAMPLES[index % len(EXAMPLES)]
            (folder / f"{index:06d}.jpg").symlink_to(example)
        seconds: dict[int, list[float]] = {workers: [] for workers in given.workers}
        for _ in range(given.repeat):
            for workers in given.workers:
                took, peak, early = measure(folder, workers, given.network)
                seconds[workers].append(took)
                print(
                    f"{workers} workers: {given.images} images in {took:.1f} s, "
                    f"{given.images / took:.1f} a second, at most {peak:.0f} MB "
                    f"({early:.0f} MB in the first third)"
                )
    first = statistics.median(seconds[given.workers[0]])
    for workers in given.workers[1:]:
        ratio = first / statistics.median(seconds[workers])
        print(f"{workers} workers: {ratio:.2f} times the rate of {given.workers[0]}")


if __name__ == "__main__":
    main()
