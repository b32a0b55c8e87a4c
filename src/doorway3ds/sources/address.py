"""A source's URI: its parts and options, and how it may be shown."""

from __future__ import annotations

import re
from typing import Any
from urllib.parse import SplitResult, parse_qsl, urlsplit, urlunsplit

from doorway3ds.arguments import require_number
from doorway3ds.errors import CallError


def without_password(uri: str) -> str:
    """The URI as it may be shown: a password in it becomes ***."""
    try:
        parts = urlsplit(uri)
    except ValueError as error:
        shown = re.sub(r"//[^/]*@", "//***@", uri)
        raise CallError(f"{shown} is not an address: {error}") from error
    if parts.password is None:
        return uri
    user, _, host = parts.netloc.rpartition("@")
    shown = f"{user.partition(':')[0]}:***@{host}"
    return urlunsplit((parts.scheme, shown, parts.path, parts.query, parts.fragment))


def query(uri: str, kinds: dict[str, type]) -> tuple[SplitResult, dict[str, Any]]:
    """The URI's parts, and its ?name=value options converted; CallError for any other, and
    for a number that is negative or not finite."""
    parts = urlsplit(uri)
    found: dict[str, Any] = {}
    for key, value in parse_qsl(parts.query, keep_blank_values=True):
        if key not in kinds:
            raise CallError(f"{uri}: no option {key!r}; expected {', '.join(kinds) or 'none'}")
        try:
            found[key] = kinds[key](value)
        except ValueError as error:
            wanted = {int: "a whole number", float: "a number"}.get(kinds[key], "another value")
            raise CallError(f"{uri}: {key} must be {wanted}, got {value!r}") from error
        if kinds[key] is not str:
            require_number(f"{uri}: {key}", found[key], 0, 1e9)
    return parts, found
