"""`3ds look`: its contract, line by line."""

from __future__ import annotations

import csv
import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.camera.info import write_camera_info
from doorway3ds.camera.model import Camera
from doorway3ds.images.codec import read_image
from tests import factories
from tests.conftest import Cli
from tests.factories import encode, scene

NET = ("--network", "net.onnx")
KEYS = [
    *("image", "method", "network", "camera", "p_open", "open", "reason", "turn_deg"),
    *("bearing_deg", "range_m", "clear", "floor_from_m", "look", "openings", "pixel"),
    "timings_ms",
]
PAPER_KEYS = ["max_pixel", "best_pixel", "trigger_pixel", "max_depth", "best_depth"]


def answer(cli: Cli, *arguments: object) -> dict[str, object]:
    """The one JSON object of a call that answers one image."""
    ran = cli("look", "--json", *NET, *arguments)
    assert ran.status == 0, ran.err
    assert ran.out.count("\n") == 1
    return json.loads(ran.out)


def test_text_line_and_picture(cli: Cli) -> None:
    ran = cli("look", "photo.jpg", *NET)
    assert ran.status == 0
    parts = ran.out.removesuffix("\n").split(" · ")
    assert parts[0] == "photo.jpg: open door 0.95"
    assert parts[1].endswith(" deg left")
    assert parts[2].endswith(" m")
    assert parts[3] == "way not seen"
    assert parts[-1] == "camera assumed 60.9 deg"
    assert ran.err == ""
    assert [p.name for p in Path("3ds-out").iterdir()] == ["photo_3ds.jpg"]
    assert read_image("3ds-out/photo_3ds.jpg").image.shape[1] == 1600


def test_json_has_the_contract_s_keys_and_writes_nothing(cli: Cli) -> None:
    found = answer(cli, "photo.jpg")
    assert list(found) == KEYS
    assert found["image"] == "photo.jpg"
    assert found["network"] == "net.onnx"
    assert found["camera"] == {"name": "assumed 60.9 deg", "assumed": True}
    assert list(found["timings_ms"]) == ["decode", "prepare", "network", "selection", "decision"]
    assert set(found["openings"][0]) == {
        "left_px",
        "right_px",
        "left_deg",
        "right_deg",
        "bearing_deg",
        "range_m",
        "score",
        "cut",
    }
    assert not Path("3ds-out").exists()


def test_paper_adds_its_pixels(cli: Cli) -> None:
    found = answer(cli, "photo.jpg", "--method", "paper")
    assert list(found) == [*KEYS, *PAPER_KEYS]
    assert found["method"] == "paper"
    assert found["reason"] != "aligned"


def test_out_and_depth_dir(cli: Cli) -> None:
    answer(cli, "photo.jpg", "--out", "a/pictures", "--depth-dir", "b")
    assert [p.name for p in Path("a/pictures").iterdir()] == ["photo_3ds.jpg"]
    depth = np.load("b/photo.npy")
    assert depth.dtype == np.float32
    assert depth.shape == (48, 64)  # the whole picture, at the network's own size


def test_out_may_be_the_folder_of_the_photographs(cli: Cli) -> None:
    before = Path("photo.jpg").read_bytes()
    assert cli("look", "photo.jpg", *NET, "--out", ".").status == 0
    assert Path("photo.jpg").read_bytes() == before


def test_folders_in_name_order_and_stems_that_meet(cli: Cli) -> None:
    Path("shots").mkdir()
    for name in ("b.jpg", "a.PNG", "c.txt", ".hidden.jpg"):
        Path("shots", name).write_bytes(encode(scene(), "PNG"))
    Path("b.png").write_bytes(encode(scene(), "PNG"))
    ran = cli("look", "shots", "b.png", "--json", *NET, "--depth-dir", "d")
    assert ran.status == 0
    names = [json.loads(line)["image"] for line in ran.out.splitlines()]
    assert names == [str(Path("shots/a.PNG")), str(Path("shots/b.jpg")), "b.png"]
    assert sorted(p.name for p in Path("d").iterdir()) == ["a.npy", "b-2.npy", "b.npy"]
    assert ran.err.startswith("3 of 3 answered in ")


def test_standard_input(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(encode(scene()))))
    assert answer(cli, "-")["image"] == "-"
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"")))
    ran = cli("look", "-", *NET)
    assert (ran.status, ran.out) == (1, "")
    assert ran.err == "3ds: standard input is empty (0 bytes); expected an image\n"


