"""The one engine of live use, with real threads and a scripted source and network."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from doorway3ds.camera.model import Camera
from doorway3ds.decide.gates import Gates
from doorway3ds.decide.opening import columns_from_spans
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.errors import UserError
from doorway3ds.live.session import Session, watch
from doorway3ds.sources import Source, SourceLost
from doorway3ds.types import Frame, Perception, Reason

CAMERA = Camera.from_fov(64, 48, 60.0)


class Script(Source):
    """Frames at 10 a second, then silence, an error or the end."""

    def __init__(
        self, count: int, then: BaseException | None = None, *, live: bool = False
    ) -> None:
        super().__init__("a script")
        self.live, self._count, self._then, self.closed = live, count, then, False
        self.given = 0

    def read(self, timeout_s: float | None = None) -> Frame | None:
        if self.given < self._count:
            self.given += 1
            self.frame_name = f"frame {self.given}"
            stamp = time.monotonic() if self.live else self.given / 10
            return Frame(np.zeros((48, 64, 3), np.uint8), CAMERA, stamp_s=stamp)
        if self._then is not None:
            raise self._then
        if not self.live:
            self.ended = True
        else:
            time.sleep(min(timeout_s or 0.05, 0.05))
        return None

    def close(self) -> None:
        self.closed = self.ended = True


class Door:
    """A network that sees one doorway over the same columns for ever."""

    name = "door"
    gives = frozenset({"p_open", "columns"})

    def __init__(self, span: tuple[float, float] = (10.0, 26.0)) -> None:
        self.span = span

    def __call__(self, image: Any, camera: Camera) -> Perception:
        return Perception(0.9, columns_from_spans([self.span], camera.width), network=self.name)


def test_every_frame_is_decided_on_in_order_with_memory() -> None:
    with Session(Script(8), Pipeline(Door())) as session:
        updates = list(session)
    assert [u.number for u in updates] == list(range(1, 9))
    assert [u.name for u in updates] == [f"frame {n}" for n in range(1, 9)]
    assert all(u.fresh and u.problem is None for u in updates)
    assert updates[0].decision.reason is Reason.UNSURE  # not seen for long enough
    assert updates[-1].decision.reason is Reason.TURN
    assert updates[-1].decision.turn_deg == pytest.approx(updates[-1].raw.turn_deg)


def test_a_silent_camera_is_reported_once_and_decides_lost() -> None:
    source = Script(3, live=True)
    with Session(source, Pipeline(Door())) as session:
        updates = []
        for update in session:
            updates.append(update)
            if not update.fresh:
                threading.Timer(0.6, session.stop).start()
    assert [u.fresh for u in updates] == [True, True, True, False]
    assert updates[-1].decision.reason is Reason.LOST
    assert updates[-1].problem == "no image arrives"
    assert session.lost() is not None


def test_a_camera_that_falls_silent_after_a_change_is_lost_too() -> None:
    with Session(Script(1, live=True), Pipeline(Door())) as session:
        assert session.read(5) is not None
        session.use(Pipeline(Door()))
        update = next(iter(session))
    assert update.decision.reason is Reason.LOST


def test_a_lost_source_raises_and_another_error_does_not_end_the_session() -> None:
    with Session(Script(2, SourceLost("unplugged")), Pipeline(Door())) as session:
        assert [session.read(5) is not None for _ in range(2)] == [True, True]
        with pytest.raises(SourceLost, match="unplugged"):
            session.read(5)

    class Damaged(Script):
        def read(self, timeout_s: float | None = None) -> Frame | None:
            if self.given == 1 and not self.damaged:
                self.damaged = 1
                raise UserError("the second image is damaged")
            return super().read(timeout_s)

    with Session(Damaged(3), Pipeline(Door())) as session:
        assert session.read(5) is not None
        with pytest.raises(UserError, match="damaged"):
            session.read(5)
        assert len(list(session)) == 2


def test_another_pipeline_takes_over_without_memory() -> None:
    source = Script(1000)
    with Session(source, Pipeline(Door())) as session:
        for update in session:
            if update.number == 6:
                assert update.tracked.number == 1
                session.use(
                    Pipeline(Door((40.0, 56.0)), gates=Gates(aligned_deg=30.0)),
                    lambda frame: replace(frame, camera=replace(CAMERA, name="another")),
                )
            if update.raw.frame.camera.name == "another":
                break
        assert update.tracked.number == 0
        later = [session.read(5) for _ in range(6)][-1]
    assert later is not None
    assert later.decision.reason is Reason.ALIGNED
    assert later.raw.bearing_deg is not None and later.raw.bearing_deg < 0


@pytest.mark.parametrize("turns", [True, False])
def test_the_robot_s_turn_is_taken_off(turns: bool) -> None:
    heading: list[float] = [0.0]

    class Seen(Door):
        """The doorway moves in the picture as the robot turns from it, frame by frame."""

        def __call__(self, image: Any, camera: Camera) -> Perception:
            self.span = (self.span[0] + 2.5, self.span[1] + 2.5)
            return super().__call__(image, camera)

    def ask() -> float:
        heading[0] += 2.5
        return heading[0]

    known: Callable[[], float | None] = ask if turns else lambda: None
    with Session(Script(8), Pipeline(Seen((4.0, 20.0))), heading=known, ahead=1) as session:
        *_, last = session
    # smoothing follows a change late, unless the robot's own turn explains it
    assert last.raw.bearing_deg is not None and last.tracked.bearing_deg is not None
    late = abs(last.tracked.bearing_deg - last.raw.bearing_deg)
    assert (late < 0.5) is turns


def test_what_watch_opens_it_closes(monkeypatch: pytest.MonkeyPatch) -> None:
    source = Script(2)
    monkeypatch.setattr("doorway3ds.live.session.open_source", lambda uri, **options: source)
    with watch("a script", Pipeline(Door())) as updates:
        assert len(list(updates)) == 2
    assert source.closed
    mine = Script(2)
    with watch(mine, Pipeline(Door())) as updates:
        assert len(list(updates)) == 2
    assert not mine.closed
