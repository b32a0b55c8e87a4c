"""Values that a user may set, each declared once: its default, bounds and help.

A group of them is a frozen dataclass of `setting` fields that extends `Options`. The command line
makes its options of these fields; from Python they are ordinary keyword arguments.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

from doorway3ds.arguments import require_number
from doorway3ds.errors import CallError

MANY = 1_000_000
"""More than anyone counts to."""
SEED = {"low": 0, "high": 2**32 - 1}  # as Keras and NumPy take one
THREADS = {"low": 1, "high": 4096}


@dataclass(frozen=True)
class Setting:
    """What is known of one value.

    low, high: bounds, included, of a number. choices: of a word, if not every one will do.
    names: of the option; default: the field's own. envvar: of the environment, read if the option
    is not given.
    """

    help: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    metavar: str | None = None
    names: tuple[str, ...] = ()
    envvar: str | None = None


def setting(default: Any, help: str, **known: Any) -> Any:
    """A field of a dataclass of options, or a parameter of a command; known: of `Setting`."""
    return field(default=default, metadata={"setting": Setting(help, **known)})


@dataclass(frozen=True)
class Options:
    """A group of settings, checked when it is made.

    panel: its heading in `--help`.

    Raises CallError for a number outside its bounds.
    """

    panel: ClassVar[str] = "Options"

    def __post_init__(self) -> None:
        for name, known in settings_of(type(self)).items():
            check(name, getattr(self, name), known)


def settings_of(kind: type[Options]) -> dict[str, Setting]:
    """The settings of a group by the names of their fields."""
    return {entry.name: entry.metadata["setting"] for entry in fields(kind)}


def check(name: str, value: Any, known: Setting) -> None:
    """CallError for what is out of bounds or no choice; `name`: what the user calls it."""
    if known.choices and value is not None and value not in known.choices:
        raise CallError(f"{name} must be one of {', '.join(known.choices)}, got {value!r}")
    bounded = known.low is not None or known.high is not None
    if bounded or isinstance(value, float):
        require_number(name, value, known.low, known.high, optional=True)
