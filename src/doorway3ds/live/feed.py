"""A source and a network at work in threads of their own, one frame ahead of who decides.

While one frame is decided on, shown and written, the network looks at the next. Nothing queues:
at most one finished frame waits, and a live source gives its newest image when that is taken.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from doorway3ds.closing import Closing
from doorway3ds.errors import UserError
from doorway3ds.threads import Worker
from doorway3ds.types import Frame

T = TypeVar("T")

_WAIT_S = 0.5  # for an image, before the source counts as silent


class Frames(Protocol):
    """The part of a source that a feed needs."""

    frame_name: str

    @property
    def ended(self) -> bool: ...

    def read(self, timeout_s: float | None = None) -> Frame | None: ...


class Feed(Closing, Generic[T]):
    """What `see` makes of a source's frames, in their order.

    see: is given each frame and what it is called; None for a frame that is of no use.
    ahead: threads. 0: all is done by who reads. 1: `see` runs one frame ahead. 2: the source, too,
        is read and decoded one frame ahead of `see`. For sources that lose nothing by waiting: a
        live one would hand out an image that is no longer its newest.

    The source stays the caller's; close the feed first.
    """

    def __init__(
        self, source: Frames, see: Callable[[Frame, str], T | None], *, ahead: int = 1
    ) -> None:
        self._source, self._see = source, see
        self._silent = self._closed = False
        self._seeing = threading.RLock()
        self._reader: _Ahead[tuple[Frame, str]] | None = None
        self._seer: _Ahead[T] | None = None
        if ahead > 1:
            self._reader = _Ahead(self._fetch, lambda: source.ended, "reader")
        if ahead:
            feeds = self._reader or source
            self._seer = _Ahead(self._step, lambda: feeds.ended, "network")

    @property
    def ended(self) -> bool:
        """Nothing further will come."""
        return (self._seer or self._source).ended

    @property
    def silent(self) -> bool:
        """The source was asked and gave no frame for a while; not that `see` takes its time."""
        return self._silent

    def read(self, timeout_s: float | None = None) -> T | None:
        """The next result; None if none came within `timeout_s` seconds, or when `ended`.

        Raises, in its turn, what the source or `see` raised. After a UserError that did not end
        the source, further results come.
        """
        return self._step(timeout_s) if self._seer is None else self._seer.read(timeout_s)

    def close(self) -> None:
        """Ends the threads; may be called twice. What `see` has begun it finishes first."""
        for thread in (self._seer, self._reader):
            if thread is not None:
                thread.close()
        with self._seeing:
            self._closed = True

    def _fetch(self, timeout_s: float | None) -> tuple[Frame, str] | None:
        frame = self._source.read(timeout_s)
        return None if frame is None else (frame, self._source.frame_name)

    def _step(self, timeout_s: float | None) -> T | None:
        fetched = self._fetch(timeout_s) if self._reader is None else self._reader.read(timeout_s)
        self._silent = fetched is None
        if fetched is None:
            return None
        with self._seeing:
            return None if self._closed else self._see(*fetched)


class _Ahead(Generic[T]):
    """Calls `step` in a thread, one result ahead of who reads them.

    step: is given seconds to wait; None if there is nothing yet. over: whether it has no more.
    """

    def __init__(
        self, step: Callable[[float], T | None], over: Callable[[], bool], name: str
    ) -> None:
        self._step, self._over = step, over
        self._news = threading.Condition()
        self._kept: list[tuple[T | None, BaseException | None]] = []  # one at most
        self._done = self._closing = False
        self._worker = Worker(self._run, name, self._stop)

    @property
    def ended(self) -> bool:
        with self._news:
            return self._done and not self._kept

    def read(self, timeout_s: float | None) -> T | None:
        with self._news:
            self._news.wait_for(lambda: self._kept or self._done, timeout_s)
            if not self._kept:
                return None
            value, error = self._kept.pop()
            self._news.notify_all()
        if error is not None:
            raise error
        return value

    def close(self) -> None:
        self._worker.close()

    def _stop(self) -> None:
        with self._news:
            self._closing = True
            self._news.notify_all()

    def _run(self) -> None:
        done = False
        while not done:
            with self._news:
                self._news.wait_for(lambda: not self._kept or self._closing)
                if self._closing:
                    break
            value: T | None = None
            caught: BaseException | None = None
            try:
                value = self._step(_WAIT_S)
            except UserError as error:  # perhaps of this frame alone
                caught = error
            except BaseException as error:
                caught, done = error, True
            done = done or (value is None and self._over())
            if value is None and caught is None and not done:
                continue
            with self._news:
                if value is not None or caught is not None:
                    self._kept.append((value, caught))
                self._done = done
                self._news.notify_all()
        with self._news:
            self._done = True
            self._news.notify_all()
