"""Files are whole or not there."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from doorway3ds.errors import CallError, UserError
from doorway3ds.files import alone, write_bytes


def test_writes_and_makes_the_folder(tmp_path: Path) -> None:
    path = write_bytes(tmp_path / "a" / "b.bin", b"123")
    assert path.read_bytes() == b"123"
    assert [p.name for p in path.parent.iterdir()] == ["b.bin"]


@pytest.mark.parametrize(
    ("error", "raised"),
    [
        (OSError(28, "No space left on device"), UserError),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ],
)
def test_a_failed_write_leaves_the_old_file_and_no_other(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    raised: type[BaseException],
) -> None:
    path = write_bytes(tmp_path / "b.bin", b"old")

    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(raised):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["b.bin"]


def test_says_where_it_cannot_write(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match=r"cannot write .*file/x: "):
        write_bytes(tmp_path / "file" / "x", b"")


def test_a_name_may_be_as_long_as_the_file_system_allows(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 251 + ".bin")
    assert write_bytes(path, b"whole").read_bytes() == b"whole"


@pytest.mark.parametrize("file", ["", "lock"])
def test_a_folder_in_use_is_refused_until_it_is_free(tmp_path: Path, file: str) -> None:
    busy = "another has it"
    with alone(tmp_path, file=file), pytest.raises(CallError, match=busy):
        alone(tmp_path, busy, file=file).__enter__()
    with pytest.raises(RuntimeError), alone(tmp_path, busy, file=file):
        raise RuntimeError
    with alone(tmp_path, busy, file=file):
        pass


def test_who_waits_has_the_folder_after_the_first(tmp_path: Path) -> None:
    order: list[str] = []

    def second() -> None:
        asked.set()
        with alone(tmp_path):
            order.append("second")

    asked, thread = threading.Event(), threading.Thread(target=second)
    with alone(tmp_path):
        thread.start()
        asked.wait()
        thread.join(0.1)
        order.append("first")
    thread.join()
    assert order == ["first", "second"]


@pytest.mark.parametrize("file", ["", "lock"])
def test_says_which_folder_cannot_be_had_alone(tmp_path: Path, file: str) -> None:
    with pytest.raises(UserError, match=r"cannot write to .*gone: No such file"):
        alone(tmp_path / "gone", file=file).__enter__()
    assert not (tmp_path / "gone").exists()
