"""What `3ds serve` bears, measured on a server of its own. The results go to standard output.

python benchmarks/serve_load.py start              cold start to the first decision
python benchmarks/serve_load.py load               one client, eight at once, and too many
python benchmarks/serve_load.py soak [VIDEO]       decisions a second and memory over time, as
                                                   JSON and a plot beside it (--out)
"""

from __future__ import annotations

import argparse
import contextlib
import json
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import httpx
from films import made_up_film
from rss import mb_per_hour, plot

from doorway3ds.lab.benchmark import machine, made_up_jpeg

RESULTS = Path(__file__).parent / "results"


@contextlib.contextmanager
def serving(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A server in a process of its own, and its address."""
    call = [sys.executable, "-m", "doorway3ds.cli.main", "serve", *arguments, "--port", "0"]
    process = subprocess.Popen(call, stdout=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline() if process.stdout else ""
        if not line.startswith("serving "):
            sys.exit("the server did not start")
        yield process, line.split()[1].rstrip("/")
    finally:
        process.terminate()
        process.wait(timeout=60)


def resident_mb(pid: int) -> float:
    found = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())
    return int(found[1]) / 1024 if found else float("nan")


def start(arguments: list[str], repeat: int) -> dict[str, object]:
    """Seconds from the command to the first decision on an image that is posted at once."""
    jpeg, seconds = made_up_jpeg(), []
    for _ in range(repeat + 1):
        begin = time.perf_counter()
        with serving(*arguments) as (_, url):
            httpx.post(f"{url}/v1/decide", content=jpeg, timeout=30).raise_for_status()
            seconds.append(time.perf_counter() - begin)
    return {"first_decision_s": _spread(seconds[1:])}  # the first fills the disk cache


def load(arguments: list[str], repeat: int) -> dict[str, object]:
    """Latency of one client, of eight at once, and what happens to sixty-four."""
    jpeg = made_up_jpeg()
    with serving(*arguments) as (process, url):
        _post_many(url, jpeg, 1, 20)
        alone, _ = _post_many(url, jpeg, 1, repeat)
        eight, statuses = _post_many(url, jpeg, 8, repeat)
        _, crowd = _post_many(url, jpeg, 64, max(repeat // 10, 5))
        memory = resident_mb(process.pid)
        after = httpx.post(f"{url}/v1/decide", content=jpeg, timeout=30).status_code
    return {
        "alone_ms": _spread(alone),
        "eight_ms": _spread(eight),
        "eight_statuses": dict(statuses),
        "ratio_of_medians": round(statistics.median(eight) / statistics.median(alone), 2),
        "sixty_four_statuses": dict(crowd),
        "after": after,
        "resident_mb": round(memory, 1),
    }


def _post_many(
    url: str, jpeg: bytes, clients: int, repeat: int
) -> tuple[list[float], Counter[int]]:
    spent: list[float] = []
    statuses: Counter[int] = Counter()
    ready = threading.Barrier(clients)

    def client() -> None:
        with httpx.Client(timeout=60) as own:
            ready.wait()
            for _ in range(repeat):
                begin = time.perf_counter()
                status = own.post(f"{url}/v1/decide", content=jpeg).status_code
                statuses[status] += 1
                if status == 200:
                    spent.append((time.perf_counter() - begin) * 1e3)

    threads = [threading.Thread(target=client) for _ in range(clients)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return spent, statuses


def soak(arguments: list[str], video: str | None, minutes: float) -> dict[str, object]:
    """A video in a loop, nobody watching: decisions a second and memory, sampled each second."""
    rows: list[tuple[float, float, float]] = []
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(video or _film(folder), "--loop", *arguments) as (process, url),
        httpx.Client(timeout=30) as client,
    ):
        begin, first = time.monotonic(), _frames(client, url)
        while (elapsed := time.monotonic() - begin) < 60 * minutes:
            time.sleep(1)
            rows.append((elapsed, _frames(client, url) - first, resident_mb(process.pid)))
    seconds, decisions, memory = (list(column) for column in zip(*rows, strict=True))
    half = len(memory) // 2
    return {
        "minutes": minutes,
        "decisions_per_s": round(decisions[-1] / seconds[-1], 2),
        "resident_mb_first_half": round(statistics.median(memory[:half]), 1),
        "resident_mb_second_half": round(statistics.median(memory[half:]), 1),
        "mb_per_hour_second_half": round(mb_per_hour(seconds, memory), 2),
        "samples": [[round(value, 2) for value in row] for row in rows],
    }


def _film(folder: str) -> str:
    return str(made_up_film(Path(folder, "film.mp4"), 60.0))


def _keep(result: dict[str, object], out: Path) -> None:
    """The soak's numbers and the plot of its memory."""
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    seconds, _, memory = zip(*result.pop("samples"), strict=True)  # type: ignore[call-overload]
    label = f"{result['decisions_per_s']:.0f} decisions/s, page closed"
    plot(out.with_suffix(".png"), "3ds serve VIDEO", {label: (seconds, memory)})


def _frames(client: httpx.Client, url: str) -> float:
    text = client.get(f"{url}/metrics").text
    return float(re.search(r"^doorway3ds_source_frames (\S+)", text, re.M)[1])  # type: ignore[index]


def _spread(values: list[float]) -> dict[str, float]:
    ordered = sorted(values)
    names = (("median", 0.5), ("p90", 0.9), ("worst", 1.0))
    return {n: round(ordered[min(int(q * len(ordered)), len(ordered) - 1)], 3) for n, q in names}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("what", choices=("start", "load", "soak"))
    parser.add_argument("video", nargs="?", help="for soak; default: a made-up film")
    parser.add_argument("--network", default="doornet")
    parser.add_argument("--repeat", type=int, default=100, help="requests of each client; starts")
    parser.add_argument("--minutes", type=float, default=30, help="of the soak")
    parser.add_argument("--out", type=Path, default=RESULTS / "soak_serve.json", help="of the soak")
    given = parser.parse_args()
    arguments = ["--network", given.network]
    if given.what == "soak":
        result = soak(arguments, given.video, given.minutes)
    else:
        measure = start if given.what == "start" else load
        result = measure(arguments, min(given.repeat, 10) if measure is start else given.repeat)
    date = datetime.now().astimezone().isoformat(timespec="seconds")
    result = {"what": given.what, "date": date, "machine": machine(None), **result}
    if given.what == "soak":
        _keep(result, given.out)
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
