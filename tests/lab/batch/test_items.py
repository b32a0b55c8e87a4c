"""Where a batch's images are found, near and far, and what each is called."""

from __future__ import annotations

import io
import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from doorway3ds.errors import CallError, UserError
from tests.factories import encode, scene

pa = pytest.importorskip("pyarrow", reason="needs the extra 'batch'")
fsspec = pytest.importorskip("fsspec", reason="needs the extra 'batch'")

import pyarrow.parquet as pq  # noqa: E402

from doorway3ds.lab.batch.items import count_items, find_items  # noqa: E402

A, B = encode(scene(64, 48)), encode(scene(48, 64))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in" / "b").mkdir(parents=True)
    (tmp_path / "in" / ".cache").mkdir()
    (tmp_path / "in" / "b" / "2.jpg").write_bytes(B)
    (tmp_path / "in" / "1.JPG").write_bytes(A)
    (tmp_path / "in" / "notes.md").write_text("no image")
    (tmp_path / "in" / ".cache" / "3.jpg").write_bytes(A)
    return tmp_path


def named(*sources: str) -> dict[str, bytes]:
    return {item.name: item.read() for item in find_items(list(sources))}


def test_folders_are_walked_in_name_order_without_what_is_hidden(folder: Path) -> None:
    assert list(named("in")) == ["in/1.JPG", "in/b/2.jpg"]
    assert named("in") == {"in/1.JPG": A, "in/b/2.jpg": B}
    assert count_items(["in"]) == 2


def test_patterns_and_lists(folder: Path) -> None:
    assert list(named("in/**/*.jpg")) == ["in/b/2.jpg"]
    (folder / "all.txt").write_text("# two of one\nin/1.JPG\n\nin/1.JPG\nin/b/2.jpg\n")
    found = list(find_items(["all.txt"]))
    assert [(item.name, item.occurrence) for item in found] == [
        ("in/1.JPG", 0),
        ("in/1.JPG", 1),
        ("in/b/2.jpg", 0),
    ]


@pytest.mark.parametrize("suffix", [".tar", ".tar.gz"])
def test_shards_are_counted_up_and_read_by_member(folder: Path, suffix: str) -> None:
    for number in (8, 9):
        with tarfile.open(f"s-0{number}{suffix}", "w:gz" if suffix.endswith("gz") else "w") as tar:
            for name, data in (("x.jpg", A), ("x.json", b"{}"), ("sub/y.png", B)):
                member = tarfile.TarInfo(name)
                member.size = len(data)
                tar.addfile(member, io.BytesIO(data))
    found = named(f"s-{{08..09}}{suffix}")
    assert list(found) == [
        f"s-0{n}{suffix}/{name}" for n in (8, 9) for name in ("x.jpg", "sub/y.png")
    ]
    assert list(found.values()) == [A, B, A, B]


def test_tables_with_bytes_and_with_structs(folder: Path) -> None:
    pq.write_table(pa.table({"path": ["a.jpg", "b.jpg"], "image": [A, B]}), "flat.parquet")
    structs = pa.array([{"bytes": B, "path": None}, {"bytes": A, "path": None}])
    pq.write_table(pa.table({"label": [0, 1], "image": structs}), "nested.parquet")
    assert named("flat.parquet") == {"flat.parquet/a.jpg": A, "flat.parquet/b.jpg": B}
    assert named("nested.parquet") == {"nested.parquet/0": B, "nested.parquet/1": A}
    pq.write_table(pa.table({"label": [0]}), "none.parquet")
    with pytest.raises(UserError, match=r"none.parquet has no column of image bytes.* got label"):
        named("none.parquet")


def test_any_file_system_of_fsspec(folder: Path) -> None:
    memory = fsspec.filesystem("memory")
    memory.pipe("/bucket/hall/2.jpg", B)
    memory.pipe("/bucket/1.jpg", A)
    memory.pipe("/bucket/list.txt", b"memory://bucket/1.jpg\n")
    assert named("memory://bucket/") == {
        "memory:///bucket/1.jpg": A,
        "memory:///bucket/hall/2.jpg": B,
    }
    assert named("memory://bucket/list.txt") == {"memory://bucket/1.jpg": A}
    with pytest.raises(UserError, match="holds no image"):
        named("memory://empty/")


def test_films_are_items_by_frame(folder: Path) -> None:
    writer = cv2.VideoWriter("film.avi", cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for value in (0, 120, 240):
        writer.write(np.full((48, 64, 3), value, np.uint8))
    writer.release()
    frames = list(find_items(["film.avi"]))
    assert [item.name for item in frames] == ["film.avi#0", "film.avi#1", "film.avi#2"]
    means = [item.frame.image.mean() for item in frames if item.frame is not None]
    assert means == pytest.approx([0, 120, 240], abs=3)


def test_what_is_missing_is_said_before_anything_is_read(folder: Path) -> None:
    with pytest.raises(CallError, match="gone does not exist"):
        next(find_items(["in", "gone"]))
    (folder / "half.tar").write_bytes(b"x" * 600)
    with pytest.raises(UserError, match=r"half.tar is not a tar archive"):
        list(find_items(["half.tar"]))
