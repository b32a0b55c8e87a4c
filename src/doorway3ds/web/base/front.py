"""The routes of every server, whatever it is for: its page and files, its health, its counters."""

from __future__ import annotations

import json
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request, Response

from doorway3ds import __version__
from doorway3ds.web.base import metrics as counting
from doorway3ds.web.base.errors import ApiError
from doorway3ds.web.base.shield import COOKIE, carries_token, same
from doorway3ds.web.serve import schemas
from doorway3ds.web.serve.hall import Entrance, entrance_of

router = APIRouter()
SharedEntrance = Annotated[Entrance, Depends(entrance_of)]


def json_answer(value: Any, status: int = 200) -> Response:
    """`value` as JSON; a number that is none (nan) is a bug, not an answer."""
    return Response(json.dumps(value, allow_nan=False), status, media_type="application/json")


@router.get("/v1/link.svg", response_class=Response, include_in_schema=False)
async def link_svg(entrance: SharedEntrance) -> Response:
    """The link for other devices as a QR code."""
    from doorway3ds.web.base.links import qr_svg

    if entrance.settings.link is None:
        raise ApiError(404, "no_link", "only this machine reaches this server")
    return Response(qr_svg(entrance.settings.link), media_type="image/svg+xml")


@router.get("/healthz", response_model=schemas.HealthAnswer, responses=schemas.errors(403))
async def healthz(entrance: SharedEntrance) -> Response:
    """Needs no token."""
    state = entrance.state
    well = state in (None, "starting", "running", "ended")
    return json_answer(
        {
            "status": "ok" if well else "degraded",
            "version": __version__,
            "in_flight": entrance.work.in_flight,
            "source": state,
        }
    )


@router.get(
    "/metrics",
    response_class=Response,
    responses={
        **schemas.errors(401, 403),
        200: {"content": {"text/plain": {"schema": {"type": "string"}}}},
    },
)
async def metrics(entrance: SharedEntrance) -> Response:
    """Prometheus' text format."""
    return Response(entrance.metrics.text(), headers={"Content-Type": counting.CONTENT_TYPE})


@router.get("/", include_in_schema=False)
async def page(request: Request, entrance: SharedEntrance, token: str | None = None) -> Response:
    """The page, or the form that asks for the token; the link's token becomes a cookie."""
    expected = entrance.settings.token
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
        return _asset(request, entrance, entrance.home)
    login = entrance.pages["login.html"]
    return Response(login.data, 401, media_type=login.kind)


@router.get("/static/{name}", include_in_schema=False)
async def static(request: Request, entrance: SharedEntrance, name: str) -> Response:
    return _asset(request, entrance, name)


@router.get("/favicon.ico", include_in_schema=False)
async def favicon(request: Request, entrance: SharedEntrance) -> Response:
    return _asset(request, entrance, "favicon.svg")


def _asset(request: Request, entrance: Entrance, name: str) -> Response:
    asset = entrance.pages.get(name)
    if asset is None:
        raise ApiError(404, "not_found", "there is no such file")
    headers = {"ETag": asset.etag, "Cache-Control": "no-cache"}
    if request.headers.get("if-none-match") == asset.etag:
        return Response(status_code=304, headers=headers)
    return Response(asset.data, media_type=asset.kind, headers=headers)
