"""The page's files, read once: no request's path reaches the file system."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from importlib.resources import files

_KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".jpg": "image/jpeg",
    ".webmanifest": "application/manifest+json",
}


@dataclass(frozen=True)
class Asset:
    data: bytes
    kind: str
    etag: str


class Assets:
    """The files of `web/static` by name; `get` gives None for any other name."""

    def __init__(self) -> None:
        self._assets = {}
        for file in files("doorway3ds.web").joinpath("static").iterdir():
            kind = _KINDS.get("." + file.name.rpartition(".")[2])
            if kind is not None:
                data = file.read_bytes()
                etag = f'"{hashlib.sha256(data).hexdigest()[:16]}"'
                self._assets[file.name] = Asset(data, kind, etag)

    def get(self, name: str) -> Asset | None:
        return self._assets.get(name)

    def __getitem__(self, name: str) -> Asset:
        return self._assets[name]
