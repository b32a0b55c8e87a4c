"""`3ds batch` as it is called: rows, taking up again, damage, death, a full disk."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import Cli
from tests.factories import encode, scene

pa = pytest.importorskip("pyarrow", reason="needs the extra 'batch'")
pytest.importorskip("fsspec", reason="needs the extra 'batch'")

import pyarrow.dataset as ds  # noqa: E402

from doorway3ds.lab.batch import rows as rows_module  # noqa: E402
from doorway3ds.lab.batch.items import Item  # noqa: E402
from doorway3ds.lab.batch.rows import SCHEMA, DataSet, unanswered  # noqa: E402

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
NET = ("--network", "net.onnx", "--workers", "2")


def table(folder: str = "out") -> list[dict[str, Any]]:
    keys = [("image", "ascending"), ("occurrence", "ascending")]
    rows: list[dict[str, Any]] = ds.dataset(folder).to_table().sort_by(keys).to_pylist()
    return rows


def images(count: int, folder: str = "in") -> None:
    Path(folder).mkdir(parents=True, exist_ok=True)
    for index in range(count):
        picture = scene(160, 120)
        picture[:10, :10] = index
        Path(folder, f"{index:03d}.png").write_bytes(encode(picture, "PNG"))


def test_rows_are_the_contract_of_look(cli: Cli) -> None:
    images(3)
    assert cli("batch", "in", "--out", "out", *NET).status == 0
    looked = [json.loads(line) for line in cli("look", "in", "--json", *NET[:2]).out.splitlines()]
    rows = table()
    assert len(rows) == 3
    for row, answer in zip(rows, looked, strict=True):
        answer.pop("timings_ms")
        camera = answer.pop("camera")
        assert row["camera"] == camera["name"]
        assert row["camera_assumed"] is camera["assumed"]
        assert set(answer) <= set(SCHEMA.names)
        assert {key: row[key] for key in answer} == answer


def test_the_papers_keys_have_columns(cli: Cli) -> None:
    images(1)
    assert cli("batch", "in", "--out", "out", "--method", "paper", *NET).status == 0
    looked = json.loads(cli("look", "in", "--json", "--method", "paper", *NET[:2]).out)
    (row,) = table()
    for key in ("max_pixel", "best_pixel", "trigger_pixel", "max_depth", "best_depth"):
        assert row[key] == looked[key]


def test_a_damaged_image_is_a_row_and_the_rest_is_answered(cli: Cli) -> None:
    images(2)
    Path("in/cut.jpg").write_bytes(encode(scene(160, 120))[:600])
    ran = cli("batch", "in", "--out", "out", *NET)
    assert ran.status == 1
    assert "2 answered, 0 unchanged, 1 errors" in ran.err
    errors = {row["image"]: row["error"] for row in table()}
    assert errors["in/000.png"] is None
    assert "in/cut.jpg is truncated" in errors["in/cut.jpg"]


def test_again_only_what_is_new_or_changed_is_decided(cli: Cli) -> None:
    images(4)
    cli("batch", "in", "--out", "out", *NET)
    first = table()
    images(5)
    Path("in/001.png").write_bytes(encode(scene(80, 60), "PNG"))
    ran = cli("batch", "in", "--out", "out", *NET)
    assert "2 answered, 3 unchanged, 0 errors" in ran.err
    rows = table()
    assert [row["image"] for row in rows] == [f"in/{n:03d}.png" for n in range(5)]
    assert [rows[n] for n in (0, 2, 3)] == [first[n] for n in (0, 2, 3)]
    assert (rows[1]["width"], rows[1]["digest"]) != (first[1]["width"], first[1]["digest"])


def test_rows_of_other_settings_are_not_mixed(cli: Cli) -> None:
    images(1)
    cli("batch", "in", "--out", "out", *NET)
    ran = cli("batch", "in", "--out", "out", *NET, "--width-m", "0.8")
    assert ran.status == 2
    assert "other settings (width_m)" in ran.err


def test_a_folder_in_use_is_refused(cli: Cli) -> None:
    images(1)
    with DataSet(Path("out"), {}):
        ran = cli("batch", "in", "--out", "out", *NET)
    assert ran.status == 2
    assert "is being written by another batch" in ran.err


def test_a_worker_that_dies_costs_only_the_image_that_kills_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    from doorway3ds.lab.batch.pool import answers

    chunks = [[(Item(f"{n}"), None), (Item(f"{n}b"), None)] for n in range(6)]
    deadly: Any = Deadly()
    found = {item.name: row for item, row in answers(chunks, deadly, 2)}
    assert list(found) == [item.name for chunk in chunks for item, _ in chunk]
    died = [name for name, row in found.items() if row is not None and row["error"]]
    assert died == ["3b"]
    assert "died twice" in found["3b"]["error"]  # type: ignore[index]


class Deadly:
    """A job whose pipeline ends the process that decides on item 3b."""

    view = annotate = depth = None

    def pipeline(self) -> object:
        from doorway3ds.lab.batch import worker

        def row(self: object, item: Item, known: str | None) -> dict[str, Any]:
            if item.name == "3b":
                os.kill(os.getpid(), signal.SIGKILL)
            return {"error": None}

        worker.Worker._row = row  # type: ignore[method-assign]
        return None


def test_killed_and_repeated_it_ends_with_the_same_rows(cli: Cli) -> None:
    images(60)
    cli("batch", "in", "--out", "whole", *NET)
    call = [sys.executable, "-c", FLUSHES, "batch", "in", "--out", "out", *NET]
    driver = subprocess.Popen(call, start_new_session=True)
    deadline = time.monotonic() + 120
    while not list(Path("out").glob("part-*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    driver.send_signal(signal.SIGKILL)
    driver.wait()
    assert 0 < len(table()) < 60
    # Its workers notice and go: nobody holds the folder or the cores.
    assert gone(driver.pid)
    ran = cli("batch", "in", "--out", "out", *NET)
    assert ran.status == 0
    assert table() == table("whole")


FLUSHES = """
import sys, time
from doorway3ds.cli.main import run
if __name__ == "__main__":
    from doorway3ds.lab.batch import rows
    rows.ROWS_PER_FILE = 8
    flush = rows.DataSet.flush
    # slow enough after each file to be killed between two of them
    rows.DataSet.flush = lambda self: (flush(self), time.sleep(1))
    sys.exit(run(sys.argv[1:]))
