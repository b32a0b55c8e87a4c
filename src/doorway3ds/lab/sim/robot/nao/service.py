"""What a virtual NAO's services share."""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from doorway3ds.lab.sim.robot.nao.robot import VirtualNao

VERSION = "2.8.7.4"
_WHOLE = (("Body",), ("All",))


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


@dataclass(frozen=True)
class Quiet:
    """Calls without an effect, as a table.

    keeps: name -> value until it is set, by `set` and the name; asked for by `get` and the name,
        or `is` for a truth value. Arguments before the last, or those of the question, tell
        several values of a name apart; "Body" and "All" stand for each of them. Another pair of
        calls is named whole, as "mute/isMuted". A tuple holds all values that there may be, the
        first one first; a mapping, a value for each first argument that there may be; a function
        makes the value of the service.
    answers: other calls -> what they answer; does: those that answer nothing.
    extractor: whether modules subscribe to it.
    """

    keeps: Mapping[str, Any] = field(default_factory=dict)
    answers: Mapping[str, Any] = field(default_factory=dict)
    does: str = ""
    extractor: bool = False

    def calls(self) -> dict[str, Callable[..., Any]]:
        """A function for each call."""
        calls: dict[str, Callable[..., Any]] = {}
        for kept, value in self.keeps.items():
            one = next(iter(value.values())) if isinstance(value, Mapping) else value
            ask = "is" if isinstance(one, bool) else "get"
            setter, _, getter = (
                kept.partition("/") if "/" in kept else (f"set{kept}", "", ask + kept)
            )
            calls |= {setter: _keep(setter, getter, value), getter: _kept(getter, value)}
        answers = {**self.answers, **dict.fromkeys(self.does.split())}
        return calls | {call: _answer(call, value) for call, value in answers.items()}

    def service(self, name: str) -> type[Service]:
        """The class of a service that is nothing else."""
        bases = (Extractor if self.extractor else Service,)
        return types.new_class(name, bases, {"quiet": self})


def _keep(setter: str, getter: str, value: Any) -> Callable[..., bool]:
    def keep(self: Any, *given: Any) -> bool:
        if not given:
            raise RuntimeError(f"{type(self).__name__}::{setter} expected a value")
        if isinstance(value, tuple | Mapping):
            self._one(setter, given[0], value)
        if given[:-1] in _WHOLE:
            self._unset(getter)
        self._set[getter, repr(given[:-1])] = given[-1]
        return True

    keep.__name__ = setter
    return keep


def _kept(getter: str, value: Any) -> Callable[..., Any]:
    def kept(self: Any, *given: Any) -> Any:
        usual = value
        if isinstance(value, Mapping):
            usual = value[self._one(getter, given[0] if given else None, value)]
        elif isinstance(value, tuple):
            usual = value[0]
        elif callable(value):
            usual = value(self)
        keys = ((getter, repr(of)) for of in (given, *_WHOLE))
        return next((self._set[key] for key in keys if key in self._set), usual)

    kept.__name__ = getter
    return kept


def _answer(call: str, value: Any) -> Callable[..., Any]:
    def answer(self: Any, *given: Any) -> Any:
        return value(self) if callable(value) else value

    answer.__name__ = call
    return answer


class _Bound:
    """What qi binds: public methods, also with optional arguments, and those of a table."""

    def __init_subclass__(cls, quiet: Quiet | None = None) -> None:
        for name, call in (quiet.calls() if quiet else {}).items():
            if name not in vars(cls):
                setattr(cls, name, call)
        for name, method in list(vars(cls).items()):
            if not inspect.isfunction(method) or name.startswith("__"):
                continue
            if name.startswith("_"):
                method.__qi_signature__ = "DONOTBIND"  # type: ignore[attr-defined]  # as qi.nobind
                continue
            if any(p.default is not p.empty for p in inspect.signature(method).parameters.values()):
                setattr(cls, name, _any_number(name, method))


class Service(_Bound):
    """Public methods are NAOqi's, by name. Those with optional arguments may be called without.

    quiet: further calls, without an effect.
    """

    # Calls run at the same time: stopMove must not wait for moveTo.
    __qi_threading__ = "multi"

    def __init__(self, nao: VirtualNao) -> None:
        self._nao = nao
        self._set: dict[tuple[str, str], Any] = {}

    def ping(self) -> bool:
        return True

    def version(self) -> str:
        return VERSION

    def getBrokerName(self) -> str:
        return "MainBroker"

    def getMethodList(self) -> list[str]:
        """What it can be called for."""
        return sorted(n for n in dir(self) if n[0] != "_" and callable(getattr(self, n)))

    def _unset(self, getter: str) -> None:
        """What a pair of calls keeps is as it was at first."""
        self._set = {key: value for key, value in self._set.items() if key[0] != getter}

    def _one(self, call: str, value: Any, known: Collection[Any]) -> Any:
        """The value, refused if it is none of those known."""
        if value not in tuple(known):
            name = next(name for name, one in self._nao.services.items() if one is self)
            raise RuntimeError(f"{name}::{call} expected {', '.join(map(str, known))}, got {value}")
        return value


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


def asked(service: Service, call: str, *given: Any) -> Any:
    """A call that only a table names."""
    return getattr(service, call)(*given)


def each(what: str, values: Any, size: int) -> list[Any]:
    """One value for each of `size` joints: as many as those, or one for all."""
    out = list(values) if isinstance(values, list | tuple) else [values] * size
    if len(out) != size:
        raise RuntimeError(f"{what}: expected {size} values, got {len(out)}")
    return out
