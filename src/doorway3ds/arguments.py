"""Checks of what a caller passes: one line that names the argument, what it must be and what came.

They raise CallError, which is a UserError and a ValueError.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields
from numbers import Integral, Real
from typing import Any

from doorway3ds.errors import CallError

_REAL: Any = Real
_WHOLE: Any = Integral


def require(name: str, value: Any, kind: type | tuple[type, ...], expected: str) -> None:
    """CallError unless the value is of a kind; `expected` completes "`name` must be"."""
    if not isinstance(value, kind):
        raise CallError(f"{name} must be {expected}, got {shown(value)}")


def require_number(
    name: str,
    value: Any,
    low: float | None = None,
    high: float | None = None,
    *,
    whole: bool = False,
    optional: bool = False,
) -> None:
    """CallError unless the value is a finite number, within bounds where there are any.

    whole: it must be an integer. optional: None will do, too.
    """
    if optional and value is None:
        return
    finite = isinstance(value, _WHOLE if whole else _REAL) and abs(value) < math.inf
    if finite and (low is None or value >= low) and (high is None or value <= high):
        return
    if low is None:
        bounds = "" if high is None else f" of at most {high:g}"
    else:
        bounds = f" of at least {low:g}" if high is None else f" from {low:g} to {high:g}"
    kind = "whole number" if whole else "number" if bounds else "finite number"
    raise CallError(f"{name} must be a {kind}{bounds}, got {shown(value)}")


def require_numbers(options: Any) -> None:
    """CallError unless every field of a dataclass of limits is a finite number, 0 or more."""
    for entry in fields(options):
        require_number(entry.name, getattr(options, entry.name), 0)


def require_probability(name: str, value: Any) -> None:
    """CallError unless the value is from 0 to 1, or nan: not known."""
    if not (isinstance(value, Real) and math.isnan(value)):
        require_number(name, value, 0, 1)


def require_pixel(name: str, value: Any) -> None:
    """CallError unless the value is (row, column) of whole numbers, or None."""
    if value is None:
        return
    whole = isinstance(value, Sequence) and len(value) == 2
    if not (whole and all(isinstance(number, Integral) for number in value)):
        raise CallError(f"{name} must be (row, column) or None, got {shown(value)}")


def require_image(name: str, value: Any, *, depths: tuple[int | None, ...] = (3,)) -> None:
    """CallError unless the value is an image, uint8 and not empty.

    depths: channels that it may have; None: an array (H, W).
    """
    import numpy as np

    usable = isinstance(value, np.ndarray) and value.dtype == np.uint8 and value.size > 0
    if usable and value.ndim in (2, 3) and (*value.shape[2:], None)[0] in depths:
        return
    shapes = ["(H, W)" if depth is None else f"(H, W, {depth})" for depth in depths]
    raise CallError(f"{name} must be a uint8 array of shape {listed(shapes)}, got {shown(value)}")


def listed(words: list[str]) -> str:
    """Alternatives in words: "a, b or c"."""
    return " or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def shown(value: Any) -> str:
    """A value in a few words."""
    if hasattr(value, "shape") and hasattr(value, "dtype") and value.shape != ():
        return f"an array of shape {value.shape} and type {value.dtype}"
    if isinstance(value, Real) and not isinstance(value, (bool, Integral)):
        return f"{float(value):g}"
    if value is None or isinstance(value, (bool, Integral, str)):
        text = repr(value)
        return text if len(text) <= 60 else f"{text[:56]}..."
    return f"a {type(value).__name__}"
