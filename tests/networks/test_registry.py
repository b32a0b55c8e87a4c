"""Names, files, checksums and downloads; every way that a file can be wrong is one line."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from doorway3ds.errors import CallError, UserError
from doorway3ds.files import digest
from doorway3ds.networks import registry
from doorway3ds.networks.depth.presets import METRIC
from doorway3ds.networks.fetch import fetch
from doorway3ds.networks.registry import MODELS, install, load, read_card
from tests import factories


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(registry.FOLDER_VARIABLE, str(tmp_path / "models"))
    return tmp_path / "models"


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *args: object) -> None:
        pass


@pytest.fixture
def server(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """A local web server: its address and the folder that it serves."""
    served = tmp_path / "served"
    served.mkdir()
    httpd = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(served)))
    thread = threading.Thread(target=httpd.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{httpd.server_port}", served
    httpd.shutdown()
    httpd.server_close()
    thread.join()


def one_line(caught: pytest.ExceptionInfo[UserError]) -> str:
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_a_missing_file_names_the_command_that_makes_it(folder: Path) -> None:
    for name in ("cnn-srin", "densedepth"):
        with pytest.raises(UserError) as caught:
            load(name)
        message = one_line(caught)
        assert f"3ds train {name} DATASET" in message
        assert f"3ds models import {name}" in message
        assert str(folder / f"{name}.onnx") in message


def test_unknown_names_are_a_wrong_call() -> None:
    with pytest.raises(CallError, match="no network 'yolo'; expected doornet, cnn-srin"):
        load("yolo")
    with pytest.raises(CallError, match="no network ''"):
        load("")
    with pytest.raises(UserError, match=r"no network file .*none\.onnx"):
        load("none.onnx")


@pytest.mark.parametrize("kind", ["doornet", "cnn-srin", "densedepth"])
def test_an_onnx_path_is_loaded_by_its_signature(tmp_path: Path, kind: str) -> None:
    make = {
        "doornet": factories.doornet,
        "cnn-srin": factories.cnn_srin,
        "densedepth": factories.densedepth,
    }[kind]
    path = make(tmp_path / "site.onnx")
    network = load(str(path), threads=1)
    assert network.gives == set(MODELS[kind].gives)
    assert network.name == str(path)


def test_needs_are_checked_before_any_picture(tmp_path: Path) -> None:
    path = factories.cnn_srin(tmp_path / "c.onnx")
    with pytest.raises(CallError, match="returns p_open but columns is needed"):
        load(str(path), threads=1, needs=("p_open", "columns"))


def test_install_and_load(tmp_path: Path, folder: Path) -> None:
    file = factories.cnn_srin(tmp_path / "mine.onnx")
    path = install("cnn-srin", file, source="mine.onnx", licence="CC0-1.0")
    assert path == folder / "cnn-srin.onnx"
    assert read_card(path).licence == "CC0-1.0"
    assert read_card(path).sha256 == digest(file)
    assert load("cnn-srin", threads=1).name == "cnn-srin"
    assert sorted(p.name for p in folder.iterdir()) == ["cnn-srin.json", "cnn-srin.onnx"]


def test_a_wrong_file_never_replaces_a_good_one(tmp_path: Path, folder: Path) -> None:
    install("cnn-srin", factories.cnn_srin(tmp_path / "good.onnx"), source="good.onnx")
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    for make in (factories.densedepth, factories.doornet):  # doornet's p_open is a logit
        bad = make(tmp_path / "bad.onnx")
        with pytest.raises(UserError, match=r"network file bad\.onnx has another signature"):
            install("cnn-srin", bad, source="bad.onnx")
    (tmp_path / "junk.onnx").write_bytes(b"junk")
    with pytest.raises(UserError, match=r"network file junk\.onnx cannot be opened"):
        install("cnn-srin", tmp_path / "junk.onnx", source="junk.onnx")
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before


def test_the_packaged_network_is_not_replaced(tmp_path: Path) -> None:
    with pytest.raises(CallError, match="doornet is packaged"):
        install("doornet", factories.doornet(tmp_path / "n.onnx"), source="n.onnx")


def test_a_changed_file_is_refused_by_its_checksum(tmp_path: Path) -> None:
    path = install("cnn-srin", factories.cnn_srin(tmp_path / "n.onnx"), source="n.onnx")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(UserError, match="is damaged: its SHA-256 begins") as caught:
        load("cnn-srin", threads=1)
    one_line(caught)


@pytest.mark.parametrize("keep", [0.0, 0.1, 0.5, 0.9])
def test_a_cut_file_is_refused(tmp_path: Path, keep: float) -> None:
    data = factories.doornet(tmp_path / "n.onnx").read_bytes()
    path = tmp_path / "cut.onnx"
    path.write_bytes(data[: int(keep * len(data))])
    with pytest.raises(UserError) as caught:
        load(str(path), threads=1)
    assert str(path) in one_line(caught)


def test_a_damaged_card_is_named(tmp_path: Path) -> None:
    path = install("cnn-srin", factories.cnn_srin(tmp_path / "n.onnx"), source="n.onnx")
    path.with_suffix(".json").write_text("{")
    with pytest.raises(UserError, match=r"model card .*cnn-srin\.json cannot be read"):
        load("cnn-srin")
    path.with_suffix(".json").write_text(json.dumps([1]))
    with pytest.raises(UserError, match="must be a JSON object, got list"):
        load("cnn-srin")


def test_fetch_installs_what_has_the_right_checksum(server: tuple[str, Path]) -> None:
    address, served = server
    file = factories.densedepth(served / "depth.onnx")
    path = fetch("densedepth", f"{address}/depth.onnx", digest(file).upper())
    assert path.read_bytes() == file.read_bytes()
    assert read_card(path).source == f"{address}/depth.onnx"
    assert load("densedepth", threads=1).gives == {"depth"}


def test_a_published_release_is_fetched_by_name(
    server: tuple[str, Path], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address, served = server
    file = factories.depth_file(served / "indoor.onnx", offset=2.0)
    published = replace(MODELS[METRIC], url=f"{address}/indoor.onnx", sha256=digest(file))
    monkeypatch.setattr(registry, "MODELS", {**MODELS, METRIC: published})
    assert fetch(METRIC) == folder / f"{METRIC}.onnx"
    assert read_card(folder / f"{METRIC}.onnx").source == f"{address}/indoor.onnx"
    assert load(METRIC, threads=1).gives == {"depth"}
    # Another address is not held to the published digest, so it needs one of its own.
    with pytest.raises(CallError, match="--url needs --sha256"):
        fetch(METRIC, f"{address}/other.onnx")


def test_fetch_refuses_everything_else(server: tuple[str, Path], folder: Path) -> None:
    address, served = server
    file = factories.densedepth(served / "depth.onnx")
    right = digest(file)
    for url, sha256, part in (
        (f"{address}/depth.onnx", "0" * 64, "SHA-256 is not 000000000000"),
        (f"{address}/none.onnx", right, "cannot be fetched: status 404"),
        ("http://127.0.0.1:9/x.onnx", right, "cannot be fetched: ConnectionError"),
    ):
        with pytest.raises(UserError) as caught:
            fetch("densedepth", url, sha256)
        assert part in one_line(caught)
    for url, sha256, part in (
        (None, None, "no published address; to get it: `3ds train densedepth"),
        (f"{address}/depth.onnx", None, "--url needs --sha256"),
        (f"{address}/depth.onnx", "12ab", "64 hexadecimal digits"),
        ("file:///etc/passwd", right, "expected an http(s) address"),
    ):
        with pytest.raises(CallError) as wrong:
            fetch("densedepth", url, sha256)
        assert part in one_line(wrong)
    assert not folder.exists()


def test_fetch_refuses_another_signature(server: tuple[str, Path], folder: Path) -> None:
    address, served = server
    file = factories.cnn_srin(served / "n.onnx")
    with pytest.raises(UserError, match=rf"network file {address}/n\.onnx has another signature"):
        fetch("densedepth", f"{address}/n.onnx", digest(file))
    assert not list(folder.iterdir())