def test_one_bad_image_does_not_cost_the_others(cli: Cli) -> None:
    Path("bad.jpg").write_text("no image")
    Path("empty").mkdir()
    ran = cli("look", "none.jpg", "bad.jpg", "empty", "photo.jpg", "--json", *NET)
    assert ran.status == 1
    assert [json.loads(line)["image"] for line in ran.out.splitlines()] == ["photo.jpg"]
    errors = ran.err.splitlines()
    assert errors[0].startswith("3ds: empty holds no image")
    assert errors[1].startswith("3ds: none.jpg does not exist")
    assert errors[2].startswith("3ds: bad.jpg is not an image")
    assert errors[3].startswith("1 of 4 answered")


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ((), "Missing argument"),
        (("photo.jpg", "--wrong"), "No such option"),
        (("photo.jpg", "--method", "magic"), "'magic' is not one of 'opening', 'paper'"),
        (("photo.jpg", "--network", "magic"), "no network 'magic'"),
        (("photo.jpg", "--network", "cnn-srin"), "3ds train cnn-srin DATASET"),
        (("photo.jpg", "--camera", "magic"), "neither a preset"),
        (("photo.jpg", "--camera", "nao-v5-top", "--fov-deg", "60"), "give one of them"),
        (("photo.jpg", "--fov-deg", "nan"), "--fov-deg must be a number from 1 to 179"),
        (("photo.jpg", "--fov-deg", "180"), "--fov-deg must be a number from 1 to 179"),
        (("photo.jpg", "--height-m", "-1"), "--height-m must be"),
        (("photo.jpg", "--pitch-deg", "91"), "--pitch-deg must be"),
        (("photo.jpg", "--width-m", "0"), "--width-m must be"),
        (("photo.jpg", "--max-unseen-m", "inf"), "--max-unseen-m must be"),
        (("photo.jpg", "--out", "photo.jpg"), "cannot make the folder photo.jpg"),
        (("photo.jpg", "--threads", "0"), "--threads must be"),
    ],
)
def test_wrong_calls(cli: Cli, arguments: tuple[str, ...], part: str) -> None:
    network = () if "--network" in arguments else NET
    ran = cli("look", *arguments, *network)
    assert ran.status == 2
    assert ran.out == ""
    assert part in ran.err


def test_cameras(cli: Cli) -> None:
    nao = answer(cli, "photo.jpg", "--camera", "nao-v5-top")
    assert nao["camera"] == {"name": "nao-v5-top", "assumed": False}
    wide = answer(cli, "photo.jpg", "--fov-deg", "90")
    narrow = answer(cli, "photo.jpg", "--fov-deg", "45")
    assert wide["camera"]["assumed"] is False
    # The door's middle is 0.4 of half the width from the axis: the angle is atan(0.4 tan(fov/2)).
    for found, fov in ((wide, 90), (narrow, 45)):
        expected = np.degrees(np.arctan(0.4 * np.tan(np.radians(fov / 2))))
        assert found["bearing_deg"] == pytest.approx(expected, abs=0.05)


def test_camera_files(cli: Cli) -> None:
    write_camera_info(Camera.from_fov(640, 480, 90.0, name="mine"), Path("cam.yaml"))
    found = answer(cli, "photo.jpg", "--camera", "cam.yaml")  # 160x120: same aspect, scaled
    assert found["camera"] == {"name": "mine", "assumed": False}
    Path("square.png").write_bytes(encode(scene(100, 100), "PNG"))
    ran = cli("look", "square.png", "photo.jpg", *NET, "--json", "--camera", "cam.yaml")
    assert ran.status == 1
    assert ran.out.count("\n") == 1
    assert ran.err.splitlines()[0].startswith("3ds: square.png: ")
    Path("cam.yaml").write_text("nonsense: [")
    assert cli("look", "photo.jpg", *NET, "--camera", "cam.yaml").status == 2


def test_the_pose_is_used(cli: Cli) -> None:
    level = answer(cli, "photo.jpg", "--height-m", "1.3")
    rolled = answer(cli, "photo.jpg", "--height-m", "1.3", "--roll-deg", "10")
    assert level["openings"][0]["left_deg"] != rolled["openings"][0]["left_deg"]


def test_exif_focal_length_is_said(cli: Cli) -> None:
    Path("exif.jpg").write_bytes(encode(scene(160, 120), focal_35mm=27))
    ran = cli("look", "exif.jpg", *NET)
    assert ran.out.rstrip().endswith("camera assumed (EXIF 27 mm)")


