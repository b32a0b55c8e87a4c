"""A connection to NAOqi by the `qi` package, in which no call can hang.

Every call is made asynchronously and waited for in short slices, so that Ctrl-C, a lost session
and the call's own deadline are noticed within a twentieth of a second.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any
from urllib.parse import urlsplit

from doorway3ds.errors import CallError
from doorway3ds.robots.base import RobotError, RobotLost

PORT = 9559
_SLICE_MS = 50


def address(uri: str) -> tuple[str, int]:
    """Host and port of nao://host[:port]; CallError for anything else."""
    parts = urlsplit(uri)
    try:
        host, port = parts.hostname, parts.port or PORT
    except ValueError as error:
        raise CallError(f"{uri}: the port must be a number from 1 to 65535") from error
    if parts.scheme != "nao" or not host:
        raise CallError(f"expected nao://HOST or nao://HOST:PORT, got {uri}")
    return host, port


class Call:
    """A call under way."""

    def __init__(self, future: Any, what: str, session: Any) -> None:
        self._future, self._what, self._session = future, what, session

    def finished(self, wait_ms: int = 0) -> bool:
        import qi

        return bool(self._future.wait(wait_ms) != qi.FutureState.Running)

    def cancel(self) -> None:
        """Asks for its end, which a robot may not heed."""
        self._future.cancel()

    def result(self, timeout_s: float) -> Any:
        """The call's value.

        Raises RobotLost if the session ended or no answer came in time, RobotError if the
        robot answered with an error.
        """
        deadline = time.monotonic() + timeout_s
        while not self.finished(_SLICE_MS):
            if self._session is not None and not self._session.isConnected():
                raise RobotLost(f"{self._what}: the connection is gone")
            if time.monotonic() > deadline:
                self._future.cancel()
                raise RobotLost(f"{self._what} did not answer within {timeout_s:g} s")
        if not self._future.hasError(0):
            return self._future.value(0)
        reason = _first_line(self._future.error())
        if self._session is not None and not self._session.isConnected():
            raise RobotLost(f"{self._what}: {reason}")
        raise RobotError(f"{self._what}: {reason}")


WHEELS = "Python 3.10 to 3.12 on Linux x86-64 and Python 3.12 on macOS with Apple silicon"
"""What the `qi` package can be installed on."""


class Naoqi:
    """One session. timeout_s: for each call that does not say otherwise.

    Raises RobotLost if the robot cannot be reached, ModuleNotFoundError without `qi`.
    """

    def __init__(self, host: str, port: int = PORT, timeout_s: float = 5.0) -> None:
        import qi

        qi.logging.setLevel(qi.logging.FATAL)  # what goes wrong is said in our own lines
        self.name = f"{host}:{port}"
        self.timeout_s = timeout_s
        self._session = qi.Session()
        self._services: dict[str, Any] = {}
        self._lock = threading.Lock()
        self._links: list[tuple[Any, int, Any]] = []
        future = self._session.connect(f"tcp://{host}:{port}", _async=True)
        try:
            Call(future, f"connecting to {self.name}", None).result(timeout_s)
        except RobotError as error:
            raise RobotLost(
                f"no NAOqi answers at {host}:{port} ({error}); is the robot on and in this network?"
            ) from error

    @property
    def connected(self) -> bool:
        return bool(self._session.isConnected())

    def service(self, name: str) -> Any:
        """A service's proxy; RobotError if the robot has none of that name."""
        with self._lock:
            if name not in self._services:
                future = self._session.service(name, _async=True)
                try:
                    self._services[name] = Call(future, name, self._session).result(self.timeout_s)
                except RobotLost:
                    raise
                except RobotError as error:
                    raise RobotError(f"the robot {self.name} has no service {name}") from error
            return self._services[name]

    def begin(self, service: str, method: str, *values: Any) -> Call:
        """Starts a call and does not wait."""
        what = f"{service}.{method}"
        proxy = self.service(service)
        if not self.connected:
            raise RobotLost(f"{what}: the connection is gone")
        try:
            return Call(getattr(proxy, method)(*values, _async=True), what, self._session)
        except AttributeError as error:
            raise RobotError(f"the robot {self.name} has no {what}") from error
        except RuntimeError as error:
            raise RobotLost(f"{what}: {_first_line(str(error))}") from error

    def call(self, service: str, method: str, *values: Any, timeout_s: float | None = None) -> Any:
        """Calls and waits."""
        wait_s = self.timeout_s if timeout_s is None else timeout_s
        return self.begin(service, method, *values).result(wait_s)

    def on(self, events: Iterable[str], react: Callable[[str, Any], None]) -> None:
        """Calls `react(event, value)`, in a thread of qi's, for events of ALMemory."""
        for event in events:
            subscriber = self.call("ALMemory", "subscriber", event)
            link = subscriber.signal.connect(partial(react, event))
            # The subscriber lives as long as it is held.
            self._links.append((subscriber, link, event))

    def listen(self, url: str) -> None:
        """Lets the robot call what is registered here; RobotError if that cannot be."""
        try:
            self._session.listen(url)
        except RuntimeError as error:
            raise RobotError(f"cannot listen at {url}: {_first_line(str(error))}") from error

    def register(self, name: str, service: Any) -> int:
        """Offers a service on the robot's session; returns its number."""
        try:
            return int(self._session.registerService(name, service))
        except RuntimeError as error:
            raise RobotError(f"{name} cannot be registered: {_first_line(str(error))}") from error

    def unregister(self, number: int) -> None:
        self._session.unregisterService(number)

    def close(self) -> None:
        """Ends the session; may be called twice."""
        links, self._links = self._links, []
        if self.connected:
            for subscriber, link, _ in links:
                subscriber.signal.disconnect(link, _async=True)
        self._services.clear()
        future = self._session.close(_async=True)
        if hasattr(future, "wait"):
            future.wait(1000)


def _first_line(text: str) -> str:
    """A NAOqi error without the traceback and module path that it drags along."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[0].removeprefix("RuntimeError: ") if lines else "no reason given"
