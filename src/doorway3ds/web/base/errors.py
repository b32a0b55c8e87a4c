"""Errors as clients get them, one JSON object each, and as OpenAPI describes them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, Field


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


class ErrorDetail(BaseModel):
    status: int
    code: str = Field(description="For programs.")
    message: str = Field(description="One line for people.")


class ErrorAnswer(BaseModel):
    model_config = ConfigDict(json_schema_extra={"examples": [busy("decisions", 1).to_dict()]})

    error: ErrorDetail


_ERRORS = {
    400: "No image, or one that cannot be read.",
    401: "The token is missing or another.",
    403: "Asked under another name, or from a page of another site.",
    404: "There is nothing here.",
    405: "Another method is expected here.",
    408: "The body came too slowly.",
    409: "Somebody else was first; nothing is changed.",
    413: "The body is too large.",
    415: "Neither an image nor multipart/form-data.",
    422: "A field is wrong.",
    429: "Too much at once; `Retry-After` says when to come back.",
    500: "A bug; the server's log says more.",
    503: "No answer in time.",
}


def errors(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """`responses` of a route for these statuses, each one JSON object."""
    answers: dict[int | str, dict[str, Any]] = {
        status: {"model": ErrorAnswer, "description": _ERRORS[status]} for status in statuses
    }
    for status in {429, 503} & set(statuses):
        answers[status]["headers"] = {
            "Retry-After": {
                "description": "Seconds.",
                "schema": {"type": "integer", "minimum": 1},
            }
        }
    return answers


def file_or(kind: str, about: str, *statuses: int) -> dict[int | str, dict[str, Any]]:
    """`responses` of a route that answers with a file of a media type, or one of `errors`."""
    return {**errors(*statuses), 200: {"content": {kind: {}}, "description": about}}
