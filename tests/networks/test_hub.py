"""The hub by name: what it gives, its cache, its absence."""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import ClassVar

import pytest

from doorway3ds.errors import UserError
from doorway3ds.files import digest
from doorway3ds.networks import hub, registry
from doorway3ds.networks.depth.presets import RELATIVE
from doorway3ds.networks.fetch import fetch
from tests import factories
from tests.conftest import Cli, Ran
from tests.factories import encode, scene

huggingface_hub = pytest.importorskip("huggingface_hub")
constants = importlib.import_module("huggingface_hub.constants")
errors = importlib.import_module("huggingface_hub.errors")
download = huggingface_hub.hf_hub_download

FILE = registry.MODELS[RELATIVE].hub
assert FILE is not None

# The small file's digest in place of the published one's; all else is the program itself.
RUN = """
import sys
from dataclasses import replace
from doorway3ds.cli.main import run
from doorway3ds.networks import registry
name, sha256, *arguments = sys.argv[1:]
registry.MODELS[name] = replace(registry.MODELS[name], sha256=sha256)
sys.exit(run(arguments))
"""


class _Hub(BaseHTTPRequestHandler):
    """What the hub answers about one file of one commit."""

    data: ClassVar[bytes] = b""
    asked: ClassVar[list[str]] = []

    def do_HEAD(self) -> None:
        self._answer(False)

    def do_GET(self) -> None:
        self._answer(True)

    def _answer(self, body: bool) -> None:
        found = self.path == f"/{FILE.repo}/resolve/{FILE.revision}/{FILE.file}"
        if found and body:
            self.asked.append(self.path)
        data = self.data if found else b""
        self.send_response(200 if found else 404)
        self.send_header("Content-Length", str(len(data)))
        if found:
            self.send_header("ETag", f'"{hashlib.sha256(data).hexdigest()}"')
            self.send_header("X-Repo-Commit", FILE.revision)
        else:
            self.send_header("X-Error-Code", "EntryNotFound")
        self.end_headers()
        if body:
            self.wfile.write(data)

    def log_message(self, *args: object) -> None:
        pass


class Place:
    """A folder with a network file, a hub cache of its own, and the hub's address."""

    def __init__(self, folder: Path, port: int) -> None:
        self.folder = folder
        self.cache = folder / "hf" / "hub"
        self.endpoint = f"http://127.0.0.1:{port}"
        self.file = factories.depth_file(folder / "made.onnx", gain=0.1, offset=1.0)
        self.sha256 = digest(self.file)

    def command(self, *arguments: str, **env: str) -> Ran:
        """`3ds` in a process of its own, which reads the hub's variables itself."""
        mine = {
            **{k: v for k, v in os.environ.items() if not k.startswith("HF_")},
            "HF_HOME": str(self.folder / "hf"),
            "HF_ENDPOINT": self.endpoint,
            "HF_HUB_DISABLE_TELEMETRY": "1",
            "HF_HUB_DISABLE_PROGRESS_BARS": "1",
            registry.FOLDER_VARIABLE: str(self.folder / "models"),
        }
        done = subprocess.run(
            [sys.executable, "-c", RUN, RELATIVE, self.sha256, *arguments],
            cwd=self.folder,
            env=mine | env,
            capture_output=True,
            text=True,
        )
        assert "Traceback" not in done.stderr
        return Ran(done.returncode, done.stdout, done.stderr)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Place]:
    """A hub of one file, to be asked from this process, too."""
    httpd = ThreadingHTTPServer(("127.0.0.1", 0), _Hub)
    thread = threading.Thread(target=httpd.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    place = Place(tmp_path, httpd.server_port)
    _Hub.data, _Hub.asked = place.file.read_bytes(), []
    reach(monkeypatch, place.endpoint)
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(place.cache))
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", False)
    monkeypatch.setattr(constants, "HF_HUB_DISABLE_TELEMETRY", True)
    monkeypatch.setenv(registry.FOLDER_VARIABLE, str(tmp_path / "models"))
    expect(monkeypatch, place.sha256)
    yield place
    httpd.shutdown()
    httpd.server_close()
    thread.join()


def reach(monkeypatch: pytest.MonkeyPatch, endpoint: str) -> None:
    """This process has read HF_ENDPOINT already; the hub is there from now on."""
    there = partial(download, endpoint=endpoint)
    monkeypatch.setattr(huggingface_hub, "hf_hub_download", there)


