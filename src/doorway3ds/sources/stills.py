"""Images one after another: a file, a folder, a pattern, or standard input."""

from __future__ import annotations

import select
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from doorway3ds.errors import UserError
from doorway3ds.images.codec import read_image
from doorway3ds.sources.base import Source, View
from doorway3ds.sources.clock import Clock
from doorway3ds.sources.splitter import Splitter
from doorway3ds.types import Frame

_CHUNK = 1 << 16


class Stills(Source):
    """Image files in the order given, as if taken `fps` times a second.

    pace: hand them out at that rate; where the reader is slower, it gets them later, none is
        left out. loop: begin again at the end.
    """

    def __init__(
        self,
        name: str,
        paths: Sequence[Path],
        view: View | None = None,
        *,
        fps: float | None = None,
        pace: bool = False,
        loop: bool = False,
    ) -> None:
        super().__init__(name)
        if not paths:
            raise UserError(f"{name} holds no image; expected .jpg, .png, .webp, .tif, .bmp, .ppm")
        self._paths, self._view = list(paths), view or View()
        self.fps = self._rate = fps or 10.0
        self._pace, self._loop = pace, loop
        self._clock = Clock()
        self._next = 0
        self._answered = 0

    def read(self, timeout_s: float | None = None) -> Frame | None:
        while not self.ended:
            turn, place = divmod(self._next, len(self._paths))
            if turn and (place == 0 or self.ended) and not (self._loop and self._answered):
                self.ended = True
                return None
            stamp_s = self._next / self._rate
            if self._pace:
                if not self._clock.wait_for(stamp_s, timeout_s):
                    return None
                self._clock.delay(max(self._clock.late_s(stamp_s), 0.0))
            path = self._paths[place]
            self._next += 1
            try:
                picture = read_image(path)
                frame = self._view.of_picture(picture, stamp_s)
                self.orientation = picture.orientation
            except UserError as error:
                self._leave_out(path, error)
                continue
            self._answered += 1
            self.frame_name = str(path)
            return frame
        return None

    def _leave_out(self, path: Path, error: UserError) -> None:
        self.damaged += 1
        line = str(error) if str(path) in str(error) else f"{path}: {error}"
        if not self._answered and self._next >= len(self._paths):
            self.ended = True
            raise UserError(line) from error
        self.notice(line)

    def close(self) -> None:
        self.ended = True
        self._clock.stop()


class StreamOfImages(Source):
    """Images one after another on standard input, such as `ffmpeg -f image2pipe` writes.

    Each is answered; who writes waits meanwhile. fps: they count as taken that often; default:
    when they came.
    """

    def __init__(
        self,
        view: View | None = None,
        *,
        fps: float | None = None,
        stream: BinaryIO | None = None,
    ) -> None:
        super().__init__("-")
        if stream is None:
            if sys.stdin is None or sys.stdin.isatty():
                raise UserError("- means images on standard input, but nothing is piped in")
            stream = sys.stdin.buffer
        self._stream, self._view, self.fps = stream, view or View(), fps
        self._splitter = Splitter()
        self._waiting: list[bytes] = []
        self._count = 0
        self._answered = 0

    def read(self, timeout_s: float | None = None) -> Frame | None:
        while not self.ended:
            if not self._waiting:
                if not self._comes(timeout_s):
                    return None
                self._fill()
                continue
            data = self._waiting.pop(0)
            self._count += 1
            stamp_s = time.monotonic() if self.fps is None else (self._count - 1) / self.fps
            name = f"image {self._count} of standard input"
            try:
                picture = read_image(data, name=name)
                frame = self._view.of_picture(picture, stamp_s)
                self.orientation = picture.orientation
            except UserError as error:
                self.damaged += 1
                self.notice(str(error))
                continue
            self._answered += 1
            self.frame_name = f"-#{self._count}"
            return frame
        return None

    def _comes(self, timeout_s: float | None) -> bool:
        """Waits until there is something to read, or the end; False after `timeout_s`."""
        if timeout_s is None:
            return True
        try:
            # Nothing lies in the stream's own buffer: `read1` hands out all that it took.
            return bool(select.select([self._stream], [], [], timeout_s)[0])
        except (OSError, ValueError, TypeError):  # no pipe, or a system that waits for sockets only
            return True

    def _fill(self) -> None:
        chunk = self._stream.read1(_CHUNK) if hasattr(self._stream, "read1") else b""
        self._waiting += self._splitter.feed(chunk) if chunk else self._splitter.rest()
        if not chunk and not self._waiting:
            self.ended = True
            if not self._answered:
                raise UserError("standard input held no image that could be read")

    def close(self) -> None:
        self.ended = True
