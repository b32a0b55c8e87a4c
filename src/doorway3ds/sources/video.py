"""Video files."""

from __future__ import annotations

import contextlib
import math
import threading
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import UserError
from doorway3ds.images.codec import read_image
from doorway3ds.images.decode import size_of
from doorway3ds.sources.base import Source, SourceLost, View
from doorway3ds.sources.clock import Clock
from doorway3ds.sources.reader import codec_of, orientation, pixel_aspect, rgb, square
from doorway3ds.types import Frame

_ASSUMED_FPS = 30.0
_MOST_SKIPPED_S = 1.0  # of film at a stretch, so that a slow reader still sees something
_SHORT = 0.9  # less than this fraction of the length and of the frames announced: it is cut
_HIGHEST_FPS = 240.0  # what announces more counts ticks of a clock, not frames
_MEASURED = 30
_MOTION_JPEG = (b"mjpg", b"jpeg")
_UNDECODED = -1  # value of CAP_PROP_FORMAT


class VideoFile(Source):
    """The frames of a video file, all of them or, paced, those that are due.

    pace: the film runs as on a screen; frames whose time passes while the reader is busy are
        skipped and counted. loop: begin again at the end, stamps going on.

    Motion JPEG is decoded here, strictly; FFmpeg conceals what is damaged.

    Raises SourceLost after the last readable frame of a file that announced many more.
    """

    def __init__(
        self, path: Path, view: View | None = None, *, pace: bool = False, loop: bool = False
    ) -> None:
        super().__init__(str(path))
        self._path, self._view = path, view or View()
        self._pace, self._loop = pace, loop
        self._clock = Clock()
        self._jpegs = False
        self._lock = threading.Lock()  # OpenCV's readers must not be released while they read
        self._jpegs = _holds_jpegs(self._open())
        self._film = self._open()
        rate = self._film.get(cv2.CAP_PROP_FPS)
        count = self._film.get(cv2.CAP_PROP_FRAME_COUNT)
        sound = math.isfinite(rate) and rate > 0
        self._announced = int(count) if math.isfinite(count) and 0 < count < 1e9 else 0
        self._length_s = self._announced / rate if sound else 0.0
        self.fps = rate if sound and rate <= _HIGHEST_FPS else self._measured_fps()
        self._period_s = 1 / self.fps
        self._aspect, self.orientation = pixel_aspect(self._film), orientation(self._film)
        self._number = 0
        self._begun_s, self._last_s = 0.0, -self._period_s
        self._pending: float | None = None

    def _open(self) -> cv2.VideoCapture:
        film = cv2.VideoCapture(str(self._path.resolve()), cv2.CAP_FFMPEG)
        if self._jpegs:
            film.set(cv2.CAP_PROP_FORMAT, _UNDECODED)
        if not film.isOpened():
            film.release()
            self._refuse_codec()
            raise UserError(
                f"{self.name} cannot be opened as a video; expected a file that FFmpeg reads, whole"
            )
        return film

    def _refuse_codec(self) -> None:
        """UserError if the film is of a codec that OpenCV's FFmpeg may lack."""
        codec = codec_of(self._path)
        if codec is not None:
            raise UserError(
                f"{self.name} is {codec}, which OpenCV's FFmpeg does not decode here; convert it, "
                f"as in: ffmpeg -i {self._path.name} -c:v libx264 film.mp4"
            )

    def _measured_fps(self) -> float:
        """The rate by the first frames' own times; a film of variable rate announces any."""
        film = self._open()
        stamps: list[float] = []
        while len(stamps) < _MEASURED and film.grab():
            stamps.append(film.get(cv2.CAP_PROP_POS_MSEC) / 1000)
        film.release()
        if len(stamps) < 2 or not stamps[-1] > stamps[0]:
            return _ASSUMED_FPS
        return min((len(stamps) - 1) / (stamps[-1] - stamps[0]), _HIGHEST_FPS)

    def read(self, timeout_s: float | None = None) -> Frame | None:
        while not self.ended:
            if self._pending is None:
                self._pending = self._advance()
            elif self._pace and not self._clock.wait_for(self._pending, timeout_s):
                return None
            elif self._pace and self._overdue(self._pending):
                self.skipped += 1
                self._pending = self._advance()
            else:
                stamp_s, self._pending = self._pending, None
                image = self._picture()
                if image is not None:
                    self.frame_name = f"{self.name}#{self._number}"
                    height, width = image.shape[:2]
                    return self._view.frame(
                        square(image, self._aspect),
                        stamp_s,
                        orientation=self.orientation,
                        sent=(width, height),
                    )
        return None

    def _overdue(self, stamp_s: float) -> bool:
        """Whether the next frame is due, too, so that this one may be skipped."""
        late_s = self._clock.late_s(stamp_s)
        if late_s < self._period_s:
            return False
        if late_s > _MOST_SKIPPED_S:
            self._clock.delay(late_s)
            return False
        return not self._announced or self._number < self._announced

    def _advance(self) -> float | None:
        """Goes to the next frame and gives its stamp; None at the end of the film."""
        with self._lock:
            if self.ended:
                return None
            if not self._film.grab():
                self._finish()
                return None
            self._number += 1
            at_s = self._film.get(cv2.CAP_PROP_POS_MSEC) / 1000
        # Some containers carry no times, and the times of others jump.
        at_s = at_s if math.isfinite(at_s) and at_s > 0 else (self._number - 1) * self._period_s
        self._last_s = max(self._begun_s + at_s, self._last_s + 1e-3)
        return self._last_s

    def _finish(self) -> None:
        """After the last frame: begins again, ends, or says what is missing."""
        self._film.release()
        read, seen_s = self._number, self._last_s - self._begun_s
        # A count is often the film's length times some rate, so neither is trusted alone.
        cut = (
            read < _SHORT * self._announced - 2
            and seen_s + 2 * self._period_s < _SHORT * self._length_s
        )
        if read == 0 or cut or not self._loop:
            self.ended = True
            if read == 0:
                self._refuse_codec()
                raise UserError(f"{self.name} holds no frame that can be read; is it whole?")
            if cut:
                whole = read - self.damaged
                raise SourceLost(
                    f"{self.name} breaks off: {whole} of about {self._announced} frames could be "
                    f"read, up to {seen_s:.1f} of {self._length_s:.1f} s"
                )
            return
        self._begun_s, self._number = self._last_s + self._period_s, 0
        self._film = self._open()

    def _picture(self) -> NDArray[np.uint8] | None:
        with self._lock:
            done, image = (False, None) if self.ended else self._film.retrieve()
        name = f"{self.name}: frame {self._number}"
        try:
            if not done or image is None:
                raise UserError(f"{name} cannot be decoded")
            if self._jpegs:
                return read_image(image.tobytes(), name=name).image
        except UserError as error:
            self.damaged += 1
            self.notice(str(error))
            return None
        return rgb(image)

    def close(self) -> None:
        self._clock.stop()
        with self._lock:
            self.ended = True
            self._film.release()


def _holds_jpegs(film: cv2.VideoCapture) -> bool:
    """Whether each frame is one whole JPEG, to be shown as it is; releases the film."""
    codec = int(film.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").lower()
    size = tuple(int(film.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    found = False
    if codec in _MOTION_JPEG and orientation(film) == 1:
        film.set(cv2.CAP_PROP_FORMAT, _UNDECODED)
        done, packet = film.read()
        with contextlib.suppress(UserError):
            found = done and size_of(packet.tobytes()) == size
    film.release()
    return found
