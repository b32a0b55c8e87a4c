from __future__ import annotations

import io
import os
import shutil
import sys
import time

import pytest

from doorway3ds.cli.shared.training import Watch


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_live_line_fits_and_tells_the_time_left_by_the_last_pace(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shown, now = Terminal(), [0.0]
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr(shutil, "get_terminal_size", lambda: os.terminal_size((60, 24)))
    watch = Watch(4)
    losses = {f"part{n}": 1.0 for n in range(9)} | {"loss": 9.5}
    for epoch, pace in ((1, 1.0), (2, 60.0)):
        for step in (1, 2, 3):
            now[0] += pace
            watch.batch(epoch, step, 3, losses)
        watch.epoch({"epoch": epoch, "loss": 9.5})
    lines = [part for part in shown.getvalue().replace("\n", "\r\x1b[K").split("\r\x1b[K") if part]
    bar = "━" * 13 + "─" * 7
    assert lines[1].startswith(f"1/4 {bar} 0:00:10 left  loss 9.5000  part0 1")
    assert len(lines[1]) == 59
    assert all(len(line) < 60 for line in lines)
    assert lines[3] == "epoch 1  loss 9.5000"
    # six batches are left, a minute each, as the last epoch's were
    assert "0:06:00 left" in lines[6]
