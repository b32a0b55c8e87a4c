"""Errors as clients get them: one JSON object."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


class ApiError(Exception):
    """An answer other than success.

    code: what programs tell errors apart by. message: one line for people. headers: to send along.
    """

    def __init__(
        self, status: int, code: str, message: str, headers: Mapping[str, str] | None = None
    ) -> None:
        super().__init__(message)
        self.status = status
        self.code = code
        self.message = message
        self.headers = dict(headers or {})

    def to_dict(self) -> dict[str, Any]:
        return {"error": {"status": self.status, "code": self.code, "message": self.message}}

    def body(self) -> bytes:
        return json.dumps(self.to_dict()).encode()


def busy(what: str, retry_after_s: int) -> ApiError:
    """429: as much of `what` is going on as the server takes."""
    return ApiError(
        429,
        "busy",
        f"too many {what} at once; try again in {retry_after_s} s",
        {"Retry-After": str(retry_after_s)},
    )


def invalid(errors: Any) -> ApiError:
    """422 with the first of pydantic's errors in one line."""
    first = errors[0]
    where = ".".join(str(part) for part in first["loc"] if part not in ("query", "body"))
    message = str(first["msg"]).removeprefix("Value error, ")
    return ApiError(422, "invalid_field", f"{where}: {message}" if where else message)
