"""Annotated films: frames at any times in, a video file of constant rate out."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path
from typing import TYPE_CHECKING

from doorway3ds.errors import CallError, UserError

if TYPE_CHECKING:
    import cv2
    import numpy as np
    from numpy.typing import NDArray

# Encoders that OpenCV's own FFmpeg brings; it has none for H.264.
_CODES = {".mp4": "mp4v", ".mkv": "mp4v", ".avi": "MJPG", ".webm": "VP80"}
_LONGEST_STILL_S = 2.0
_LIVE_FPS = 15.0


def require_film(path: Path | None) -> None:
    """CallError for a name whose suffix says no container that can be written."""
    if path is not None and path.suffix.lower() not in _CODES:
        raise CallError(f"--out {path} must end in {', '.join(_CODES)}")


class Film:
    """Writes under a temporary name; the film stands under its own once it is closed.

    Each image stays until the next one's time, 2 s at most, so that the film runs as fast as
    what it shows. The first image sets the size; others are scaled into it.
    """

    def __init__(self, path: Path, fps: float | None) -> None:
        self.path = path
        self.frames = 0
        self._fps = fps or _LIVE_FPS
        self._part = path.with_name(f".{secrets.token_hex(8)}.part{path.suffix}")
        self._writer: cv2.VideoWriter | None = None
        self._size = (0, 0)
        self._last: NDArray[np.uint8] | None = None
        self._last_s = 0.0
        self._owed = 0.0

    def add(self, image: NDArray[np.uint8], stamp_s: float) -> None:
        """image: (H, W, 3) uint8 RGB, shown from `stamp_s` on."""
        import cv2
        import numpy as np

        if self._writer is None:
            self._open(image.shape[1], image.shape[0])
        else:
            self._show_last(min(max(stamp_s - self._last_s, 0.0), _LONGEST_STILL_S))
        self._last = np.asarray(cv2.cvtColor(self._fit(image), cv2.COLOR_RGB2BGR), np.uint8)
        self._last_s = stamp_s

    def close(self) -> None:
        """Finishes the file. Raises UserError if it could not be written."""
        if self._writer is None:
            return
        self._show_last(1 / self._fps)
        self._writer.release()
        self._writer = None
        try:
            if self._part.stat().st_size == 0:
                raise UserError(f"cannot write {self.path}: the video is empty; is the disk full?")
            self._part.replace(self.path)
        except OSError as error:
            raise UserError(f"cannot write {self.path}: {error.strerror}") from error
        finally:
            with contextlib.suppress(OSError):
                self._part.unlink(missing_ok=True)

    def _open(self, width: int, height: int) -> None:
        import cv2

        # Encoders that halve the colours' resolution need even sides.
        self._size = (max(width // 2 * 2, 16), max(height // 2 * 2, 16))
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UserError(f"cannot write {self.path}: {error.strerror}") from error
        code = cv2.VideoWriter.fourcc(*_CODES[self.path.suffix.lower()])
        writer = cv2.VideoWriter(
            os.fspath(self._part), cv2.CAP_FFMPEG, code, self._fps, self._size, []
        )
        if not writer.isOpened():
            writer.release()
            raise UserError(
                f"cannot write {self.path}: no such folder, or no permission to write there"
            )
        self._writer = writer

    def _show_last(self, seconds: float) -> None:
        self._owed += seconds * self._fps
        while self._owed >= 0.5 and self._writer is not None and self._last is not None:
            self._writer.write(self._last)
            self.frames += 1
            self._owed -= 1

    def _fit(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Scaled into the film's size, with black beside it where the aspect is another."""
        import cv2
        import numpy as np

        width, height = self._size
        if image.shape[1] - width in (0, 1) and image.shape[0] - height in (0, 1):
            return image[:height, :width]
        scale = min(width / image.shape[1], height / image.shape[0])
        inner = (max(round(image.shape[1] * scale), 1), max(round(image.shape[0] * scale), 1))
        small = cv2.resize(image, inner, interpolation=cv2.INTER_AREA)
        framed = np.zeros((height, width, 3), np.uint8)
        top, left = (height - inner[1]) // 2, (width - inner[0]) // 2
        framed[top : top + inner[1], left : left + inner[0]] = small
        return framed
