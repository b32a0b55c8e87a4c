"""Anti-aliased text in OpenCV's built-in variable font, measured and set to fractions of a pixel.

OpenCV puts letters at whole pixels, which leaves small text cramped and uneven. So a line is
drawn a few times larger and averaged down.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable
from functools import lru_cache
from queue import SimpleQueue
from typing import Any, Literal, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.threads import Worker

Image = NDArray[np.uint8]
Color = tuple[int, int, int]
Weight = Literal["regular", "semibold"]
Anchor = Literal["left", "center", "right"]

# Of the em, measured on the font at 1000 pixels.
CAP_HEIGHT = 0.70  # from the baseline up
DESCENT = 0.22  # from the baseline down, of Latin letters
_ASCENDER = 0.935  # what OpenCV takes for the size of a font
_ABOVE, _BELOW, _BESIDE = 1.05, 0.40, 0.12  # room round a line for accents and overhang
_WEIGHTS: dict[Weight, int] = {"regular": 400, "semibold": 600}
_FINEST = 8  # times larger than wanted
_KEPT = 128  # pixels; letters larger than that OpenCV shapes anew at every call
_thread = threading.local()
T = TypeVar("T")


class _Aside:
    """A thread that calls what it is handed, without a lock that an interrupt could leave shut."""

    def __init__(self) -> None:
        self._calls: SimpleQueue[tuple[Callable[[], object], SimpleQueue[Any]] | None]
        self._calls = SimpleQueue()
        Worker(self._run, "text", self._stop)

    def _stop(self) -> None:
        _aside.cache_clear()
        self._calls.put(None)

    def __call__(self, call: Callable[[], T]) -> T:
        answers: SimpleQueue[tuple[T, BaseException | None]] = SimpleQueue()
        self._calls.put((call, answers))
        answer, error = answers.get()
        if error is not None:
            raise error
        return answer

    def _run(self) -> None:
        while (job := self._calls.get()) is not None:
            call, answers = job
            try:
                answers.put((call(), None))
            except BaseException as error:
                answers.put((None, error))


_aside = lru_cache(maxsize=1)(_Aside)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_aside.cache_clear)  # the thread stays with the parent


def _apart(call: Callable[[cv2.FontFace], T]) -> T:
    """`call(font)`, never in the main thread.

    OpenCV 5 tries the overloads of its text functions by their errors, and reading such an error
    lets Python handle signals, in the main thread alone: a handler that raises there, such as
    that of Ctrl-C, makes OpenCV read from address 8.
    """
    if threading.current_thread() is threading.main_thread():
        return _aside()(lambda: call(_face()))
    return call(_face())


def _face() -> cv2.FontFace:
    """The font of this thread; one face in two threads at once mixes their sizes and weights."""
    if not hasattr(_thread, "face"):
        _thread.face = cv2.FontFace("sans")
    face: cv2.FontFace = _thread.face
    return face


def _printable(text: str) -> str:
    """One line of `text`; OpenCV breaks at newlines and crashes at half a surrogate pair."""
    return "".join(" " if c.isspace() else c if c.isprintable() else "?" for c in text)


def _enlarged(size: float) -> tuple[int, int]:
    """How many times larger a line is drawn, and OpenCV's size for it."""
    pixels = size * _ASCENDER
    times = max(1, min(_FINEST, int(_KEPT / max(pixels, 1.0))))
    return times, max(1, round(pixels * times))


@lru_cache(maxsize=1024)
def _advance(text: str, pixels: int, weight: Weight) -> int:
    """From the pen's start to its end in pixels of the enlarged line; `text` is printable."""
    if not text:
        return 0
    # The box reaches one pixel beyond the pen.
    weighs = _WEIGHTS[weight]
    box = _apart(lambda face: cv2.getTextSize((0, 0), text, (0, 0), face, pixels, weighs))
    return int(box[2]) - 1


def text_width(text: str, size: float, weight: Weight = "regular") -> float:
    """Advance of one line in pixels."""
    times, pixels = _enlarged(size)
    return _advance(_printable(text), pixels, weight) / times


