"""Overriding the limits of a stage with those that a network was measured with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

from doorway3ds.errors import UserError

Params = TypeVar("Params")


def override(defaults: Params, values: Mapping[str, Any]) -> Params:
    """`defaults` (a frozen dataclass) with the fields in `values` replaced, nested ones too.

    Raises UserError for what is no object, a name that does not exist or a value that is no number.
    """
    if not is_dataclass(defaults) or isinstance(defaults, type):
        raise TypeError(f"expected a dataclass instance, got {defaults!r}")
    if not isinstance(values, Mapping):
        raise UserError(f"{type(defaults).__name__} must be an object of limits, got {values!r}")
    known = {field.name: getattr(defaults, field.name) for field in fields(defaults)}
    new: dict[str, Any] = {}
    for name, value in values.items():
        if name not in known:
            kind = type(defaults).__name__
            raise UserError(f"{kind} has no limit '{name}'; it has {', '.join(known)}")
        if is_dataclass(known[name]):
            if not isinstance(value, Mapping):
                raise UserError(f"limit '{name}' must be an object of limits, got {value!r}")
            new[name] = override(known[name], value)
        elif value is None or (isinstance(value, (int, float)) and not isinstance(value, bool)):
            new[name] = value
        else:
            raise UserError(f"limit '{name}' must be a number, got {value!r}")
    return replace(defaults, **new)
