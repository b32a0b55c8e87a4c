"""Download with a checksum."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable
from pathlib import Path

from doorway3ds.errors import CallError, UserError
from doorway3ds.files import digest
from doorway3ds.networks import hub
from doorway3ds.networks.registry import find, install, load

TIMEOUT_S = 30


def fetch(
    name: str,
    url: str | None = None,
    sha256: str | None = None,
    licence: str | None = None,
    begin: Callable[[], object] = lambda: None,
) -> Path:
    """Downloads the file of network `name`, checks its SHA-256 and signature, and installs it.

    url, sha256: default: the registry's own, where it has them. A file of the hub stays in the
    hub's cache. begin: called once the call is known to be right, before anything is fetched.

    Raises CallError if there is nothing to fetch or no checksum to hold it to; UserError
    where the address does not answer, or what came is not what was asked for.
    """
    model = find(name)
    if model.packaged:
        raise CallError(f"{name} is packaged; {model.make}")
    if url is None and model.hub is not None:
        begin()
        return _from_hub(name, model.hub, sha256 or model.sha256)
    sha256 = sha256 or (model.sha256 if url in (None, model.url) else None)
    url = url or model.url
    if url is None:
        raise CallError(f"network {name} has no published address; to get it: {model.make}")
    if sha256 is None:
        raise CallError("--url needs --sha256 HEX: a download is installed only if it matches")
    sha256 = sha256.lower()
    if len(sha256) != 64 or set(sha256) - set("0123456789abcdef"):
        raise CallError(f"--sha256 must be 64 hexadecimal digits, got {sha256!r}")
    if not url.startswith(("https://", "http://")):
        raise CallError(f"expected an http(s) address, got {url!r}")
    begin()
    with tempfile.TemporaryDirectory() as folder:
        file = _download(url, sha256, Path(folder))
        return install(name, file, source=url, licence=licence, sha256=sha256)


def _from_hub(name: str, file: hub.HubFile, sha256: str | None) -> Path:
    """Fetches what the cache does not hold, or not whole."""
    path = hub.download(file)
    if sha256 is not None and digest(path) != sha256:
        path = hub.download(file, again=True)
        if digest(path) != sha256:
            raise UserError(f"the hub returned a {file} whose SHA-256 is not {sha256[:12]}...")
    load(name, threads=1)
    return path


def _download(url: str, sha256: str, folder: Path) -> Path:
    import pooch
    import requests

    pooch.get_logger().setLevel(logging.WARNING)
    try:
        path = pooch.retrieve(
            url,
            known_hash=f"sha256:{sha256}",
            fname="network.onnx",
            path=folder,
            downloader=pooch.HTTPDownloader(timeout=TIMEOUT_S),
        )
        return Path(path)
    except requests.RequestException as error:
        response = getattr(error, "response", None)
        why = f"status {response.status_code}" if response is not None else type(error).__name__
        raise UserError(f"{url} cannot be fetched: {why}") from error
    except ValueError as error:
        raise UserError(
            f"{url} returned a file whose SHA-256 is not {sha256[:12]}...; nothing was installed"
        ) from error
    except OSError as error:
        raise UserError(f"{url} cannot be fetched: {error.strerror or error}") from error
