"""10,000 malformed requests against a server of its own: none may break it, none may be a 500.

    python benchmarks/serve_fuzz.py

Up to half are made up by schemathesis from the server's own OpenAPI, half of those breaking the
rules that it states, and each answer is held against it; the others are damaged images, fields,
multipart bodies and HTTP heads, and clients that hang up. Counts by kind and status go to standard
output.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import random
import socket
import sys
import tempfile
import time
from collections import Counter
from datetime import datetime
from pathlib import Path
from urllib.parse import urlsplit

import httpx
from films import made_up_film
from serve_load import resident_mb, serving

from doorway3ds.lab.benchmark import machine, made_up_jpeg


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--network", default="doornet")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        # Two images a second: routes about a source have one, and the processor is the requests'.
        film = str(made_up_film(Path(folder, "film.mp4"), 2.0, 10.0))
        result = fuzz([film, "--loop", "--network", given.network], given.count, given.seed)
    date = datetime.now().astimezone().isoformat(timespec="seconds")
    print(json.dumps({"date": date, "machine": machine(None), **result}, indent=1))
    if result["bugs"] or result["undocumented"] or result["after"] != 200:
        sys.exit(1)


def fuzz(arguments: list[str], count: int, seed: int) -> dict[str, object]:
    jpeg, rng = made_up_jpeg(160, 120), random.Random(seed)
    statuses: Counter[str] = Counter()
    kinds = (_damaged_picture, _wrong_field, _damaged_multipart, _damaged_http, _hang_up)
    begin = time.monotonic()
    with serving(*arguments) as (process, url):
        memory = [resident_mb(process.pid)]
        made_up, undocumented = _made_up(url, count // 2, seed)
        memory.append(resident_mb(process.pid))
        with httpx.Client(base_url=url, timeout=60) as client:
            left = count - sum(made_up.values())
            for number in range(left):
                if number % max(left // 4, 1) == 0:
                    memory.append(resident_mb(process.pid))
                kind = kinds[number % len(kinds)]
                statuses[f"{kind.__name__[1:]} {kind(client, url, jpeg, rng)}"] += 1
            after = client.post("/v1/decide", content=jpeg).status_code
            health = client.get("/healthz").json()
        memory.append(resident_mb(process.pid))
    statuses += made_up
    return {
        "requests": sum(statuses.values()),
        "statuses": dict(sorted(statuses.items())),
        "bugs": sum(n for name, n in statuses.items() if name.endswith(" 500")),
        "undocumented": undocumented,
        "after": after,
        "in_flight": health["in_flight"],
        "resident_mb": [round(mb, 1) for mb in memory],
        "took_s": round(time.monotonic() - begin),
    }


def _made_up(url: str, count: int, seed: int) -> tuple[Counter[str], list[str]]:
    """Requests by the API's description, as many for each operation, and what broke its word."""
    import requests
    import schemathesis
    from hypothesis import HealthCheck, Phase, given, settings
    from hypothesis import seed as seeded
    from hypothesis.errors import Unsatisfiable
    from schemathesis.core.failures import Failure, FailureGroup
    from schemathesis.generation import GenerationMode
    from schemathesis.specs.openapi.checks import positive_data_acceptance

    schema = schemathesis.openapi.from_url(f"{url}/openapi.json")
    # A stream has no end.
    operations = [
        found.ok() for found in schema.get_all_operations() if found.ok().path != "/v1/stream"
    ]
    statuses: Counter[str] = Counter()
    broken: dict[str, str] = {}
    session = requests.Session()
    for operation in operations:
        for mode in (GenerationMode.POSITIVE, GenerationMode.NEGATIVE):

            @seeded(seed)
            @given(case=operation.as_strategy(generation_mode=mode))
            @settings(
                max_examples=count // len(operations) // 2,
                deadline=None,
                database=None,
                phases=[Phase.generate],
                suppress_health_check=list(HealthCheck),
            )
            def ask(case: schemathesis.Case) -> None:
                answer = case.call(base_url=url, session=session, timeout=60)
                statuses[f"schemathesis {mode.value} {answer.status_code}"] += 1  # noqa: B023
                try:
                    # A schema cannot say which bytes are an image, nor which networks there are.
                    case.validate_response(answer, excluded_checks=[positive_data_acceptance])
                except (Failure, FailureGroup) as error:
                    broken.setdefault(
                        f"{case.method} {case.path}", " ".join(str(error).split())[:400]
                    )

            # An operation without fields offers nothing to break.
            with contextlib.suppress(Unsatisfiable):
                ask()
    return statuses, [f"{where}: {what}" for where, what in broken.items()]


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


if __name__ == "__main__":
    main()
