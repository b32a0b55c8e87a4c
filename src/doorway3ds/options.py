"""Values that a user may set, each declared once: its default, bounds and help.

A group of them is a frozen dataclass of `setting` fields that extends `Options`. The command line
makes its options of these fields; from Python they are ordinary keyword arguments.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

from doorway3ds.errors import CallError


@dataclass(frozen=True)
class Setting:
    """What is known of one value.

    low, high: bounds, both included, of a number. names: of the option; default: the field's own.
    """

    help: str
    low: float | None = None
    high: float | None = None
    metavar: str | None = None
    names: tuple[str, ...] = ()


def setting(
    default: Any,
    help: str,
    *,
    low: float | None = None,
    high: float | None = None,
    metavar: str | None = None,
    names: tuple[str, ...] = (),
) -> Any:
    """A field of a dataclass of options."""
    return field(default=default, metadata={"setting": Setting(help, low, high, metavar, names)})


@dataclass(frozen=True)
class Options:
    """A group of settings, checked when it is made.

    panel: its heading in `--help`.

    Raises CallError for a number outside its bounds.
    """

    panel: ClassVar[str] = "Options"

    def __post_init__(self) -> None:
        values = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        check(type(self), values)


def settings_of(kind: type[Options]) -> dict[str, Setting]:
    """The settings of a group by the names of their fields."""
    return {entry.name: entry.metadata["setting"] for entry in fields(kind)}


def check(
    kind: type[Options], values: Mapping[str, Any], called: Callable[[str], str] = str
) -> None:
    """CallError for the first value outside its bounds; `called` names a field to the user."""
    for name, known in settings_of(kind).items():
        if known.low is not None and known.high is not None:
            require_range(called(name), values[name], known.low, known.high)


def require_range(name: str, value: float | None, low: float, high: float) -> None:
    """CallError if a value is given and not between low and high (so nan is refused, too)."""
    if value is not None and not (math.isfinite(value) and low <= value <= high):
        raise CallError(f"{name} must be a number from {low:g} to {high:g}, got {value:g}")
