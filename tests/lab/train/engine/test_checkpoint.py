from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.errors import UserError
from doorway3ds.lab.train.engine import checkpoint

# Writes one checkpoint, then hangs in the middle of the next.
_HANGS = """
import sys, time
import numpy as np
from pathlib import Path
from doorway3ds.lab.train.engine import checkpoint

class Slow:
    def __array__(self, dtype=None, copy=None):
        print("in the middle", flush=True)
        time.sleep(60)

path = Path(sys.argv[1])
checkpoint.save(path, {"w": np.full(1000, 1.0)}, {"epoch": 1})
checkpoint.save(path, {"w": np.full(100_000, 2.0), "x": Slow()}, {"epoch": 2})
"""


def test_round_trip(tmp_path: Path) -> None:
    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.array([True])}
    path = checkpoint.save(tmp_path / "new" / "c.npz", arrays, {"epoch": 3, "best": 0.25})
    found, state = checkpoint.load(path)
    assert state == {"epoch": 3, "best": 0.25}
    assert found.keys() == arrays.keys()
    assert all(np.array_equal(found[k], arrays[k]) for k in arrays)


def test_a_process_killed_while_writing_leaves_the_earlier_one(tmp_path: Path) -> None:
    path = tmp_path / "c.npz"
    process = subprocess.Popen([sys.executable, "-c", _HANGS, str(path)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"in the middle\n"
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    process.stdout.close()
    arrays, state = checkpoint.load(path)
    assert state == {"epoch": 1} and arrays["w"].tolist() == [1.0] * 1000
    checkpoint.save(path, {}, {"epoch": 2})
    assert checkpoint.load(path)[1] == {"epoch": 2}
    assert [file.name for file in tmp_path.iterdir()] == ["c.npz"]


def test_a_full_disk_keeps_the_earlier_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = checkpoint.save(tmp_path / "c.npz", {}, {"epoch": 1})

    def full(file, **arrays) -> None:  # type: ignore[no-untyped-def]
        file.write(b"half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(UserError, match="No space left on device; the one before it is kept"):
        checkpoint.save(path, {}, {"epoch": 2})
    assert checkpoint.load(path)[1] == {"epoch": 1}
    assert [file.name for file in tmp_path.iterdir()] == ["c.npz"]


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 half a file", b"text"])
def test_a_damaged_one_is_said_in_one_line(tmp_path: Path, damage: bytes) -> None:
    path = tmp_path / "c.npz"
    path.write_bytes(damage)
    with pytest.raises(UserError, match="is damaged") as caught:
        checkpoint.load(path)
    assert "\n" not in str(caught.value)
