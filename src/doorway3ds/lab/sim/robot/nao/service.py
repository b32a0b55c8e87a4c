"""What a virtual NAO's services share."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from doorway3ds.lab.sim.robot.nao.robot import VirtualNao

VERSION = "2.8.7.4"


def returns(signature: str) -> Callable[[Any], Any]:
    """Declares a method's return signature to qi, as `qi.bind` does, without importing it."""

    def mark(method: Any) -> Any:
        method.__qi_name__, method.__qi_signature__ = None, None
        method.__qi_return_signature__ = signature
        return method

    return mark


def _any_number(name: str, method: Callable[..., Any]) -> Callable[..., Any]:
    """A method that leaves optional arguments to the caller, which qi binds only for `*args`."""
    takes = inspect.signature(method)

    def bound(self: Any, *given: Any) -> Any:
        try:
            takes.bind(self, *given)
        except TypeError as error:
            raise RuntimeError(f"{type(self).__name__}::{name} {error}") from error
        return method(self, *given)

    bound.__name__ = name
    return bound


class Service:
    """Public methods are NAOqi's, by name. Those with optional arguments may be called without."""

    # Calls run at the same time: stopMove must not wait for moveTo.
    __qi_threading__ = "multi"

    def __init_subclass__(cls) -> None:
        for name, method in list(vars(cls).items()):
            if not inspect.isfunction(method) or name.startswith("__"):
                continue
            if name.startswith("_"):
                method.__qi_signature__ = "DONOTBIND"  # type: ignore[attr-defined]  # as qi.nobind
                continue
            if any(p.default is not p.empty for p in inspect.signature(method).parameters.values()):
                setattr(cls, name, _any_number(name, method))

    def __init__(self, nao: VirtualNao) -> None:
        self._nao = nao

    def ping(self) -> bool:
        return True

    def version(self) -> str:
        return VERSION

    def getBrokerName(self) -> str:
        return "MainBroker"

    def getMethodList(self) -> list[str]:
        return methods_of(type(self))


class Extractor(Service):
    """A service that works while somebody subscribes to it."""

    _PERIOD_MS = 100

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._subscribed: dict[str, tuple[int, float]] = {}

    @property
    def _running(self) -> bool:
        return bool(self._subscribed)

    def subscribe(self, name: str, period: int = _PERIOD_MS, precision: float = 0.0) -> None:
        self._subscribed[name] = (int(period), float(precision))

    def unsubscribe(self, name: str) -> None:
        self._subscribed.pop(name, None)

    def updatePeriod(self, name: str, period: int) -> None:
        self._subscribed[name] = (int(period), self._subscribed[name][1])

    def updatePrecision(self, name: str, precision: float) -> None:
        self._subscribed[name] = (self._subscribed[name][0], float(precision))

    def getCurrentPeriod(self) -> int:
        return min((period for period, _ in self._subscribed.values()), default=self._PERIOD_MS)

    def getCurrentPrecision(self) -> float:
        return max((precision for _, precision in self._subscribed.values()), default=0.0)

    def getMyPeriod(self, name: str) -> int:
        return self._subscribed[name][0]

    def getMyPrecision(self, name: str) -> float:
        return self._subscribed[name][1]

    def getSubscribersInfo(self) -> list[list[Any]]:
        return [[name, *values] for name, values in self._subscribed.items()]


def methods_of(kind: type) -> list[str]:
    """What a service can be called for."""
    return sorted(n for n in dir(kind) if not n.startswith("_") and callable(getattr(kind, n)))


def each(what: str, values: Any, size: int) -> list[Any]:
    """One value for each of `size` joints: as many as those, or one for all."""
    out = list(values) if isinstance(values, list | tuple) else [values] * size
    if len(out) != size:
        raise RuntimeError(f"{what}: expected {size} values, got {len(out)}")
    return out
