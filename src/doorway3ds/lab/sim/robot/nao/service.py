"""What a virtual NAO's services share."""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable, Collection, Mapping
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    from doorway3ds.lab.sim.robot.nao.robot import VirtualNao

TABLE: dict[str, Any] = yaml.safe_load(
    files(__package__).joinpath("services.yaml").read_text(encoding="utf-8")
)
HEARD: dict[str, Any] = TABLE.pop("memory")
VERSION: str = TABLE["every"]["answers"]["version"]
SERVICES: dict[str, type[Service]] = {}
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


def _named(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    function.__name__ = name
    return function


def _pair(kept: str, value: Any, kind: str) -> dict[str, Callable[..., Any]]:
    """The two calls of what a service keeps."""
    one = value[0] if kind == "one_of" else next(iter(value.values())) if kind == "each" else value
    ask = "is" if isinstance(one, bool) else "get"
    setter, getter = kept.split("/") if "/" in kept else (f"set{kept}", ask + kept)

    def keep(self: Any, *given: Any) -> bool:
        if not given:
            raise RuntimeError(f"{self._name}::{setter} expected a value")
        if kind != "keeps":
            self._one(setter, given[0], value)
        if given[:-1] in _WHOLE:
            self._unset(getter)
        self._set[getter, repr(given[:-1])] = given[-1]
        return True

    def kept_value(self: Any, *given: Any) -> Any:
        usual = one
        if kind == "each":
            usual = value[self._one(getter, given[0] if given else None, value)]
        keys = ((getter, repr(of)) for of in (given, *_WHOLE))
        return next((self._set[key] for key in keys if key in self._set), usual)

    return {setter: _named(setter, keep), getter: _named(getter, kept_value)}


def _calls(name: str) -> dict[str, Callable[..., Any]]:
    """A function for each call that services.yaml lists of a service."""
    about = TABLE.get(name, {})
    calls = _calls(about["like"]) if "like" in about else {}
    for kind in ("keeps", "one_of", "each"):
        for kept, value in about.get(kind, {}).items():
            calls |= _pair(kept, value, kind)
    answers = {**about.get("answers", {}), **dict.fromkeys(about.get("does", "").split())}
    return calls | {call: _named(call, _answer(value)) for call, value in answers.items()}


def _answer(value: Any) -> Callable[..., Any]:
    return lambda self, *given: value


def _bind(cls: type, calls: Mapping[str, Callable[..., Any]]) -> None:
    """What qi binds: public methods, also with optional arguments, and those of the table."""
    for name, call in calls.items():
        if name not in vars(cls):
            setattr(cls, name, call)
    for name, method in list(vars(cls).items()):
        if not inspect.isfunction(method) or name.startswith("__"):
            continue
        if name.startswith("_"):
            method.__qi_signature__ = "DONOTBIND"  # type: ignore[attr-defined]  # as qi.nobind
        elif any(p.default is not p.empty for p in inspect.signature(method).parameters.values()):
            setattr(cls, name, _any_number(name, method))


class Service:
    """Public methods are NAOqi's, by name. Those with optional arguments may be called without.

    name: of the service, which also has the calls of services.yaml; it is then in SERVICES.
    """

    _name = ""

    # Calls run at the same time: stopMove must not wait for moveTo.
    __qi_threading__ = "multi"

    def __init_subclass__(cls, name: str = "") -> None:
        _bind(cls, _calls(name))
        if name:
            cls._name, SERVICES[name] = name, cls

    def __init__(self, nao: VirtualNao) -> None:
        self._nao = nao
        self._set: dict[tuple[str, str], Any] = {}

    def getMethodList(self) -> list[str]:
        """What it can be called for."""
        return sorted(n for n in dir(self) if n[0] != "_" and callable(getattr(self, n)))

    def _unset(self, getter: str) -> None:
        """What a pair of calls keeps is as it was at first."""
        self._set = {key: value for key, value in self._set.items() if key[0] != getter}

    def _one(self, call: str, value: Any, known: Collection[Any]) -> Any:
        """The value, refused if it is none of those known."""
        if value not in tuple(known):
            names = ", ".join(map(str, known))
            raise RuntimeError(f"{self._name}::{call} expected {names}, got {value}")
        return value


_bind(Service, _calls("every"))


class Extractor(Service):
    """A service that works while somebody subscribes to it."""

    _PERIOD_MS = 100

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._subscribed: dict[str, tuple[int, float]] = {}

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


def services(model: str) -> dict[str, type[Service]]:
    """The class of each service of a robot; those that only the table knows are made here."""
    for name, about in TABLE.items():
        if name.startswith("AL") and name not in SERVICES:
            bases = (Extractor if "like" in about else Service,)
            types.new_class(name, bases, {"name": name})
    only = {name: about["only"] for name, about in TABLE.items() if "only" in about}
    return {name: kind for name, kind in SERVICES.items() if only.get(name, model) == model}


def asked(service: Service, call: str, *given: Any) -> Any:
    """A call that only a table names."""
    return getattr(service, call)(*given)


def each(what: str, values: Any, size: int) -> list[Any]:
    """One value for each of `size` joints: as many as those, or one for all."""
    out = list(values) if isinstance(values, list | tuple) else [values] * size
    if len(out) != size:
        raise RuntimeError(f"{what}: expected {size} values, got {len(out)}")
    return out
