"""Who may enter a server, by token, by the name it is asked under, by the page that asks; and how
much it takes."""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Mapping
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from doorway3ds.web.base.errors import ApiError

LOOPBACK_NAMES = ("localhost", "127.0.0.1", "::1")
COOKIE = "doorway3ds"
_SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
# Told to anybody: load balancers carry no token, and the form that asks for it needs its style.
_OPEN_PATHS = frozenset({"/", "/healthz", "/favicon.ico"})
_OPEN_FOLDER = "/static/"


@dataclass(frozen=True)
class Limits:
    """What one server accepts at most; beyond it answers with an error, never with a queue.

    max_bytes: of a request's body. max_pixels: of an image, by its header, before decoding.
    in_flight: decisions that run or wait to run. uploads: requests whose body is being read.
    streams: clients of /v1/stream. connections: open sockets.
    head_s, body_s, decision_s, send_s: seconds for a request's head to arrive, for its body, for
        a decision with its wait, and for a client to take what it is sent.
    """

    max_bytes: int = 32 * 1024 * 1024
    max_pixels: int = 50_000_000
    in_flight: int = 16
    uploads: int = 32
    streams: int = 32
    connections: int = 512
    head_s: float = 10.0
    body_s: float = 30.0
    decision_s: float = 15.0
    send_s: float = 20.0


@dataclass(frozen=True, kw_only=True)
class ServerSettings:
    """Who may ask a server, and how much.

    token: what every request but /healthz must carry, or None on a loopback address.
    workers: jobs that run at once. link: where others reach the page, with the token, or None.
    """

    token: str | None = None
    workers: int = 2
    link: str | None = None
    limits: Limits = field(default_factory=Limits)


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches `host`."""
    if host in LOOPBACK_NAMES:
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Access:
    """token: what a request must carry, or None: only this machine may ask, by its own name."""

    def __init__(self, token: str | None) -> None:
        self._token = token

    def check(self, method: str, path: str, headers: Mapping[str, str]) -> None:
        """Raises ApiError if a request may not enter; `headers` by lower-case name."""
        if self._token is None:
            _require_local_name(headers.get("host", ""))
        if method not in _SAFE:
            _require_same_origin(headers)
        if path in _OPEN_PATHS or path.startswith(_OPEN_FOLDER):
            return
        if not carries_token(headers, self._token):
            raise ApiError(
                401,
                "unauthorized",
                "expected the server's token: Authorization: Bearer TOKEN, or open the link "
                "that the server printed",
                {"WWW-Authenticate": "Bearer"},
            )


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
