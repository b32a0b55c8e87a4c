from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests import factories
from tests.factories import encode, scene

_NEEDED = (
    "fastapi",
    "uvicorn",
    "python_multipart",
    "httpx",
    "prometheus_client",
    "segno",
    "cryptography",
)
collect_ignore_glob = [] if all(find_spec(name) for name in _NEEDED) else ["test_*.py"]

if not collect_ignore_glob:
    import httpx

    from doorway3ds.decide.options import DecideOptions
    from doorway3ds.sources.base import Source
    from doorway3ds.web.base.access import Limits
    from doorway3ds.web.base.run import listen, make_server
    from doorway3ds.web.base.shield import Shield
    from doorway3ds.web.base.tls import Certificate
    from doorway3ds.web.serve.app import create_app
    from doorway3ds.web.serve.fields import Settings
    from doorway3ds.web.serve.state import ServeState


@dataclass(frozen=True)
class Served:
    """A server that runs in a thread of this process, and a client for it."""

    url: str
    port: int
    state: ServeState
    client: httpx.Client
    stop: Callable[[], None]


Serve = Callable[..., Served]


@pytest.fixture(scope="session")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A door from 0.2 to 0.4 of every picture's width: about 13 degrees to the left."""
    return factories.doornet(tmp_path_factory.mktemp("nets") / "net.onnx", left=0.2, right=0.4)


@pytest.fixture(scope="session")
def photo() -> bytes:
    return encode(scene(160, 120))


@pytest.fixture
def serve(network: Path) -> Iterator[Serve]:
    """Starts servers on free ports of this machine; all are stopped at the end."""
    with contextlib.ExitStack() as stack:

        def start(
            source: tuple[str, Callable[[], Source]] | None = None,
            certificate: Certificate | None = None,
            limits: dict[str, float] | None = None,
            **settings: object,
        ) -> Served:
            made = replace(
                Settings(
                    decide=DecideOptions(str(network)), limits=replace(Limits(), **(limits or {}))
                ),
                **settings,
            )
            return stack.enter_context(running(made, source, certificate))

        yield start


@pytest.fixture(scope="session")
def shared(network: Path) -> Iterator[Served]:
    """One server with the default settings for the tests that leave it as it was."""
    with running(Settings(decide=DecideOptions(str(network)))) as served:
        yield served


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Decisions of `serve` wait until this is set."""
    from doorway3ds.web.serve import routes

    gate, look = threading.Event(), routes._look

    def late(*arguments: object) -> object:
        assert gate.wait(60)
        return look(*arguments)

    monkeypatch.setattr(routes, "_look", late)
    yield gate
    gate.set()


@contextlib.contextmanager
def running(
    settings: Settings,
    source: tuple[str, Callable[[], Source]] | None = None,
    certificate: Certificate | None = None,
) -> Iterator[Served]:
    with answering(create_app(settings, source), certificate) as served:
        yield served


@contextlib.contextmanager
def answering(app: Shield, certificate: Certificate | None = None) -> Iterator[Served]:
    """Any application on a free port of this machine."""
    bound = listen("127.0.0.1", 0)
    port = bound.getsockname()[1]
    access = app.state.access
    started = threading.Event()
    server = make_server(app, certificate, started.set)
    thread = threading.Thread(target=lambda: server.run(sockets=[bound]))
    thread.start()
    assert started.wait(60)

    def stop() -> None:
        server.should_exit = True
        thread.join(timeout=30)
        assert not thread.is_alive(), "the server did not end"

    url = f"{'https' if certificate else 'http'}://127.0.0.1:{port}"
    headers = {"Authorization": f"Bearer {access.token}"} if access.token else {}
    with httpx.Client(base_url=url, headers=headers, timeout=60, verify=False) as client:
        try:
            yield Served(url, port, app.state, client, stop)
        finally:
            stop()


def ask_made_up(served: Served, each: int, passed_over: Collection[str] = ()) -> int:
    """Asks each route what its own description allows; returns how many requests were answered
    as described."""
    schemathesis = pytest.importorskip("schemathesis")
    from hypothesis import HealthCheck, Phase, given, settings
    from schemathesis.specs.openapi.checks import positive_data_acceptance

    schema = schemathesis.openapi.from_dict(served.client.get("/openapi.json").json())
    tried = 0
    for found in schema.get_all_operations():
        operation = found.ok()
        if operation.path in passed_over:
            continue

        @given(case=operation.as_strategy())
        @settings(
            max_examples=each,
            deadline=None,
            derandomize=True,
            database=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        def documented(case: object) -> None:
            nonlocal tried
            tried += 1
            # A schema cannot say which bytes are an image, nor which networks there are.
            case.call_and_validate(  # type: ignore[attr-defined]
                base_url=served.url, excluded_checks=[positive_data_acceptance]
            )

        documented()
    return tried


def wait_for(what: Callable[[], object], seconds: float = 30.0) -> object:
    """What `what` gives once it is true."""
    end = time.monotonic() + seconds
    while not (found := what()):
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.02)
    return found
