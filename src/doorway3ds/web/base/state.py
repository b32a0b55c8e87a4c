"""What the routes of one server share, whatever the server is for."""

from __future__ import annotations

import asyncio
import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import cast

from fastapi import Request

from doorway3ds.draw.reasons import reasons_html
from doorway3ds.web.base.access import ServerSettings
from doorway3ds.web.base.metrics import Metrics
from doorway3ds.web.base.work import Work

_KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".jpg": "image/jpeg",
    ".webmanifest": "application/manifest+json",
}

_INCLUDE = re.compile(rb"<!--#include (\w+\.html)-->")


@dataclass(frozen=True)
class Asset:
    data: bytes
    kind: str
    etag: str


class Assets:
    """The files of `web/static` by name, read once: no request's path reaches the file system.

    In a page `<!--#include NAME-->` stands for what pages share, a file whose name begins with _,
    and _reasons.html for docs/reasons.md.
    """

    def __init__(self) -> None:
        found = {
            f.name: f.read_bytes() for f in files("doorway3ds.web").joinpath("static").iterdir()
        }
        found["_reasons.html"] = reasons_html().encode()
        self._assets = {}
        for name, data in found.items():
            kind = _KINDS.get("." + name.rpartition(".")[2])
            if kind is not None and not name.startswith("_"):
                data = _INCLUDE.sub(lambda include: found[include[1].decode()].strip(), data)
                etag = f'"{hashlib.sha256(data).hexdigest()[:16]}"'
                self._assets[name] = Asset(data, kind, etag)

    def get(self, name: str) -> Asset | None:
        return self._assets.get(name)

    def __getitem__(self, name: str) -> Asset:
        return self._assets[name]


class ServerState:
    """What every server holds while it runs.

    home: the file of `web/static` that `/` shows. gauges: further numbers for /metrics, name ->
    (help, value). closing: set when the server is to end, so that streams do.
    """

    def __init__(
        self,
        settings: ServerSettings,
        home: str,
        gauges: Mapping[str, tuple[str, Callable[[], float]]] | None = None,
    ) -> None:
        limits = settings.limits
        self.access = settings
        self.home = home
        self.work = Work(limits.in_flight, settings.workers, limits.decision_s)
        self.assets = Assets()
        self.closing = asyncio.Event()
        at_hand = ("Decisions that run or wait.", lambda: self.work.in_flight)
        self.metrics = Metrics({"doorway3ds_in_flight": at_hand, **(gauges or {})})

    def begin(self) -> None:
        """Starts what goes on by itself; called in the event loop."""

    def end(self) -> None:
        """Ends what would otherwise go on for ever, so that the server can stop."""
        self.closing.set()

    def close(self) -> None:
        """Returns once nothing goes on any more."""
        self.work.close()

    @property
    def source_state(self) -> str | None:
        """What the server's source does; None if it has none."""
        return None


def server_state(request: Request) -> ServerState:
    """What the server of a request shares between its routes."""
    return cast(ServerState, request.app.state.server)