def expect(monkeypatch: pytest.MonkeyPatch, sha256: str) -> None:
    """The published digest is this one from now on."""
    model = replace(registry.MODELS[RELATIVE], sha256=sha256)
    monkeypatch.setattr(registry, "MODELS", {**registry.MODELS, RELATIVE: model})


def test_fetched_once_it_is_used_by_name_without_a_network(place: Place) -> None:
    network, offline = f"doornet+{RELATIVE}", {"HF_HUB_OFFLINE": "1"}
    ran = place.command("models", "fetch", RELATIVE, **offline)
    assert ran.status == 1
    (_, line) = ran.err.splitlines()
    assert f"not in the cache {place.cache}, and the hub {place.endpoint} is not asked" in line

    ran = place.command("models", "fetch", RELATIVE)
    assert (ran.status, ran.err) == (0, f"{RELATIVE}: fetching\n")
    assert ran.out.startswith(f"{RELATIVE}: installed {place.cache}")
    assert len(_Hub.asked) == 1

    (place.folder / "photo.jpg").write_bytes(encode(scene(160, 120)))
    ran = place.command(
        *("look", "--json", "photo.jpg", "--network", network, "--camera", "nao-v6-top"), **offline
    )
    assert ran.status == 0, ran.err
    assert json.loads(ran.out)["network"] == network
    assert len(_Hub.asked) == 1
    assert not (place.folder / "models").exists()


def test_what_is_cached_is_listed_and_not_fetched_again(place: Place, cli: Cli) -> None:
    def row() -> dict[str, object]:
        rows = map(json.loads, cli("models", "--json").out.splitlines())
        return next(row for row in rows if row["name"] == RELATIVE)

    assert row()["state"] == "missing"
    path = fetch(RELATIVE)
    assert fetch(RELATIVE) == path
    assert len(_Hub.asked) == 1
    assert row()["file"] == str(path)
    assert (row()["state"], row()["source"]) == ("here", str(FILE))

    path.write_bytes(path.read_bytes()[:-9])
    assert row()["state"] == "damaged"
    with pytest.raises(UserError, match="is damaged: its SHA-256 begins"):
        registry.load(RELATIVE)
    assert fetch(RELATIVE) == path
    assert row()["state"] == "here"


def test_another_file_than_the_published_one_is_refused(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    expect(monkeypatch, "0" * 64)
    with pytest.raises(UserError, match=r"SHA-256 is not 000000000000\.\.\.") as caught:
        fetch(RELATIVE)
    assert str(FILE) in str(caught.value)
    assert len(_Hub.asked) == 2  # once more, in case the cache was damaged


def test_another_signature_is_refused(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    other = factories.cnn_srin(place.folder / "other.onnx")
    _Hub.data = other.read_bytes()
    expect(monkeypatch, digest(other))
    with pytest.raises(UserError, match="expected 3 colour channels in layout nchw"):
        fetch(RELATIVE)


def test_what_the_hub_does_not_have(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    reach(monkeypatch, f"{place.endpoint}/elsewhere")
    with pytest.raises(UserError, match=r"does not return .*: status 404") as caught:
        fetch(RELATIVE)
    assert str(FILE) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_cache_that_cannot_be_written(place: Place) -> None:
    place.cache.parent.mkdir()
    place.cache.write_text("a file where the folder should be")
    with pytest.raises(UserError, match=r"onnx/model\.onnx cannot be fetched: ") as caught:
        fetch(RELATIVE)
    assert "\n" not in str(caught.value)


def test_without_a_network_it_says_so(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    def unreachable(*_: object, **__: object) -> str:  # the real one tries for half a minute
        raise errors.LocalEntryNotFoundError("two\nlines")

    monkeypatch.setattr(huggingface_hub, "hf_hub_download", unreachable)
    with pytest.raises(UserError, match="cannot be reached; fetch it with a network") as caught:
        hub.download(FILE)
    assert "\n" not in str(caught.value)


def test_without_the_package_it_says_which(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    assert hub.cached(FILE) is None
    with pytest.raises(UserError, match=r"fetched with huggingface_hub: pip install 'doorway3ds"):
        hub.download(FILE)
