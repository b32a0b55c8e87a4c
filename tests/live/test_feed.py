"""A source and a network that work ahead: order, errors, silence, and that nothing queues."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

from doorway3ds.errors import UserError
from doorway3ds.live.feed import Feed
from doorway3ds.sources import Source, SourceLost, View
from doorway3ds.threads import Worker
from doorway3ds.types import Frame

IMAGE = np.zeros((6, 8, 3), np.uint8)


class Numbers(Source):
    """Frames with the stamps 0, 1, 2, ...; before each, `before(number)` is called."""

    def __init__(
        self, count: int, before: Callable[[int], None] = lambda number: None, live: bool = False
    ) -> None:
        super().__init__("numbers")
        self.live, self.given = live, 0
        self._count, self._before = count, before

    def read(self, timeout_s: float | None = None) -> Frame | None:
        if self.given >= self._count:
            self.ended = True
            return None
        number, self.given = self.given, self.given + 1
        self._before(number)
        self.frame_name = f"#{number}"
        return View().frame(IMAGE, float(number))

    def close(self) -> None:
        self.ended = True


def see(frame: Frame, name: str) -> tuple[float, str]:
    return frame.stamp_s, name


def everything(feed: Feed[tuple[float, str]]) -> list[tuple[float, str]]:
    found = []
    while not feed.ended:
        seen = feed.read(5)
        if seen is not None:
            found.append(seen)
    return found


@pytest.mark.parametrize("ahead", [0, 1, 2])
def test_all_frames_come_in_order_under_their_own_names(ahead: int) -> None:
    with Feed(Numbers(50), see, ahead=ahead) as feed:
        assert everything(feed) == [(float(i), f"#{i}") for i in range(50)]
        assert feed.read(0.01) is None


@pytest.mark.parametrize("ahead", [0, 1, 2])
def test_nothing_queues_while_the_caller_is_busy(ahead: int) -> None:
    source = Numbers(50)
    with Feed(source, see, ahead=ahead) as feed:
        assert feed.read(5) == (0.0, "#0")
        time.sleep(0.2)
        # One seen and waiting; with a reader, one more read.
        assert source.given <= 1 + ahead


def test_the_network_works_while_the_caller_does() -> None:
    def slow(frame: Frame, name: str) -> float:
        time.sleep(0.05)
        return frame.stamp_s

    start = time.monotonic()
    with Feed(Numbers(10), slow) as feed:
        while not feed.ended:
            if feed.read(5) is not None:
                time.sleep(0.05)
    assert time.monotonic() - start < 0.85  # one after the other would take 1 s


@pytest.mark.parametrize("ahead", [0, 1, 2])
def test_an_error_comes_in_its_turn_and_what_follows_it_still_comes(ahead: int) -> None:
    def breaks(number: int) -> None:
        if number == 2:
            raise UserError("this image cannot be used")

    with Feed(Numbers(4, breaks), see, ahead=ahead) as feed:
        assert [feed.read(5), feed.read(5)] == [(0.0, "#0"), (1.0, "#1")]
        with pytest.raises(UserError, match="cannot be used"):
            feed.read(5)
        assert everything(feed) == [(3.0, "#3")]


@pytest.mark.parametrize("error", [SourceLost("gone"), ZeroDivisionError("a bug")])
def test_what_ends_the_source_ends_the_feed_after_its_last_frame(error: Exception) -> None:
    source = Numbers(9)

    def breaks(number: int) -> None:
        if number == 3:
            source.ended = True
            raise error

    source._before = breaks
    with Feed(source, see) as feed:
        assert [feed.read(5) for _ in range(3)] == [(float(i), f"#{i}") for i in range(3)]
        with pytest.raises(type(error)):
            feed.read(5)
        if isinstance(error, ZeroDivisionError):
            assert feed.ended and feed.read(0.01) is None


def test_a_slow_network_is_not_taken_for_a_silent_source() -> None:
    tap = threading.Semaphore(1)

    class Tap(Numbers):
        def read(self, timeout_s: float | None = None) -> Frame | None:
            return super().read() if tap.acquire(timeout=0.05) else None

    def slow(frame: Frame, name: str) -> float:
        time.sleep(0.3)
        return frame.stamp_s

    with Feed(Tap(9, live=True), slow) as feed:
        assert feed.read(0.1) is None and not feed.silent
        assert feed.read(5) == 0.0
        end = time.monotonic() + 5
        while not feed.silent and time.monotonic() < end:
            time.sleep(0.01)
        assert feed.silent
        tap.release()
        assert feed.read(5) == 1.0


def test_closing_ends_the_threads_also_while_a_frame_waits() -> None:
    before = threading.active_count()
    feed = Feed(Numbers(50), see, ahead=2)
    assert feed.read(5) is not None
    feed.close()
    feed.close()
    assert threading.active_count() == before


def test_closing_waits_for_the_network_and_not_for_the_source(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Python must not end while a thread is inside the network."""
    monkeypatch.setattr(Worker.close, "__defaults__", (0.05,))
    under_way, plugged = threading.Event(), threading.Event()
    seen: list[float] = []

    def slow(frame: Frame, name: str) -> float:
        under_way.set()
        time.sleep(0.5)
        seen.append(frame.stamp_s)
        return frame.stamp_s

    with Feed(Numbers(9), slow):
        under_way.wait(5)
    assert seen == [0.0]
    with Feed(Numbers(9, lambda number: plugged.wait(5) and None), slow) as hanging:
        pass
    plugged.set()
    assert hanging.read(0.2) is None and seen == [0.0]
