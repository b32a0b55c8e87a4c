"""NAOqi's Python 2 module over `qi`: ALProxy, ALBroker and ALModule, as old scripts use them.

http://doc.aldebaran.com/2-8/dev/python/naoqi.html

    from naoqi import ALProxy
    motion = ALProxy("ALMotion", "127.0.0.1", 9559)
    number = motion.post.moveTo(0.5, 0.0, 0.0)
    motion.wait(number, 0)

A call raises RuntimeError if the robot answers with an error or is gone.
"""

from __future__ import annotations

import atexit
import inspect
import math
import socket
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from doorway3ds.robots.base import RobotError
from doorway3ds.robots.nao.session import PORT, WHEELS, Call, Naoqi

CONNECT_S = 10.0
_SLICE_MS = 50
_brokers: list[ALBroker] = []
_sessions: dict[tuple[str, int], Naoqi] = {}
_lock = threading.Lock()


def _session(host: str, port: int) -> Naoqi:
    """A session with a robot, shared by all proxies; a new one where the old one is gone."""
    with _lock:
        found = _sessions.get((host, port))
        if found is None or not found.connected:
            found = _sessions[host, port] = _asked(partial(Naoqi, host, port, CONNECT_S))
        return found


@atexit.register
def _end() -> None:
    """Closes every session: one that is left open aborts the interpreter at its end."""
    for broker in list(_brokers):
        broker.shutdown()
    for naoqi in _sessions.values():
        naoqi.close()


def _asked(what: Callable[[], Any]) -> Any:
    try:
        return what()
    except RobotError as error:
        raise RuntimeError(str(error)) from None
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "NAOqi scripts need the qi package: pip install 'doorway3ds[nao]' (it exists for "
            f"{WHEELS})",
            name=error.name,
        ) from None


def _listed(value: Any) -> Any:
    """Lists where `qi` has tuples, and bytes where it has bytearrays: NAOqi knows no others."""
    if isinstance(value, list | tuple):
        return [_listed(v) for v in value]
    return bytes(value) if isinstance(value, bytearray) else value


class ALProxy:
    """A service of a robot; its methods are the service's. Raises RuntimeError if there is none.

    ip, port: of the robot; without them that of the broker.
    """

    def __init__(self, name: str, ip: str | None = None, port: int = PORT) -> None:
        if ip is None and not _brokers:
            raise RuntimeError(
                f"ALProxy('{name}') needs an ip and a port, or an ALBroker before it"
            )
        self._name = name
        self._naoqi = _brokers[-1].naoqi if ip is None else _session(ip, int(port))
        self._calls: dict[int, Call] = {}
        self.post = _Post(self)
        _asked(partial(self._naoqi.service, name))

    def __getattr__(self, method: str) -> Callable[..., Any]:
        if method.startswith("__"):
            raise AttributeError(method)
        return partial(self._call, method)

    def wait(self, number: int, timeout_ms: int = 0) -> bool:
        """Waits for a call of `post`, without end for 0; whether the time ran out."""
        call = self._calls.get(number)
        end_s = time.monotonic() + timeout_ms / 1000 if timeout_ms > 0 else math.inf
        while call is not None and not call.finished(_SLICE_MS):
            if time.monotonic() > end_s:
                return True
        return False

    def isRunning(self, *number: int) -> Any:
        """Of a call of `post`; without a number it is the service's own method."""
        if not number:
            return self._call("isRunning")
        call = self._calls.get(number[0])
        return call is not None and not call.finished()

    def stop(self, *number: int) -> Any:
        """Lets a call of `post` go; without a number it is the service's own method."""
        if not number:
            return self._call("stop")
        call = self._calls.pop(number[0], None)
        return None if call is None else call.cancel()

    def _call(self, method: str, *values: Any) -> Any:
        def ask() -> Any:
            return self._naoqi.begin(self._name, method, *values).result(math.inf)

        return _listed(_asked(ask))

    def _begin(self, method: str, *values: Any) -> int:
        call = _asked(partial(self._naoqi.begin, self._name, method, *values))
        with _lock:
            number = max(self._calls, default=0) + 1
            self._calls[number] = call
        return number


class _Post:
    """Starts calls and does not wait: each returns a number for `wait`, `isRunning`, `stop`."""

    def __init__(self, proxy: ALProxy) -> None:
        self._proxy = proxy

    def __getattr__(self, method: str) -> Callable[..., int]:
        if method.startswith("__"):
            raise AttributeError(method)
        return partial(self._proxy._begin, method)


class ALBroker:
    """A session on which modules are called back, and that proxies without an address use.

    ip, port: where to listen; "0.0.0.0": at the address that faces the robot, and at no other.
    """

    def __init__(
        self, name: str, ip: str = "0.0.0.0", port: int = 0, robot_ip: str = "127.0.0.1",
        robot_port: int = PORT,
    ) -> None:  # fmt: skip
        self.name = name
        self.naoqi: Naoqi = _asked(partial(Naoqi, robot_ip, int(robot_port), CONNECT_S))
        own = _facing(robot_ip, int(robot_port)) if ip in ("", "0.0.0.0") else ip
        _asked(partial(self.naoqi.listen, f"tcp://{own}:{int(port)}"))
        _brokers.append(self)

    def getName(self) -> str:
        return self.name

    def shutdown(self) -> None:
        """Ends the session; modules are no longer called."""
        if self in _brokers:
            _brokers.remove(self)
        self.naoqi.close()


class ALModule:
    """A service of one's own: `ALMemory.subscribeToEvent` calls its methods by name.

    A method is called with as many of the event's name, value and message as it takes.
    """

    def __init__(self, name: str) -> None:
        if not _brokers:
            raise RuntimeError(f"ALModule('{name}') needs an ALBroker before it")
        self._name = name
        methods = {
            method: _trimmed(method, getattr(self, method))
            for method in dir(self)
            if not method.startswith("_") and callable(getattr(self, method))
        }
        self._naoqi = _brokers[-1].naoqi
        self._number = _asked(partial(self._naoqi.register, name, type(name, (), methods)()))

    def getName(self) -> str:
        return self._name

    def exit(self) -> None:
        """Is no longer called."""
        self._naoqi.unregister(self._number)


def _trimmed(name: str, method: Callable[..., Any]) -> Callable[..., Any]:
    """A method of any number of values that hands on as many as `method` takes."""
    takes = inspect.signature(method).parameters.values()
    any_number = any(p.kind is p.VAR_POSITIONAL for p in takes)
    most = len([p for p in takes if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)])

    def call(self: Any, *values: Any) -> Any:
        return method(*(values if any_number else values[:most]))

    call.__name__, call.__doc__ = name, method.__doc__
    return call


def _facing(host: str, port: int) -> str:
    """This computer's address towards another one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect((host, port))  # sends nothing
        return str(probe.getsockname()[0])
