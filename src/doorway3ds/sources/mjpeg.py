"""MJPEG over HTTP, as IP cameras, phones' camera apps and mjpg-streamer send it."""

from __future__ import annotations

import base64
import http.client
import socket
import ssl
import time
from collections.abc import Callable
from urllib.parse import SplitResult, unquote, urljoin, urlsplit

from doorway3ds.errors import CallError, UserError
from doorway3ds.sources.base import Capture, Shot
from doorway3ds.sources.splitter import Splitter
from doorway3ds.sources.uri import without_password

_TIMEOUT_S = 5.0
_CHUNK = 1 << 16
_MOST_REDIRECTS = 3


class MjpegCapture:
    """One request whose answer does not end: pictures are found by their own structure."""

    def __init__(self, url: str) -> None:
        self._splitter = Splitter()
        self._waiting: list[bytes] = []
        for _ in range(_MOST_REDIRECTS + 1):
            parts = urlsplit(url)
            self._connection = _connection(parts)
            try:
                self._answer = _request(self._connection, parts)
                target = self._answer.getheader("Location")
                if not (300 <= self._answer.status < 400 and target):
                    _check(self._answer)
                    return
            except BaseException:
                self.close()
                raise
            self.close()
            url = urljoin(url, target)
            if urlsplit(url).scheme not in ("http", "https"):
                raise UserError(f"it redirects to {url}; expected an http address")
        raise UserError(f"it redirects more than {_MOST_REDIRECTS} times")

    def read(self) -> Shot | None:
        while not self._waiting:
            try:
                chunk = self._answer.read1(_CHUNK)
            except http.client.HTTPException as error:
                raise UserError(f"the stream broke off ({type(error).__name__})") from error
            except TimeoutError as error:
                raise UserError(f"no data for {_TIMEOUT_S:g} s") from error
            if not chunk:
                raise UserError("the stream ended")
            self._waiting = self._splitter.feed(chunk)
        return Shot(self._waiting.pop(0), time.monotonic())

    def close(self) -> None:
        self._connection.close()


def mjpeg(url: str) -> Callable[[], Capture]:
    """Connects to an http:// or https:// address; name and password may stand in it."""
    parts = urlsplit(url)
    try:
        usable = bool(parts.hostname) and (parts.port is None or parts.port > 0)
    except ValueError:
        usable = False
    if not usable:
        raise CallError(f"{without_password(url)}: expected http://HOST[:PORT]/PATH")
    return lambda: MjpegCapture(url)


def _connection(parts: SplitResult) -> http.client.HTTPConnection:
    # Straight to the camera, past any proxy: it would gather pictures instead of passing them on.
    if parts.scheme == "https":
        context = ssl.create_default_context()
        return http.client.HTTPSConnection(
            parts.hostname or "", parts.port, timeout=_TIMEOUT_S, context=context
        )
    return http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=_TIMEOUT_S)


def _request(
    connection: http.client.HTTPConnection, parts: SplitResult
) -> http.client.HTTPResponse:
    headers = {"Accept": "multipart/x-mixed-replace, image/jpeg", "User-Agent": "doorway3ds"}
    if parts.username is not None:
        account = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
        headers["Authorization"] = "Basic " + base64.b64encode(account.encode()).decode()
    path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    try:
        connection.request("GET", path, headers=headers)
        return connection.getresponse()
    except (http.client.HTTPException, UnicodeError) as error:
        raise UserError(f"no HTTP camera answers there ({type(error).__name__})") from error
    except socket.gaierror as error:
        raise UserError(f"no host is called {parts.hostname}") from error
    except TimeoutError as error:
        raise UserError(f"no answer within {_TIMEOUT_S:g} s") from error
    except OSError as error:
        raise UserError(f"{error.strerror or error}") from error


def _check(answer: http.client.HTTPResponse) -> None:
    if answer.status != 200:
        raise UserError(f"it answers {answer.status} {answer.reason}; expected 200")
    kind = answer.getheader("Content-Type", "").partition(";")[0].strip().lower()
    if not kind.startswith("multipart/"):
        raise UserError(f"it sends {kind or 'no type'}; expected multipart/x-mixed-replace (MJPEG)")
