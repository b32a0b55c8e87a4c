"""What `3ds serve` bears, measured on a server of its own. The results go to standard output.

python benchmarks/serve_load.py start              cold start to the first decision
python benchmarks/serve_load.py load               one client, eight at once, and too many
python benchmarks/serve_load.py malformed          10,000 damaged pictures and requests
python benchmarks/serve_load.py soak VIDEO         decisions a second and memory over time
"""

from __future__ import annotations

import argparse
import contextlib
import json
import random
import re
import socket
import statistics
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import httpx

from doorway3ds.benchmark import machine, made_up_jpeg

_START_LIMIT_S = 120


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
    """Seconds from the command to the first decision on a picture that is posted at once."""
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


def malformed(arguments: list[str], count: int) -> dict[str, object]:
    """Damaged pictures, bodies, heads and fields; the server must answer all and live on."""
    jpeg, rng = made_up_jpeg(160, 120), random.Random(0)
    statuses: Counter[str] = Counter()
    kinds = (_damaged_picture, _wrong_field, _damaged_multipart, _damaged_http, _hang_up)
    with serving(*arguments) as (process, url):
        before = resident_mb(process.pid)
        with httpx.Client(base_url=url, timeout=60) as client:
            for number in range(count):
                kind = kinds[number % len(kinds)]
                statuses[f"{kind.__name__[1:]} {kind(client, url, jpeg, rng)}"] += 1
            after = client.post("/v1/decide", content=jpeg).status_code
            health = client.get("/healthz").json()
        memory = resident_mb(process.pid)
    return {
        "statuses": dict(sorted(statuses.items())),
        "bugs": sum(n for name, n in statuses.items() if name.endswith(" 500")),
        "after": after,
        "in_flight": health["in_flight"],
        "resident_mb": [round(before, 1), round(memory, 1)],
    }


def _damaged_picture(client: httpx.Client, url: str, jpeg: bytes, rng: random.Random) -> object:
    data = bytearray(jpeg)
    for _ in range(rng.randint(1, 30)):
        data[rng.randrange(len(data))] = rng.randrange(256)
    if rng.random() < 0.4:
        del data[rng.randrange(len(data)) :]
    return client.post("/v1/decide?view=true", content=bytes(data)).status_code


def _wrong_field(client: httpx.Client, url: str, jpeg: bytes, rng: random.Random) -> object:
    name = rng.choice(("method", "network", "camera", "fov_deg", "height_m", "view", "x" * 9))
    value = rng.choice(("", "nan", "-1e309", "\x00", "../../etc/passwd", "9" * 200, "é☃\ud83d"))
    query = {name: value.encode("utf-8", "replace")}
    return client.post("/v1/decide", params=query, content=jpeg).status_code


def _damaged_multipart(client: httpx.Client, url: str, jpeg: bytes, rng: random.Random) -> object:
    body = bytearray(
        b'--x\r\nContent-Disposition: form-data; name="image"; filename="a.jpg"\r\n\r\n'
        + jpeg[:500]
        + b'\r\n--x\r\nContent-Disposition: form-data; name="method"\r\n\r\npaper\r\n--x--\r\n'
    )
    for _ in range(rng.randint(1, 12)):
        body[rng.randrange(len(body))] = rng.randrange(256)
    kind = rng.choice(("multipart/form-data; boundary=x", "multipart/form-data", "multipart/x"))
    answer = client.post("/v1/decide", content=bytes(body), headers={"Content-Type": kind})
    return answer.status_code


def _raw(url: str, data: bytes, wait: bool) -> object:
    parts = urlsplit(url)
    with socket.create_connection((parts.hostname, parts.port), timeout=30) as raw:
        raw.sendall(data)
        if not wait:
            return "gone"
        raw.shutdown(socket.SHUT_WR)
        with contextlib.suppress(ConnectionResetError):
            return raw.recv(65536)[9:12].decode("latin-1") or "closed"
    return "reset"


def _damaged_http(client: httpx.Client, url: str, jpeg: bytes, rng: random.Random) -> object:
    data = bytearray(_head(url, 10) + b"x" * 10)
    for _ in range(rng.randint(1, 8)):
        data[rng.randrange(len(data))] = rng.randrange(256)
    return _raw(url, bytes(data), wait=True)


def _hang_up(client: httpx.Client, url: str, jpeg: bytes, rng: random.Random) -> object:
    return _raw(url, _head(url, len(jpeg)) + jpeg[: rng.randrange(len(jpeg) + 1)], wait=False)


def _head(url: str, length: int) -> bytes:
    host = urlsplit(url).netloc
    head = f"POST /v1/decide HTTP/1.1\r\nHost: {host}\r\nContent-Length: {length}\r\n\r\n"
    return head.encode()


def soak(arguments: list[str], video: str, minutes: float) -> dict[str, object]:
    """A video in a loop, nobody watching: decisions a second and memory, sampled each second."""
    rows: list[tuple[float, float, float]] = []
    with serving(video, "--loop", *arguments) as (process, url), httpx.Client(timeout=30) as client:
        begin, first = time.monotonic(), _frames(client, url)
        while (elapsed := time.monotonic() - begin) < 60 * minutes:
            time.sleep(1)
            rows.append((elapsed, _frames(client, url) - first, resident_mb(process.pid)))
    memory = [row[2] for row in rows]
    half = len(memory) // 2
    return {
        "minutes": minutes,
        "decisions_per_s": round(rows[-1][1] / rows[-1][0], 2),
        "resident_mb_first_half": round(statistics.median(memory[:half]), 1),
        "resident_mb_second_half": round(statistics.median(memory[half:]), 1),
        "samples": [[round(value, 2) for value in row] for row in rows],
    }


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
    parser.add_argument("what", choices=("start", "load", "malformed", "soak"))
    parser.add_argument("video", nargs="?", help="for soak")
    parser.add_argument("--network", default="doornet")
    parser.add_argument("--repeat", type=int, default=100, help="requests of each client; starts")
    parser.add_argument("--count", type=int, default=10_000, help="malformed requests")
    parser.add_argument("--minutes", type=float, default=30, help="of the soak")
    given = parser.parse_args()
    arguments = ["--network", given.network]
    if given.what == "soak":
        if given.video is None:
            parser.error("soak needs a video")
        result = soak(arguments, given.video, given.minutes)
    elif given.what == "malformed":
        result = malformed(arguments, given.count)
    else:
        measure = start if given.what == "start" else load
        result = measure(arguments, min(given.repeat, 10) if measure is start else given.repeat)
    print(json.dumps({"what": given.what, "machine": machine(None), **result}, indent=1))


if __name__ == "__main__":
    main()
