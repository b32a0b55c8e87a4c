"""Files are whole or not there."""

from __future__ import annotations

from pathlib import Path

import pytest

from doorway3ds.errors import UserError
from doorway3ds.files import write_bytes


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
