"""What stands before every request, as plain ASGI: headers, who may enter, how much may come."""

from __future__ import annotations

import asyncio
import hmac
import time
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import urlsplit

from doorway3ds.web.base.errors import ApiError
from doorway3ds.web.serve.hall import Entrance
from doorway3ds.web.serve.settings import LOOPBACK_NAMES, Limits

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

COOKIE = "doorway3ds"
_SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
# Told to anybody: load balancers carry no token, and the form that asks for it needs its style.
_OPEN_PATHS = frozenset({"/", "/healthz", "/favicon.ico"})
_OPEN_FOLDER = "/static/"

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

    def __init__(self, app: App, hall: Entrance, routes: frozenset[str]) -> None:
        self.hall = hall
        self._app = app
        self._token = hall.settings.token
        self._limits = hall.settings.limits
        self._metrics = hall.metrics
        self._routes = routes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
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
                self._metrics.count("doorway3ds_refused_total", code=error.code)
                await answer(error, guarded)
                return
            await self._app(scope, _bounded(receive, self._limits, body), guarded)
        except SlowClient:
            self._metrics.count("doorway3ds_refused_total", code="slow_client")
        except Exception:
            # The application has logged it, and answered unless it had begun to.
            if status == 0:
                raise
        finally:
            spent = time.perf_counter() - start
            self._metrics.count("doorway3ds_requests_total", route=route, status=str(status))
            if route != "/v1/stream":
                self._metrics.observe("doorway3ds_request_seconds", spent, route=route)

    def _admit(self, scope: Scope) -> int | None:
        """The length that the request's head announces; ApiError where it may not enter."""
        headers = {
            name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]
        }
        if self._token is None:
            _require_local_name(headers.get("host", ""))
        if scope["method"] not in _SAFE:
            _require_same_origin(headers)
        path = scope["path"]
        is_open = path in _OPEN_PATHS or path.startswith(_OPEN_FOLDER)
        if not is_open and not carries_token(headers, self._token):
            raise ApiError(
                401,
                "unauthorized",
                "expected the server's token: Authorization: Bearer TOKEN, or open the link "
                "that the server printed",
                {"WWW-Authenticate": "Bearer"},
            )
        length = headers.get("content-length")
        if length is None:
            return None
        if not length.isascii() or not length.isdigit():
            raise ApiError(400, "bad_request", "Content-Length must be a number")
        if int(length) > self._limits.max_bytes:
            raise too_large(self._limits)
        return int(length)


def carries_token(headers: Mapping[str, str], token: str | None) -> bool:
    """Whether a request may enter by its Authorization header or its cookie."""
    if token is None:
        return True
    scheme, _, given = headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer" and same(given.strip(), token):
        return True
    try:
        cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return False
    return cookie is not None and same(cookie.value, token)


def same(given: str, token: str) -> bool:
    """Compares in a time that tells nothing of where they differ."""
    return hmac.compare_digest(given.encode("utf-8", "replace"), token.encode())


def _require_local_name(host: str) -> None:
    """Without a token only this machine may ask, and under its own name: a page of another site
    can point a name of its own at 127.0.0.1, but not this one."""
    try:
        name = urlsplit(f"//{host}").hostname
    except ValueError:
        name = None
    if name not in LOOPBACK_NAMES:
        raise ApiError(
            403,
            "wrong_host",
            "without a token this server answers only under localhost, 127.0.0.1 and [::1]; "
            "start it with --token to use another name",
        )


def _require_same_origin(headers: Mapping[str, str]) -> None:
    """A browser says from which page a request comes; only this server's own may post."""
    origin = headers.get("origin")
    if origin is None:
        return
    try:
        netloc = urlsplit(origin).netloc
    except ValueError:
        netloc = ""
    if not netloc or netloc != headers.get("host"):
        raise ApiError(403, "wrong_origin", "requests from pages of other sites are refused")


def too_large(limits: Limits) -> ApiError:
    return ApiError(
        413,
        "too_large",
        f"the body is larger than {limits.max_bytes / 2**20:g} MiB; send a smaller picture",
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
