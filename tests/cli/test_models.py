"""`3ds models`: what is here, what is not, and how it comes."""

from __future__ import annotations

import json
from pathlib import Path

from tests import factories
from tests.conftest import Cli


def rows(cli: Cli) -> dict[str, dict[str, object]]:
    lines = cli("models", "--json").out.splitlines()
    return {row["name"]: row for row in map(json.loads, lines)}


def test_lists_every_network_with_how_to_get_it(cli: Cli) -> None:
    names = ["doornet", "cnn-srin", "densedepth"]
    names += ["depth-anything-v2-metric-indoor-small", "depth-anything-v2-small"]
    assert list(rows(cli)) == names
    assert rows(cli)["cnn-srin"]["state"] == "missing"
    text = cli("models").out
    assert "3ds train cnn-srin DATASET" in text
    assert "3ds models fetch densedepth --url URL --sha256 HEX" in text


def test_import_and_damage(cli: Cli) -> None:
    file = factories.cnn_srin(Path("mine.onnx"))
    ran = cli("models", "import", "cnn-srin", file, "--licence", "CC0-1.0")
    assert ran.status == 0
    row = rows(cli)["cnn-srin"]
    assert (row["state"], row["licence"], row["source"]) == ("here", "CC0-1.0", "mine.onnx")
    path = Path(str(row["file"]))
    path.write_bytes(path.read_bytes() + b"\0")
    assert rows(cli)["cnn-srin"]["state"] == "damaged"
    path.with_suffix(".json").write_text("{")
    assert str(rows(cli)["cnn-srin"]["state"]).startswith("unreadable: model card")


def test_refusals(cli: Cli) -> None:
    assert cli("models", "import", "cnn-srin", "none.onnx").status == 1
    assert cli("models", "import", "cnn-srin", "net.onnx").status == 1
    assert cli("models", "import", "magic", "net.onnx").status == 2
    without_checksum = ("densedepth", "--url", "http://127.0.0.1:9/x")
    for call in (("densedepth",), without_checksum, ("nope",), ("doornet",)):
        ran = cli("models", "fetch", *call)
        assert (ran.status, ran.out, ran.err.count("\n")) == (2, "", 1)
        assert "fetching" not in ran.err
    assert list(Path("models").iterdir()) == []
