"""Files of networks side by side, on the pictures that a training kept to itself."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from doorway3ds.errors import UserError
from doorway3ds.lab.evaluate.overview import held_sets, read_held
from tests import factories
from tests.conftest import Cli
from tests.factories import write_site


@pytest.fixture
def held(tmp_path: Path) -> Path:
    """Rooms 0 and 1 of a site, eight pictures, four with an opening."""
    write_site(tmp_path / "site", rooms=4)
    rows = [f"site,room{r:02d}/{n}.png,site-{r},{r + 1}" for r in (0, 1) for n in range(4)]
    path = tmp_path / "held-out.csv"
    path.write_text("\n".join(["source,image,place,half", *rows]) + "\n")
    return path


def test_only_held_out_pictures_are_measured(held: Path, tmp_path: Path) -> None:
    (part,) = held_sets([tmp_path / "site"], read_held(held))
    assert part.name == "site" and not part.rough
    assert {s.place for s in part.samples} == {"site-0", "site-1"}
    assert len(part.samples) == 8
    held.write_text("source,image,place,half\nother,room00/0.png,a,1\n")
    with pytest.raises(UserError, match="none of the held-out images"):
        held_sets([tmp_path / "site"], read_held(held))


def test_networks_are_compared_with_the_first(held: Path, tmp_path: Path, cli: Cli) -> None:
    always = factories.doornet(tmp_path / "always.onnx", p_open=3.0)
    never = factories.doornet(tmp_path / "never.onnx", p_open=-3.0)
    told, sheets = tmp_path / "told.json", tmp_path / "sheets"
    call = ("eval", "overview", tmp_path / "site", "--held-out", held, "--repeats", 50)
    files = ("--network", always, "--network", never)
    ran = cli(*call, *files, "--json", told, "--sheets", sheets)
    assert ran.status == 0 and ran.out.count("\n") == 5  # heads, rule, two files, difference
    first, second, minus = json.loads(told.read_text())["rows"]
    assert (first["pictures"], first["doorways"]) == (8, 4)
    value = {key: row["value"] for key, row in first["values"].items()}
    assert value["closed_open"] == value["open_open"] == 1
    assert value["auc"] == 0.5
    assert value["ece"] == pytest.approx(0.9526 - 0.5, abs=1e-3)
    assert 0 < value["ece_chance"] < 0.1 and "ece_chance" not in minus["values"]
    assert second["values"]["open_open"]["value"] == 0
    assert minus["values"]["open_open"]["value"] == -1
    assert minus["values"]["within_5deg"]["value"] == 0  # both list the same opening
    assert sorted(p.name for p in sheets.iterdir()) == ["site-0.png", "site-1.png"]
    # each half by its own file
    for half, odds in ((1, 3.0), (2, -3.0)):
        factories.doornet(tmp_path / f"half-{half}.onnx", p_open=odds)
    ran = cli(*call, "--network", tmp_path / "half-{k}.onnx", "--json", told)
    (row,) = json.loads(told.read_text())["rows"]
    assert row["values"]["open_open"]["value"] == 0.5 and row["pictures"] == 8
    # a preset moves the gate: nobody is called open from 0.99 on
    strict = {**factories.METADATA, "presets": {"strict": {"open_from": 0.99}}}
    named = factories.doornet(tmp_path / "named.onnx", p_open=3.0, metadata=strict)
    ran = cli(*call, "--network", named, "--preset", "strict", "--json", told)
    assert ran.status == 0
    assert json.loads(told.read_text())["rows"][0]["values"]["open_open"]["value"] == 0
    ran = cli(*call, "--network", always, "--preset", "strict")
    assert ran.status != 0 and "no preset 'strict'" in ran.err


def test_a_list_without_halves_is_refused(held: Path) -> None:
    held.write_text("source,image,place,half\nsite,room00/0.png,a,3\n")
    with pytest.raises(UserError, match="expected half 1 or 2, got '3'"):
        read_held(held)
