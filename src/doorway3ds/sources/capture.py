"""Webcams and RTSP streams, through OpenCV."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from typing import Any, Protocol

import cv2

from doorway3ds.errors import CallError, UserError
from doorway3ds.sources.address import query
from doorway3ds.sources.base import Capture, Shot
from doorway3ds.sources.reader import pixel_aspect, rgb, square

_TIMEOUT_MS = 5000
_STALL_S = 4.5


class Reader(Protocol):
    """The part of cv2.VideoCapture that is used; a test gives its own."""

    def isOpened(self) -> bool: ...

    def read(self) -> tuple[bool, Any]: ...

    def set(self, prop: int, value: float) -> bool: ...

    def get(self, prop: int, /) -> float: ...

    def release(self) -> None: ...


class OpenCvCapture:
    """A connection that OpenCV reads; `expected` says in an error what should be there."""

    def __init__(self, reader: Reader, expected: str) -> None:
        self._reader = reader
        self._begun = False
        self._aspect: float | None = None
        if not reader.isOpened():
            reader.release()
            raise UserError(f"expected {expected}, and none answers")

    def read(self) -> Shot | None:
        asked_s = time.monotonic()
        try:
            done, image = self._reader.read()
        except cv2.error as error:
            raise UserError(f"OpenCV cannot read it: {error.err}") from error
        stamp_s = time.monotonic()
        if not done or image is None:
            raise UserError("no image arrives any more")
        # At its own time-out FFmpeg hands out what its decoder still held, as if it were new.
        if self._begun and stamp_s - asked_s > _STALL_S:
            raise UserError(f"no image for {stamp_s - asked_s:.0f} s")
        self._begun = True
        if self._aspect is None:  # known for sure once an image was decoded
            self._aspect = pixel_aspect(self._reader)
        height, width = image.shape[:2]
        return Shot(square(rgb(image), self._aspect), stamp_s, sent=(width, height))

    def close(self) -> None:
        self._reader.release()


def webcam(
    uri: str, open_reader: Callable[[int | str], Reader] | None = None
) -> Callable[[], Capture]:
    """Connects to webcam://NUMBER or webcam:///dev/videoN, ?width=&height=&fps= asked for."""
    parts, options = query(uri, {"width": int, "height": int, "fps": float})
    device: int | str
    if re.fullmatch(r"\d{1,3}", parts.netloc) and parts.path in ("", "/"):
        device = int(parts.netloc)
    elif not parts.netloc and parts.path.startswith("/dev/"):
        device = parts.path
    else:
        raise CallError(f"{uri}: expected webcam://0, another number, or webcam:///dev/video0")
    wanted: dict[int, Any] = {
        cv2.CAP_PROP_FRAME_WIDTH: options.get("width"),
        cv2.CAP_PROP_FRAME_HEIGHT: options.get("height"),
        cv2.CAP_PROP_FPS: options.get("fps"),
        cv2.CAP_PROP_BUFFERSIZE: 1,
    }

    def connect() -> Capture:
        reader: Reader = (open_reader or cv2.VideoCapture)(device)
        capture = OpenCvCapture(reader, f"a camera as number {device}")
        for prop, value in wanted.items():
            if value is not None:
                reader.set(prop, value)
        return capture

    return connect


def stream(url: str) -> Callable[[], Capture]:
    """Connects to an rtsp:// address, over TCP unless OPENCV_FFMPEG_CAPTURE_OPTIONS says else."""

    def connect() -> Capture:
        limits = [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
            _TIMEOUT_MS,
            cv2.CAP_PROP_READ_TIMEOUT_MSEC,
            _TIMEOUT_MS,
        ]
        reader = cv2.VideoCapture(url, cv2.CAP_FFMPEG, limits)
        return OpenCvCapture(reader, "an RTSP stream")

    return connect