"""


def gone(session: int) -> bool:
    """Whether no process of this session is left, within ten seconds."""
    for _ in range(100):
        found = subprocess.run(["pgrep", "-s", str(session)], capture_output=True, text=True)
        if not found.stdout.strip():
            return True
        time.sleep(0.1)
    return False


def test_a_full_disk_is_one_line_and_keeps_what_was_written(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    images(3)
    cli("batch", "in/000.png", "--out", "out", *NET)
    before = table()
    write = rows_module.write_bytes

    def full(path: Path, data: bytes) -> Path:
        if str(path).startswith("out/part"):
            from doorway3ds.errors import UserError

            raise UserError(f"cannot write {path}: No space left on device")
        return write(path, data)

    monkeypatch.setattr(rows_module, "write_bytes", full)
    ran = cli("batch", "in", "--out", "out", *NET)
    assert ran.status == 1
    assert ran.err.splitlines()[-1].endswith("No space left on device")
    assert table() == before
    monkeypatch.setattr(rows_module, "write_bytes", write)
    assert "2 answered, 1 unchanged" in cli("batch", "in", "--out", "out", *NET).err


def test_where_nothing_can_be_written(cli: Cli) -> None:
    images(1)
    Path("out").write_text("a file")
    ran = cli("batch", "in", "--out", "out", *NET)
    assert ran.status == 1
    assert ran.err.startswith("3ds: cannot write out")


def test_what_could_not_be_read_is_tried_again(tmp_path: Path) -> None:
    with DataSet(tmp_path / "out", {}) as rows:
        rows.add(unanswered("far.jpg", 0, None, "far.jpg cannot be read: timed out"))
    with DataSet(tmp_path / "out", {}) as rows:
        assert rows.known("far.jpg", 0) is None
        assert len(rows) == 0


def test_annotated_images_depth_and_report(cli: Cli) -> None:
    pytest.importorskip("matplotlib")
    images(2, "in/a")
    images(2, "in/b")
    more = ("--annotate", "drawn", "--depth-dir", "depth", "--report")
    assert cli("batch", "in", "--out", "out", *NET, *more).status == 0
    assert len(list(Path("drawn").glob("*_3ds.jpg"))) == 2  # two contents under two names each
    assert len(list(Path("depth").glob("*.npy"))) == 2
    page = Path("out/_report/report.html").read_text()
    assert "in/a" in page
    assert "The least certain" in page
    assert len(table()) == 4  # the report is no part of the data set


def test_no_images(cli: Cli) -> None:
    Path("in").mkdir()
    ran = cli("batch", "in", "--out", "out", *NET)
    assert ran.status == 1
    assert "no image in in" in ran.err


def test_ray_gives_the_same_rows(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    ray = pytest.importorskip("ray", reason="needs the extra 'ray'")
    images(10)
    Path("in/cut.jpg").write_bytes(encode(scene(160, 120))[:600])
    net = str(Path("net.onnx").resolve())
    cli("batch", "in", "--out", "out", "--network", net, "--workers", "2")
    monkeypatch.setenv("RAY_TMPDIR", "/tmp")
    try:
        ran = cli(
            "batch", str(Path("in").resolve()), "--out", "ray", "--network", net, "--ray", "auto"
        )
    finally:
        ray.shutdown()
    assert ran.status == 1  # the damaged one
    mine, theirs = table(), table("ray")
    here = str(Path.cwd()) + "/"
    for row in theirs:
        row["image"] = row["image"].removeprefix(here)
        row["error"] = row["error"] and row["error"].replace(here, "")
    assert theirs == mine


def test_a_camera_that_contradicts_the_room_is_warned_of_once(cli: Cli) -> None:
    Path("in").mkdir()
    for name in ("a.jpg", "b.jpg"):
        shutil.copy(EXAMPLES / "doorway.jpg", Path("in", name))
    wrong = cli("batch", "in", "--out", "out", "--fov-deg", "80", *NET)
    assert wrong.status == 0
    assert wrong.err.count("has a focal length of 381 px") == 1
    again = cli("batch", "in", "--out", "out", "--fov-deg", "80", *NET)
    assert "focal length" not in again.err  # nothing was decided
    right = cli("batch", "in", "--out", "right", "--camera", "pepper-top", *NET)
    assert "focal length" not in right.err