@lru_cache(maxsize=256)
def _coverage(text: str, size: float, weight: Weight) -> NDArray[np.uint8]:
    """(h, w) coverage 0..255; the pen starts at `_origin(size)`."""
    times, pixels = _enlarged(size)
    left, baseline = _origin(size)
    width = 2 * left + math.ceil(_advance(text, pixels, weight) / times)
    height = baseline + math.ceil(_BELOW * size)
    fine = np.zeros((height * times, width * times), np.uint8)
    at = (left * times, baseline * times)
    weighs = _WEIGHTS[weight]
    _apart(lambda face: cv2.putText(fine, text, at, (255,), face, pixels, weighs))
    small = np.asarray(cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    small.setflags(write=False)
    return small


def _origin(size: float) -> tuple[int, int]:
    """Column and row in a line's coverage at which the pen starts."""
    return 1 + math.ceil(_BESIDE * size), math.ceil(_ABOVE * size)


def blend(canvas: Image, coverage: NDArray[Any], origin: tuple[int, int], color: Color) -> None:
    """Paint `color` through `coverage` ((h, w) uint8) with its corner at `origin` (x, y).

    What falls outside the canvas is left out.
    """
    x, y = origin
    height, width = coverage.shape
    x0, y0 = max(x, 0), max(y, 0)
    x1, y1 = min(x + width, canvas.shape[1]), min(y + height, canvas.shape[0])
    if x0 >= x1 or y0 >= y1:
        return
    alpha = coverage[y0 - y : y1 - y, x0 - x : x1 - x, None].astype(np.float32) / 255
    region = canvas[y0:y1, x0:x1]
    region[:] = np.round(region + (np.array(color, np.float32) - region) * alpha).astype(np.uint8)


def draw_text(
    canvas: Image,
    text: str,
    at: tuple[float, float],
    size: float,
    color: Color,
    weight: Weight = "regular",
    anchor: Anchor = "left",
) -> None:
    """Write one line into `canvas`; `at` is the (x, y) of its baseline, `size` the em in pixels."""
    if not text:
        return
    shift = {"left": 0.0, "center": 0.5, "right": 1.0}[anchor] * text_width(text, size, weight)
    left, baseline = _origin(size)
    corner = (round(at[0] - shift) - left, round(at[1]) - baseline)
    blend(canvas, _coverage(_printable(text), size, weight), corner, color)


def wrap(
    text: str, size: float, width: float, weight: Weight = "regular", max_lines: int = 3
) -> list[str]:
    """Break `text` at spaces into lines of at most `width` pixels; what is left over is cut (…).

    A no-break space keeps a number and its unit together.
    """
    lines: list[str] = []
    current = ""
    for word in _words(text, size, width, weight):
        longer = f"{current} {word}" if current else word
        if current and text_width(longer, size, weight) > width:
            lines.append(current)
            current = word
        else:
            current = longer
    lines.append(current)
    kept = lines[:max_lines]
    if len(lines) > max_lines:
        kept[-1] += "…"
    return [_fitted(line, size, width, weight) for line in kept]


def _words(text: str, size: float, width: float, weight: Weight) -> list[str]:
    """The words of a text; one wider than a line is cut in pieces, best after a - _ / or +."""
    words = []
    for word in text.split(" "):
        rest = word
        while len(rest) > 1 and text_width(rest, size, weight) > width:
            fits = next(
                (n for n in range(len(rest), 0, -1) if text_width(rest[:n], size, weight) <= width),
                1,
            )
            sign = max(rest.rfind(mark, 0, fits) for mark in "-_/+") + 1
            cut = sign if sign > fits // 3 else fits
            words.append(rest[:cut])
            rest = rest[cut:]
        words.append(rest)
    return words


def balanced(
    text: str, size: float, width: float, weight: Weight = "regular", max_lines: int = 3
) -> list[str]:
    """Like `wrap`, with lines of about one length rather than a last one of two words."""
    lines = wrap(text, size, width, weight, max_lines)
    for share in np.arange(0.5, 1.0, 0.05):
        narrow = wrap(text, size, float(share) * width, weight, max_lines + 1)
        if len(narrow) == len(lines):
            return narrow if not narrow[-1].endswith("…") else lines
    return lines


def _fitted(line: str, size: float, width: float, weight: Weight) -> str:
    """The line, shortened with an ellipsis where it is wider than `width` pixels."""
    if text_width(line, size, weight) <= width:
        return line
    kept = line.rstrip("…")
    while kept and text_width(kept + "…", size, weight) > width:
        kept = kept[:-1].rstrip()
    return kept + "…"
