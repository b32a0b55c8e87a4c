from __future__ import annotations

import io
import sys

import pytest
from rich.console import Console

from doorway3ds.cli.shared.progress import Progress
from doorway3ds.cli.shared.training import Watch


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_live_line_fits_and_tells_the_time_left_by_the_pace(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shown, now = Terminal(), [0.0]
    monkeypatch.setattr(sys, "stderr", shown)
    console = Console(
        file=shown,
        width=72,
        force_terminal=True,
        no_color=True,
        get_time=lambda: now[0],
        _environ={"TERM": "xterm"},
    )
    watch = Watch(4, console)
    losses = {f"part{n}": 1.0 for n in range(9)} | {"loss": 9.5}
    for epoch in (1, 2):
        for step in (1, 2, 3):
            now[0] += 60
            watch.batch(epoch, step, 3, losses)
        watch.epoch({"epoch": epoch, "loss": 9.5})
    text = shown.getvalue()
    assert "epoch 1  loss 9.5000\n" in text and "epoch 2  loss 9.5000\n" in text
    assert "2/4" in text and "loss 9.5000" in text
    assert "0:06:00" in text  # six batches are left, a minute each


def test_a_count_is_shown_on_a_terminal_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    for stream, watched in ((Terminal(), True), (io.StringIO(), False)):
        monkeypatch.setattr(sys, "stderr", stream)
        with Progress() as count:
            for done in range(4):
                count(done, 3)
        assert ("/3" in stream.getvalue()) is watched
