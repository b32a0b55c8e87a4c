"""Live sources: a thread reads, only the newest image is kept, lost connections come back."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from doorway3ds.errors import UserError
from doorway3ds.images.codec import read_image
from doorway3ds.sources.base import Capture, Shot, Source, SourceLost, View
from doorway3ds.threads import Worker
from doorway3ds.types import Frame

FIRST_WAIT_S, LONGEST_WAIT_S = 0.25, 8.0


class LiveSource(Source):
    """Frames from a camera or stream that goes on whether or not anybody looks.

    connect: makes the connection; called once at once, whose error is the caller's, and again
        after each loss, with waits that double from 0.25 to 8 s until an image comes.
    patience_s: SourceLost after this long without an image; None: never.
    stall_s: a connection that gives no image for this long counts as lost.
    """

    live = True

    def __init__(
        self,
        name: str,
        connect: Callable[[], Capture],
        view: View | None = None,
        *,
        patience_s: float | None = 60.0,
        stall_s: float = 5.0,
    ) -> None:
        super().__init__(name)
        self._connect, self._view = connect, view or View()
        self._patience_s, self._stall_s = patience_s, stall_s
        self._news = threading.Condition()
        self._closing = threading.Event()
        self._shot: Shot | None = None
        self._gone: str | None = None
        self._damaged_since_s: float | None = None
        self._crash: BaseException | None = None
        self._wait_s = FIRST_WAIT_S
        self._away = False
        self._why: str | None = None
        try:
            capture = connect()
        except SourceLost:
            raise
        except (OSError, UserError) as error:
            raise SourceLost(f"{name} cannot be opened: {error}") from error
        self._last_s = time.monotonic()
        self._reader = Worker(lambda: self._run(capture), f"reader of {name}", self._stop)

    def read(self, timeout_s: float | None = None) -> Frame | None:
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while (shot := self._newest(deadline)) is not None:
            try:
                frame = self._frame(shot)
            except UserError as error:
                if not isinstance(shot.image, bytes):
                    raise
                self._leave_out(error)
            else:
                self._damaged_since_s = None
                return frame
        return None

    def _leave_out(self, error: UserError) -> None:
        """Counts a damaged image; SourceLost once there was no other for as long as patience."""
        self.damaged += 1
        now = time.monotonic()
        if self._damaged_since_s is None:
            self._damaged_since_s = now
            self.notice(f"{error}; it is left out")  # once in a row: a stream brings many a second
        elif self._patience_s is not None and now - self._damaged_since_s > self._patience_s:
            self.ended = True
            raise SourceLost(self._lost(str(error))) from error

    def _frame(self, shot: Shot) -> Frame:
        image, focal_35mm = shot.image, None
        if isinstance(image, bytes):
            picture = read_image(image, name=f"an image of {self.name}")
            image, self.orientation = picture.image, picture.orientation
            focal_35mm = picture.focal_35mm
        return self._view.frame(
            image,
            shot.stamp_s,
            focal_35mm=focal_35mm,
            camera=shot.camera,
            pose=shot.pose,
            orientation=self.orientation,
            sent=shot.sent,
        )

    def _newest(self, deadline: float | None) -> Shot | None:
        """Takes the newest shot, waiting for it; None at the deadline or when closed."""
        with self._news:
            while not self.ended:
                if self._crash is not None:
                    self.ended = True
                    raise self._crash
                if self._shot is not None:
                    shot, self._shot = self._shot, None
                    return shot
                now = time.monotonic()
                silent_s = now - self._last_s
                # A device whose driver hangs never returns to the reading thread, and one whose
                # every connection fails later than in connecting never ends `_reconnect`.
                if self._patience_s is not None and silent_s > self._patience_s:
                    self._gone = self._gone or self._lost(self._why or "no image arrives")
                if self._gone is not None:
                    self.ended = True
                    raise SourceLost(self._gone)
                if silent_s > self._stall_s and self.problem is None:
                    self.problem = f"no image for {silent_s:.0f} s"
                if deadline is not None and now >= deadline:
                    return None
                self._news.wait(0.5 if deadline is None else min(0.5, deadline - now))
        return None

    def close(self) -> None:
        self._reader.close()  # a thread inside a driver releases the device itself once it returns

    def _stop(self) -> None:
        with self._news:
            self.ended = True
            self._closing.set()
            self._shot = None
            self._news.notify_all()

    def _run(self, first: Capture) -> None:
        capture: Capture | None = first
        try:
            while capture is not None:
                try:
                    reason = self._pump(capture)
                finally:
                    capture.close()
                capture = None if reason is None else self._reconnect(reason)
        except BaseException as error:
            with self._news:
                self._crash = error
                self._news.notify_all()

    def _pump(self, capture: Capture) -> str | None:
        """Reads until the connection is lost, and says why; None when closing."""
        begun = time.monotonic()
        while not self._closing.is_set():
            try:
                shot = capture.read()
            except (OSError, UserError) as error:
                return str(error) or type(error).__name__
            if shot is not None:
                self._offer(shot)
            elif time.monotonic() - max(begun, self._last_s) > self._stall_s:
                return f"no image for {self._stall_s:g} s"
            else:
                self._closing.wait(0.005)
        return None

    def _offer(self, shot: Shot) -> None:
        with self._news:
            self.skipped += self._shot is not None
            self._shot = shot
            self._last_s = time.monotonic()
            self._wait_s = FIRST_WAIT_S
            back, self._away, self.problem = self._away, False, None
            self._news.notify_all()
        if back:
            self.notice(f"{self.name} is back")

    def _reconnect(self, reason: str) -> Capture | None:
        """A new connection; None when closing, or when patience has run out."""
        if not self._away:
            self._away = True
            self.notice(f"{self.name} is lost: {reason}; trying again")
        self.problem = self._why = reason
        while not self._closing.wait(self._wait_s):
            self._wait_s = min(2 * self._wait_s, LONGEST_WAIT_S)
            try:
                capture = self._connect()
            except (OSError, UserError) as error:
                self.problem = self._why = str(error)
            else:
                self.reconnects += 1
                return capture
            if self._patience_s is None:
                continue
            left_s = self._last_s + self._patience_s - time.monotonic()
            if left_s <= 0:
                with self._news:
                    self._gone = self._lost(self._why)
                    self._news.notify_all()
                return None
            self._wait_s = min(self._wait_s, max(left_s, 0.01))
        return None

    def _lost(self, reason: str) -> str:
        return f"{self.name} sent no image for {self._patience_s:g} s: {reason}"
