"""The application: routes, errors and the shield put together."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, cast

from fastapi import APIRouter, FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException

from doorway3ds import __version__
from doorway3ds.errors import UserError
from doorway3ds.web.base import routes
from doorway3ds.web.base.errors import ApiError, invalid
from doorway3ds.web.base.shield import Shield
from doorway3ds.web.base.state import ServerState, server_state
from doorway3ds.web.base.work import ClientGone

log = logging.getLogger(__name__)

_CODES = {404: "not_found", 405: "method_not_allowed"}


def assemble(state: ServerState, *routers: APIRouter, title: str, summary: str) -> Shield:
    """An application of these routes and those that every server has, behind the shield."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        state.begin()
        yield
        state.end()
        await asyncio.to_thread(state.close)

    app = FastAPI(
        title=title,
        summary=summary,
        version=__version__,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
        lifespan=lifespan,
        docs_url=None,  # FastAPI's own loads scripts from elsewhere; base/routes.py has another
        redoc_url=None,
        redirect_slashes=False,
    )
    app.state.server = state
    for router in (*routers, routes.router):
        app.include_router(router)
    _answer_errors(app)
    if state.access.token is not None:
        _ask_for_token(app)
    paths = [getattr(route, "path", "") for r in (*routers, routes.router) for route in r.routes]
    return Shield(app, state, frozenset([*paths, "/openapi.json"]))


def _ask_for_token(app: FastAPI) -> None:
    """Lets the API's description say that it takes a token; made when somebody asks for it."""
    describe = app.openapi

    def described() -> dict[str, Any]:
        schema: dict[str, Any] = describe()
        schemes = schema.setdefault("components", {}).setdefault("securitySchemes", {})
        if "token" not in schemes:
            schemes["token"] = {"type": "http", "scheme": "bearer"}
            for path, operations in schema["paths"].items():
                if path != "/healthz":
                    for operation in operations.values():
                        operation["security"] = [{"token": []}]
        return schema

    app.openapi = described  # type: ignore[method-assign]


def _answer_errors(app: FastAPI) -> None:
    """Every error is one JSON object."""

    async def api(request: Request, error: Exception) -> Response:
        known = cast(ApiError, error)
        server_state(request).metrics.refused.labels(known.code).inc()
        return Response(known.body(), known.status, known.headers, "application/json")

    async def user(request: Request, error: Exception) -> Response:
        return await api(request, ApiError(400, "bad_image", str(error)))

    async def validation(request: Request, error: Exception) -> Response:
        return await api(request, invalid(cast(RequestValidationError, error).errors()))

    async def http(request: Request, error: Exception) -> Response:
        known = cast(HTTPException, error)
        code = _CODES.get(known.status_code, "bad_request")
        headers = dict(known.headers or {})
        return await api(request, ApiError(known.status_code, code, str(known.detail), headers))

    async def gone(request: Request, _: Exception) -> Response:
        return await api(request, ApiError(499, "client_gone", "the client hung up"))

    async def bug(request: Request, error: Exception) -> Response:
        log.error("%s %s failed", request.method, request.url.path, exc_info=error)
        return await api(request, ApiError(500, "bug", "the server failed; see its log"))

    handlers: dict[Any, Any] = {
        ApiError: api,
        UserError: user,
        RequestValidationError: validation,
        HTTPException: http,
        ClientGone: gone,
        Exception: bug,
    }
    for kind, handler in handlers.items():
        app.add_exception_handler(kind, handler)
