"""What stands before every request, as plain ASGI: headers, who may enter, how much may come."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from doorway3ds.web.base.access import Access, Limits
from doorway3ds.web.base.errors import ApiError
from doorway3ds.web.base.state import ServerState

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


_ENDLESS = frozenset({"/v1/stream"})
_HEADERS = (
    (
        "content-security-policy",
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        "img-src 'self' data: blob:; media-src 'self' blob:; base-uri 'none'; "
        "form-action 'self'; frame-ancestors 'none'",
    ),
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "DENY"),
    ("referrer-policy", "no-referrer"),
    ("permissions-policy", "camera=(self), microphone=(), geolocation=()"),
    ("cross-origin-opener-policy", "same-origin"),
    ("cross-origin-resource-policy", "same-origin"),
    ("cache-control", "no-store"),
)


class SlowClient(Exception):
    """A client that does not take what it is sent; its connection is given up."""


class Shield:
    """Wraps the application.

    Adds the security headers that an answer does not set itself, counts and times every answer,
    refuses those who may not enter, and bounds what a body may weigh and how long it may take.

    routes: paths that are counted by their own name.
    """

    def __init__(self, app: App, state: ServerState, routes: frozenset[str]) -> None:
        self.state = state
        self._app = app
        self._access = Access(state.access.token)
        self._limits = state.access.limits
        self._metrics = state.metrics
        self._routes = routes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
        if scope["method"] == "HEAD" and scope["path"] not in _ENDLESS:
            # The server below leaves the body out by the request's own method.
            scope = {**scope, "method": "GET"}
        route = scope["path"] if scope["path"] in self._routes else "other"
        start = time.perf_counter()
        status = 0

        async def guarded(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = list(message.get("headers") or ())
                have = {name.lower() for name, _ in headers}
                headers += [
                    (name.encode(), value.encode())
                    for name, value in _HEADERS
                    if name.encode() not in have
                ]
                message = {**message, "headers": headers}
            try:
                await asyncio.wait_for(send(message), self._limits.send_s)
            except TimeoutError:
                raise SlowClient from None

        try:
            try:
                body = self._admit(scope)
            except ApiError as error:
                self._metrics.refused.labels(error.code).inc()
                await answer(error, guarded)
                return
            await self._app(scope, _bounded(receive, self._limits, body), guarded)
        except SlowClient:
            self._metrics.refused.labels("slow_client").inc()
        except Exception:
            # The application has logged it, and answered unless it had begun to.
            if status == 0:
                raise
        finally:
            spent = time.perf_counter() - start
            self._metrics.requests.labels(route, str(status)).inc()
            if route not in _ENDLESS:
                self._metrics.request_seconds.labels(route).observe(spent)

    def _admit(self, scope: Scope) -> int | None:
        """The length that the request's head announces; ApiError if it may not enter."""
        headers = {
            name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]
        }
        self._access.check(scope["method"], scope["path"], headers)
        length = headers.get("content-length")
        if length is None:
            return None
        if not length.isascii() or not length.isdigit():
            raise ApiError(400, "bad_request", "Content-Length must be a number")
        if int(length) > self._limits.max_bytes:
            raise too_large(self._limits)
        return int(length)


def too_large(limits: Limits) -> ApiError:
    return ApiError(
        413,
        "too_large",
        f"the body is larger than {limits.max_bytes / 2**20:g} MiB; send a smaller image",
    )


def _bounded(receive: Receive, limits: Limits, length: int | None) -> Receive:
    """`receive` that raises ApiError once the body is too large or too slow."""
    seen = 0
    complete = length == 0
    deadline: float | None = None

    async def bounded() -> Message:
        nonlocal seen, complete, deadline
        if complete:
            return await receive()
        if deadline is None:
            deadline = time.monotonic() + limits.body_s
        try:
            message = await asyncio.wait_for(receive(), max(deadline - time.monotonic(), 0.001))
        except TimeoutError:
            raise ApiError(
                408,
                "too_slow_body",
                f"the body did not arrive within {limits.body_s:g} s",
                {"Connection": "close"},
            ) from None
        if message["type"] == "http.request":
            seen += len(message.get("body", b""))
            complete = not message.get("more_body", False)
            if seen > limits.max_bytes:
                raise too_large(limits)
        return message

    return bounded


async def answer(error: ApiError, send: Send) -> None:
    """Sends an error without the application."""
    body = error.body()
    headers = {
        "content-type": "application/json",
        "content-length": str(len(body)),
        **error.headers,
    }
    await send(
        {
            "type": "http.response.start",
            "status": error.status,
            "headers": [(k.lower().encode(), v.encode()) for k, v in headers.items()],
        }
    )
    await send({"type": "http.response.body", "body": body})
