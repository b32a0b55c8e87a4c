"""What every server answers, as OpenAPI describes it."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

SourceState = Literal["starting", "running", "waiting", "ended", "lost", "stopped"]


class ErrorDetail(BaseModel):
    status: int
    code: str = Field(description="For programs.")
    message: str = Field(description="One line for people.")


class ErrorAnswer(BaseModel):
    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "error": {
                        "status": 429,
                        "code": "busy",
                        "message": "too many decisions at once; try again in 1 s",
                    }
                }
            ]
        }
    )

    error: ErrorDetail


class HealthAnswer(BaseModel):
    status: Literal["ok", "degraded"] = Field(
        description="degraded: the server answers, its source gives no pictures."
    )
    version: str
    in_flight: int
    source: SourceState | None


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
