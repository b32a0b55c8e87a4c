"""MJPEG over HTTP, as IP cameras, phones' camera apps and mjpg-streamer send it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any
from urllib.parse import unquote, urlsplit

import requests
from requests.auth import HTTPDigestAuth
from urllib3.exceptions import HTTPError, ReadTimeoutError

from doorway3ds.errors import CallError, UserError
from doorway3ds.sources.address import without_password
from doorway3ds.sources.base import Capture, Shot
from doorway3ds.sources.splitter import Splitter

_TIMEOUT_S = 5.0
_CHUNK = 1 << 16
_MOST_REDIRECTS = 3
# What a server that has no stream to give sends instead; no type, or an odd one, may be a stream.
_NO_STREAM = ("text/", "image/", "application/json", "application/xml", "application/xhtml")


class MjpegCapture:
    """One request whose answer does not end: images are found by their own structure."""

    def __init__(self, url: str) -> None:
        self._splitter = Splitter()
        self._waiting: list[bytes] = []
        self._images = 0
        self._session = requests.Session()
        # Straight to the camera, past any proxy: it would gather images instead of passing them on.
        self._session.trust_env = False
        self._session.max_redirects = _MOST_REDIRECTS
        self._session.headers.update(
            {"Accept": "multipart/x-mixed-replace, image/jpeg", "User-Agent": "doorway3ds"}
        )
        try:
            self._answer = self._request(url)
            _check(self._answer)
        except BaseException:
            self.close()
            raise

    def _request(self, url: str) -> requests.Response:
        """The answer; the account in the address goes to its own host alone, also if redirected."""
        parts = urlsplit(url)
        bare = parts._replace(netloc=parts.netloc.rpartition("@")[2]).geturl()
        try:
            if parts.username is None:
                return self._get(bare)
            account = unquote(parts.username), unquote(parts.password or "")
            answer = self._get(bare, account)
            asked = answer.headers.get("WWW-Authenticate", "")
            if answer.status_code != 401 or "digest" not in asked.lower():
                return answer
            answer.close()
            return self._get(bare, HTTPDigestAuth(*account))
        except (requests.RequestException, HTTPError, UnicodeError, ValueError) as error:
            raise UserError(_why(error, parts.hostname or "")) from error

    def _get(self, url: str, auth: Any = None) -> requests.Response:
        try:
            return self._session.get(url, auth=auth, stream=True, timeout=_TIMEOUT_S)
        except requests.ConnectionError:
            # A server that ends the connection with its answer, such as a redirect, and does not
            # say so: a further request on that connection may be too late to notice.
            return self._session.get(url, auth=auth, stream=True, timeout=_TIMEOUT_S)

    def read(self) -> Shot | None:
        while not self._waiting:
            try:
                chunk = self._answer.raw.read1(_CHUNK)
            except (TimeoutError, ReadTimeoutError) as error:
                raise UserError(f"no data for {_TIMEOUT_S:g} s") from error
            except HTTPError as error:
                raise UserError(f"the stream broke off ({type(error).__name__})") from error
            if not chunk:
                raise UserError(
                    "the stream ended"
                    if self._images
                    else "the server ends the stream before any image; does it serve others?"
                )
            self._waiting = self._splitter.feed(chunk)
        self._images += 1
        return Shot(self._waiting.pop(0), time.monotonic())

    def close(self) -> None:
        self._session.close()
        if answer := getattr(self, "_answer", None):
            answer.close()


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


def _why(error: Exception, host: str) -> str:
    """What kept the server from answering, in one line without the libraries' names."""
    text = str(error)
    if isinstance(error, requests.TooManyRedirects):
        return f"it redirects more than {_MOST_REDIRECTS} times"
    if isinstance(error, requests.exceptions.InvalidSchema):
        return "it redirects to another kind of address; expected http"
    if isinstance(error, requests.Timeout):
        return f"no answer within {_TIMEOUT_S:g} s"
    if "getaddrinfo" in text or "NameResolution" in text or "Failed to resolve" in text:
        return f"no host is called {host}"
    if isinstance(error, requests.exceptions.SSLError):
        return f"its certificate is not accepted ({text.rpartition('] ')[2].rstrip(')')})"
    cause: BaseException = error
    while cause.__cause__ is not None or cause.__context__ is not None:
        cause = cause.__cause__ or cause.__context__ or cause
    if isinstance(cause, OSError) and cause.strerror:
        return cause.strerror
    return f"no HTTP camera answers there ({type(cause).__name__}: {cause})".replace("\n", " ")


def _check(answer: requests.Response) -> None:
    status = answer.status_code
    if status != 200:
        hint = {401: "a wrong name or password", 503: "is it full?"}.get(status)
        said = f"it answers {status} {answer.reason}; expected 200"
        raise UserError(f"{said} ({hint})" if hint else said)
    kind = answer.headers.get("Content-Type", "").partition(";")[0].strip().lower()
    if kind.startswith(_NO_STREAM):
        raise UserError(f"it sends {kind}; expected multipart/x-mixed-replace (MJPEG)")
