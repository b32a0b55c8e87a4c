"""The routes of every server, whatever it is for: its page and files, its health, its counters."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Request, Response
from pydantic import BaseModel, Field

from doorway3ds import __version__
from doorway3ds.web.base.access import COOKIE, carries_token, same
from doorway3ds.web.base.errors import ApiError, errors
from doorway3ds.web.base.metrics import CONTENT_TYPE
from doorway3ds.web.base.state import ServerState, server_state

router = APIRouter()
State = Annotated[ServerState, Depends(server_state)]
SourceState = Literal["starting", "running", "waiting", "ended", "lost", "stopped"]


class HealthAnswer(BaseModel):
    status: Literal["ok", "degraded"] = Field(
        description="degraded: the server answers, its source sends no images."
    )
    version: str
    in_flight: int
    source: SourceState | None


def json_answer(value: Any, status: int = 200) -> Response:
    """`value` as JSON; a number that is none (nan) is a bug, not an answer."""
    return Response(json.dumps(value, allow_nan=False), status, media_type="application/json")


@router.get("/v1/link.svg", response_class=Response, include_in_schema=False)
async def link_svg(state: State) -> Response:
    """The link for other devices as a QR code."""
    from doorway3ds.web.base.links import qr_svg

    if state.access.link is None:
        raise ApiError(404, "no_link", "only this machine reaches this server")
    return Response(qr_svg(state.access.link), media_type="image/svg+xml")


@router.get("/healthz", response_model=HealthAnswer, responses=errors(403))
async def healthz(state: State) -> Response:
    """Needs no token."""
    source = state.source_state
    well = source in (None, "starting", "running", "ended")
    return json_answer(
        {
            "status": "ok" if well else "degraded",
            "version": __version__,
            "in_flight": state.work.in_flight,
            "source": source,
        }
    )


@router.get(
    "/metrics",
    response_class=Response,
    responses={
        **errors(401, 403),
        200: {"content": {"text/plain": {"schema": {"type": "string"}}}},
    },
)
async def metrics(state: State) -> Response:
    """Prometheus' text format."""
    return Response(state.metrics.text(), headers={"Content-Type": CONTENT_TYPE})


@router.get("/", include_in_schema=False)
async def page(request: Request, state: State, token: str | None = None) -> Response:
    """The page, or the form that asks for the token; the link's token becomes a cookie."""
    expected = state.access.token
    if token is not None and expected is not None and same(token, expected):
        answer = Response(status_code=303, headers={"Location": "/"})
        answer.set_cookie(
            COOKIE,
            expected,
            httponly=True,
            samesite="lax",
            secure=request.url.scheme == "https",
        )
        return answer
    if carries_token(dict(request.headers), expected):
        return _asset(request, state, state.home)
    login = state.assets["login.html"]
    return Response(login.data, 401, media_type=login.kind)


@router.get("/docs", include_in_schema=False)
async def docs(request: Request, state: State) -> Response:
    """The API in words, made of /openapi.json."""
    return _asset(request, state, "docs.html")


@router.get("/reasons", include_in_schema=False)
async def reasons(request: Request, state: State) -> Response:
    """What each reason asks one to do."""
    return _asset(request, state, "reasons.html")


@router.get("/static/{name}", include_in_schema=False)
async def static(request: Request, state: State, name: str) -> Response:
    return _asset(request, state, name)


@router.get("/favicon.ico", include_in_schema=False)
async def favicon(request: Request, state: State) -> Response:
    return _asset(request, state, "favicon.svg")


def _asset(request: Request, state: ServerState, name: str) -> Response:
    asset = state.assets.get(name)
    if asset is None:
        raise ApiError(404, "not_found", "there is no such file")
    headers = {"ETag": asset.etag, "Cache-Control": "no-cache"}
    if request.headers.get("if-none-match") == asset.etag:
        return Response(status_code=304, headers=headers)
    return Response(asset.data, media_type=asset.kind, headers=headers)