def test_no_door(cli: Cli) -> None:
    factories.doornet(Path("shut.onnx"), p_open=-2.0)
    ran = cli("look", "photo.jpg", "--network", "shut.onnx")
    assert ran.out == "photo.jpg: no open door 0.12 · stay · camera assumed 60.9 deg\n"
    found = json.loads(cli("look", "photo.jpg", "--json", "--network", "shut.onnx").out)
    assert (found["open"], found["reason"], found["turn_deg"]) == (False, "no_door", None)
    assert found["openings"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_ctrl_c_ends_quietly(cli: Cli) -> None:
    os.mkfifo("pipe.jpg")
    process = subprocess.Popen(
        [sys.executable, "-m", "doorway3ds.cli.main", "look", "pipe.jpg", *NET],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    writer = open_once_read(Path("pipe.jpg"), process)
    time.sleep(0.3)  # a signal between opening and reading waits for the read to end
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    os.close(writer)
    assert (process.returncode, out, err) == (130, b"", b"")


def open_once_read(pipe: Path, process: subprocess.Popen[bytes]) -> int:
    """Opens a named pipe for writing as soon as `process` reads from it."""
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and process.poll() is None:
        try:
            return os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)
        except OSError:  # nobody reads yet
            time.sleep(0.01)
    raise AssertionError(f"{pipe} was never read: {process.communicate(timeout=1)}")


@pytest.mark.skipif(os.name == "nt", reason="needs pipes that break")
def test_a_reader_that_leaves_ends_it_quietly(cli: Cli) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "doorway3ds.cli.main", "look", "--json", *NET, *["photo.jpg"] * 500],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    json.loads(process.stdout.readline())
    process.stdout.close()
    err = process.stderr.read()
    assert process.wait(timeout=20) == 1
    assert err == b""


def test_mirror_looks_twice_and_says_so(cli: Cli) -> None:
    # the tiny network finds its door at the same columns of both mirrorings: twice in the picture
    twice = answer(cli, "photo.jpg", "--mirror")
    assert twice["network"] == "net.onnx, mirrored average"
    left, right = (opening["bearing_deg"] for opening in twice["openings"])
    assert left == pytest.approx(-right, abs=0.01)
    assert left > 5


def test_csv_has_a_line_per_image_under_its_names(cli: Cli) -> None:
    ran = cli("look", "photo.jpg", "--csv", *NET)
    (row,) = csv.DictReader(io.StringIO(ran.out))
    said = json.loads(cli("look", "photo.jpg", "--json", *NET).out)
    assert (ran.status, row["image"], row["reason"], row["open"]) == (
        0,
        "photo.jpg",
        "turn",
        "true",
    )
    assert float(row["turn_deg"]) == said["turn_deg"]
    assert float(row["left_px"]) == said["openings"][0]["left_px"] == pytest.approx(0.2 * 160 - 0.5)
    assert (row["look"], row["cut"], row["camera_assumed"]) == ("", "", "true")
    assert not Path("3ds-out").exists()
    both = cli("look", "photo.jpg", "--csv", "--json", *NET)
    assert both.status == 2 and "give one of them" in both.err


def test_folders_of_a_folder_are_looked_into_if_that_is_asked(cli: Cli) -> None:
    photo = Path("photo.jpg").read_bytes()
    for name in ("rooms/a.jpg", "rooms/up/b.jpg", "rooms/truth/a.depth.png", "rooms/.git/c.jpg"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_bytes(photo)

    def answered(*options: str) -> list[str]:
        ran = cli("look", "rooms", "--json", *NET, *options)
        return [json.loads(line)["image"] for line in ran.out.splitlines()]

    assert answered() == ["rooms/a.jpg"]
    assert answered("--recursive") == ["rooms/a.jpg", "rooms/up/b.jpg"]


def test_the_overlay_is_the_images_own_size_beside_the_page(cli: Cli) -> None:
    assert cli("look", "photo.jpg", *NET, "--style", "overlay").status == 0
    assert sorted(p.name for p in Path("3ds-out").iterdir()) == [
        "photo_3ds-overlay.jpg",
        "photo_3ds.jpg",
    ]
    assert read_image("3ds-out/photo_3ds-overlay.jpg").image.shape == (120, 160, 3)


def test_an_image_comes_from_an_address(cli: Cli) -> None:
    photo = Path("photo.jpg").read_bytes()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            found = self.path.startswith("/rooms/")
            self.send_response(200 if found else 404)
            self.end_headers()
            self.wfile.write(photo if found else b"no such thing")

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        base = f"http://user:secret@127.0.0.1:{server.server_port}"
        ran = cli("look", f"{base}/rooms/hall.jpg?size=1", f"{base}/gone.jpg", *NET)
        server.shutdown()
    assert ran.status == 1
    assert "turn left 13.2 deg" in ran.out
    assert "gone.jpg cannot be read: the server answered 404" in ran.err
    assert "secret" not in ran.err + ran.out
    assert Path("3ds-out/hall_3ds.jpg").is_file()
    nobody = cli("look", "http://127.0.0.1:9/a.jpg", *NET)
    assert nobody.status == 1
    assert "a.jpg cannot be read: the server does not answer" in nobody.err
