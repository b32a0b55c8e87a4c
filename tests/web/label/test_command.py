"""`3ds label` as it is called, and what the other commands make of what it wrote."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from tests.conftest import Cli
from tests.factories import encode, scene
from tests.web.label.test_table import rows


def test_ctrl_c_leaves_everything_saved(cli: Cli, site: Path) -> None:
    call = [sys.executable, "-m", "doorway3ds.cli.main", "label", str(site), "--port", "0"]
    with subprocess.Popen(
        [*call, "--network", "net.onnx"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            line = process.stdout.readline()
            assert line.startswith("labelling at http://127.0.0.1:")
            url = line.split()[-1]
            guess = httpx.get(f"{url}v1/pictures/0", timeout=60).json()["guess"]
            for number, marks in enumerate((guess, {"closed": True}, {})):
                asked = {"marks": marks, "revision": "unmarked"}
                httpx.put(f"{url}v1/pictures/{number}", json=asked, timeout=60).raise_for_status()
            process.send_signal(signal.SIGINT)
            assert process.wait(60) == 130
            told = process.stderr.read()
        finally:
            process.kill()
    assert told == f"{site / 'doorways.csv'}: 3 of 5 images marked\n"
    assert [row["state"] for row in rows(site)] == ["open", "closed", "none"]


def test_what_is_marked_is_measured_on(cli: Cli, site: Path) -> None:
    (site / "doorways.csv").write_text(
        "image,open,left_px,right_px,clear,confidence,second,state,place\n"
        "a.jpg,1,64,128,1,3,0,open,hall\nb.png,0,,,,3,0,none,yard\n"
        "e.jpg,1,20,38,,1,0,half,yard\nhall/c.jpg,0,,,,3,0,closed,hall\n"
    )
    calls = ["--network", "net.onnx", "--method", "opening", "--json", "-", "--repeats", "0"]
    ran = cli("eval", "direction", site, *calls)
    assert ran.status == 0
    (run,) = json.loads(ran.out)["runs"]
    # the tiny network sees 0.2 to 0.4 of every picture: a.jpg's doorway to the pixel
    assert run["metrics"]["within_5deg"]["n"] == 2
    assert run["metrics"]["bearing_median_deg"]["value"] < 3
    narrow = cli("eval", "direction", site, *calls, "--min-confidence", "3", "--fov-deg", "40")
    (run,) = json.loads(narrow.out)["runs"]
    assert run["metrics"]["within_5deg"]["n"] == 1


def test_a_folder_per_class(cli: Cli, site: Path, tmp_path: Path) -> None:
    ran = cli("label", site, "--classes", "classes")
    assert ran.status == 1
    assert "marks no image yet" in ran.err
    (site / "doorways.csv").write_text("image,open,left_px,right_px\na.jpg,1,5,9\nb.png,0,,\n")
    ran = cli("label", site, "--classes", "classes")
    assert (ran.status, ran.out) == (0, "classes: 1 no-door, 1 open-door\n")
    assert (tmp_path / "classes" / "open-door" / "a.jpg").samefile(site / "a.jpg")
    again = cli("eval", "classifier", "classes", "--network", "net.onnx", "--repeats", "0")
    assert again.status == 0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("picture,door\na.jpg,1\n", "lacks the column image"),
        ("image,open,left_px,right_px\na.jpg,1,9,5\n", "line 2: an opening's left edge"),
    ],
)
def test_a_table_of_others_stops_it(cli: Cli, site: Path, content: str, message: str) -> None:
    (site / "doorways.csv").write_text(content)
    ran = cli("label", site, "--port", "0", "--network", "net.onnx")
    assert (ran.status, ran.out) == (1, "")
    assert message in ran.err
    assert ran.err.count("\n") == 1
    assert (site / "doorways.csv").read_text() == content


def test_wrong_calls_are_one_line(cli: Cli, site: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for call, status, message in (
        (["nothing"], 1, "expected a folder of images"),
        (["empty"], 1, "holds no image"),
        ([site, "--host", "0.0.0.0"], 2, "--token"),
        ([site, "--camera", "nothing.yaml"], 2, "neither a preset"),
        ([site, "--classes", site / "classes"], 1, "marks no image"),
    ):
        ran = cli("label", *call, "--port", "0", "--network", "net.onnx")
        assert (ran.status, ran.err.count("\n")) == (status, 1), ran
        assert message in ran.err


def test_names_that_a_table_cannot_hold_are_left_out(site: Path) -> None:
    from doorway3ds.web.label.pictures import Pictures

    (site / " blank.jpg").write_bytes(encode(scene()))
    (site / "two\nlines.jpg").write_bytes(encode(scene()))
    (site / "depth").mkdir()
    (site / "depth" / "a.png").write_bytes(encode(scene(), "PNG"))
    (site / ".hidden.jpg").write_bytes(encode(scene()))
    pictures = Pictures(site)
    assert pictures.names == ("a.jpg", "b.png", "e.jpg", "hall/c.jpg", "hall/d.jpg")
    assert pictures.left_out == (" blank.jpg", "two\nlines.jpg")
