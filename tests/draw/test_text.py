"""Text in pictures: its room, its shape at every size, and characters of any kind."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from doorway3ds.draw.text import (
    CAP_HEIGHT,
    DESCENT,
    Weight,
    _coverage,
    balanced,
    draw_text,
    text_width,
    wrap,
)


def written(
    words: str, size: float, weight: Weight = "regular", at: tuple[float, float] = (10, 80)
) -> np.ndarray:
    """Coverage 0..1 of one line, (120, 1400)."""
    canvas = np.full((120, 1400, 3), 255, np.uint8)
    draw_text(canvas, words, at, size, (0, 0, 0), weight)
    return 1 - canvas[..., 0] / 255


@pytest.mark.parametrize("weight", ["regular", "semibold"])
@pytest.mark.parametrize("size", [12, 13.4, 20, 30, 60])
def test_text_takes_the_room_that_is_measured(size: float, weight: Weight) -> None:
    ink = written("Him · 12.4° (x) Öl−5 H", size, weight)
    columns = np.flatnonzero((ink > 0.4).any(axis=0))
    end = 10 + text_width("Him · 12.4° (x) Öl−5 H", size, weight)
    # An H stands off either end by less than a tenth of its size, on the pixel grid.
    assert 10 <= columns[0] <= 11 + size / 10
    assert end - 2 - size / 10 <= columns[-1] <= end
    # Capitals stand on the baseline and are as high as the layout takes them to be.
    rows = written("I", size, weight).sum(axis=1)
    assert rows[80:].sum() == 0
    stem = np.median(rows[rows > 0])
    assert rows.sum() / stem == pytest.approx(CAP_HEIGHT * size, abs=0.6)
    assert rows[79] > 0.6 * stem  # corners are round
    # Nothing reaches below the room for descenders.
    below = np.flatnonzero((written("gjpqy", size, weight) > 0.4).any(axis=1))[-1] - 79
    assert DESCENT * size - 2 < below < DESCENT * size + 1


@pytest.mark.parametrize("size", [12, 16, 20, 27, 40])
def test_text_keeps_its_shape_at_every_size(size: float) -> None:
    words = "Turn left 12.4°, the way is free"
    ink, large = written(words, size), written(words, 64)
    # Widths and the ink's area follow the size: no letter is moved or thickened to whole pixels.
    assert text_width(words, size) / size == pytest.approx(text_width(words, 64) / 64, rel=0.015)
    assert ink.sum() / size**2 == pytest.approx(large.sum() / 64**2, rel=0.015)
    # The edges are soft.
    assert len(np.unique(ink)) > 100
    assert written(words, size, "semibold").sum() > 1.2 * ink.sum()


def test_a_line_may_leave_the_canvas_and_hold_any_character() -> None:
    canvas = np.full((60, 600, 3), 255, np.uint8)
    draw_text(canvas, "clipped", (590, -3), 30, (0, 0, 0))
    draw_text(canvas, "clipped", (-40, 70), 30, (0, 0, 0))
    draw_text(canvas, "far away", (5000, 5000), 30, (0, 0, 0))
    question = written("?", 30)
    for known in "°·−×…Ö":
        assert not np.array_equal(written(known, 30), question)
    # What cannot be drawn becomes a question mark: private, control and half characters.
    for unknown in ("\ue000", "\x07", "\ud800"):
        assert np.array_equal(written(unknown, 30), question)
    assert np.array_equal(written("a\nb\u00a0c", 30), written("a b c", 30))
    assert text_width("", 30) == 0


def test_threads_that_draw_at_once_draw_the_same() -> None:
    styles = [(size, weight) for size in (12.0, 21.0, 60.0) for weight in ("regular", "semibold")]
    draw_line = _coverage.__wrapped__  # without its memory
    expected = [draw_line("Turn left 12.4°", *style) for style in styles]

    def differs(seed: int) -> int:
        order = np.random.default_rng(seed).integers(len(styles), size=60)
        return sum(
            not np.array_equal(draw_line("Turn left 12.4°", *styles[i]), expected[i]) for i in order
        )

    with ThreadPoolExecutor(4) as pool:
        assert sum(pool.map(differs, range(4))) == 0


def test_lines_keep_to_their_width_and_lose_no_word() -> None:
    words = "An open doorway 12.4° to the left, 2.8\u00a0m away, but something stands in the way."
    for make in (wrap, balanced):
        lines = make(words, 20, 260, max_lines=6)
        assert " ".join(lines) == words
        assert all(text_width(line, 20) <= 260 for line in lines)
    name = "a-network-with-a-long-name+another-one"
    assert "".join(wrap(name, 20, 200)) == name
    short = wrap(words, 20, 260, max_lines=1)
    assert len(short) == 1
    assert short[0].endswith("…")


STORM = """
import signal, time
from doorway3ds.draw.text import text_width

def interrupt(number, frame):
    while frame is not None:
        if frame.f_code.co_name == "text_width":
            raise KeyboardInterrupt
        frame = frame.f_back

text_width("started", 20.0)
signal.signal(signal.SIGALRM, interrupt)
signal.setitimer(signal.ITIMER_REAL, 0.0005, 0.0005)
end, caught, number = time.monotonic() + 1.5, 0, 0
while time.monotonic() < end:
    number += 1
    try:
        text_width(str(number), 20.0)
    except KeyboardInterrupt:
        caught += 1
signal.setitimer(signal.ITIMER_REAL, 0)
print(caught)
"""


def test_a_signal_may_interrupt_text_at_any_time() -> None:
    ran = subprocess.run([sys.executable, "-c", STORM], capture_output=True, text=True, timeout=60)
    assert ran.returncode == 0, ran.stderr
    assert int(ran.stdout) > 20


def test_text_is_measured_in_a_forked_process_too() -> None:
    width = text_width("before", 20.0)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        forked = pool.apply_async(text_width, ("after", 20.0)).get(timeout=30)
    assert forked == text_width("after", 20.0) != width
