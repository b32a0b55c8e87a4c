"""What the loop does about each decision, with a robot that turns and a made-up world."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doorway3ds.camera.model import Camera
from doorway3ds.errors import UserError
from doorway3ds.live.eyes import Eyes, Update
from doorway3ds.live.tracker import Tracked
from doorway3ds.robots import Driver, DryRobot, Limits, RobotLost, TurnEnd, TurnResult
from doorway3ds.robots.loop import LoopParams, Outcome, TurnLoop
from doorway3ds.robots.runlog import RunLog, looks, read_log
from doorway3ds.types import Decision, Frame, Perception, Reason, Selection

CAMERA = Camera.from_fov(32, 24, 60.0)


class World(DryRobot):
    """A robot among doors at bearings; its clock runs only when it turns or waits."""

    def __init__(self, ends: TurnEnd = TurnEnd.DONE, slip: float = 0.0) -> None:
        self.now = 100.0
        self.heading = 0.0
        self.turns: list[float] = []
        self.stops = 0
        self.ends, self.slip = ends, slip
        self.delay_s = 0.1
        self.lose_after = 10**6
        self.reads = 0
        self.ended = False

    def turn(self, theta_deg: float, timeout_s: float) -> TurnResult:
        self.turns.append(theta_deg)
        self.now += 1.0
        done = theta_deg if self.ends is TurnEnd.DONE else theta_deg / 2
        self.heading += done * (1 + self.slip)
        return TurnResult(theta_deg, done, self.ends, 1.0)

    def stop(self) -> None:
        self.stops += 1

    def read(self, timeout_s: float | None = None) -> Frame | None:
        self.reads += 1
        self.now += self.delay_s
        if self.reads > self.lose_after:
            self.now += timeout_s or 1.0
            return None
        image = np.full((24, 32, 3), self.reads % 256, np.uint8)
        return Frame(image, CAMERA, stamp_s=self.now)

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def decision(frame: Frame, reason: Reason, bearing: float | None = None, look: str | None = None
             ) -> Decision:  # fmt: skip
    found = Selection(bearing, 2.0, None, reason is not Reason.BLOCKED, look=look, unsure=look)
    turn = bearing if reason is Reason.TURN else 0.0 if reason is Reason.ALIGNED else None
    perception = Perception(0.0 if reason is Reason.NO_DOOR else 1.0)
    is_open = reason is not Reason.NO_DOOR
    return Decision(reason, turn, perception.p_open, is_open, found, perception, frame, "opening")


def sees(world: World, door_deg: float | None, half_deg: float = 30.0) -> Callable[..., Decision]:
    """A door in the world at a heading: turn, aligned, or out of sight."""

    def decide(frame: Frame) -> Decision:
        if door_deg is None:
            return decision(frame, Reason.NO_DOOR)
        bearing = (door_deg - world.heading + 180) % 360 - 180
        if abs(bearing) > half_deg:
            return decision(frame, Reason.NO_DOOR)
        reason = Reason.ALIGNED if abs(bearing) <= 3 else Reason.TURN
        return decision(frame, reason, bearing)

    return decide


class Looks(Eyes):
    """What looks in a world, by a made-up decision for each frame, and a check of the way."""

    looks_down = False
    ended = False

    def __init__(
        self,
        world: World,
        decide: Callable[[Frame], Decision],
        check: Callable[[Decision], bool] | None = None,
    ) -> None:
        super().__init__(lambda: world.now)
        self._world, self._decide, self._check = world, decide, check
        self.looks_down = check is not None

    @property
    def pipeline(self) -> Any:
        return self

    def stay(self, decision: Decision, expected_deg: float | None) -> Decision:
        return decision

    def read(self, timeout_s: float | None = None) -> Update | None:
        frame = self._world.read(timeout_s)
        if frame is None or frame.stamp_s < self._from_s:
            return None
        made = self._decide(frame)
        return Update(self._world.reads, "world", Tracked(made, made, made.p_open))

    def check_way(
        self, after_s: float, within_s: float, decision: Decision
    ) -> tuple[Frame, bool | None] | None:
        assert self._check is not None
        clear = self._check(decision)
        frame = self._world.read(within_s)
        assert frame is not None
        return frame, clear


def loop(
    world: World,
    decide: Callable[[Frame], Decision],
    *,
    move: bool = True,
    log: RunLog | None = None,
    params: LoopParams | None = None,
    check: Callable[[Decision], bool] | None = None,
    **limits: Any,
) -> TurnLoop:
    driver = Driver(world, move=move, limits=Limits(**limits), clock=lambda: world.now)
    eyes = Looks(world, decide, check)
    return TurnLoop(eyes, driver, params, log=log, clock=lambda: world.now, sleep=world.sleep)


def test_a_way_that_was_blocked_must_be_called_free_twice_in_a_row() -> None:
    turn = (Reason.TURN, 20.0)
    for answers, goes in (
        ([Reason.BLOCKED, turn, Reason.BLOCKED, turn, Reason.BLOCKED], 0),
        ([Reason.BLOCKED, turn, turn, Reason.ALIGNED], 1),
    ):
        world, script = World(), iter(answers)

        def decide(frame: Frame, script: Any = script) -> Decision:
            answer = next(script)
            reason, bearing = answer if isinstance(answer, tuple) else (answer, 0.0)
            return decision(frame, reason, bearing)

        report = loop(world, decide).run()
        assert report.goes == goes
        assert report.outcome is (Outcome.ALIGNED if goes else Outcome.BLOCKED)


class Headed(World):
    """A world whose robot has a head; `aims` are its movements."""

    def __init__(self) -> None:
        super().__init__()
        self.head = (0.0, 5.0)
        self.aims: list[tuple[float, float]] = []

    def aim(self, yaw_deg: float, pitch_deg: float) -> tuple[float, float] | None:
        before, self.head = self.head, (yaw_deg, pitch_deg)
        self.aims.append(self.head)
        self.now += 0.5
        return before


def looking_down(world: Headed, clear: bool, log: RunLog | None = None) -> TurnLoop:
    """A loop towards a door at 25 deg; looking down shows its way free, or not."""

    def decide(frame: Frame) -> Decision:
        assert world.head == (0.0, 5.0)  # level decisions are made with a level head
        return sees(world, 25.0)(frame)

    def check(found: Decision) -> bool:
        assert world.aims[-1] == (found.selection.bearing_deg, -10.0)
        return clear

    return loop(world, decide, log=log, check=check)


def test_it_looks_down_along_the_way_before_it_turns_and_before_it_is_content() -> None:
    world = Headed()
    report = looking_down(world, True).run()
    assert (report.outcome, report.goes) == (Outcome.ALIGNED, 1)
    assert world.aims == [(25.0, -10.0), (0.0, 5.0), (0.0, -10.0), (0.0, 5.0)]


def test_it_does_not_turn_where_looking_down_shows_something(tmp_path: Path) -> None:
    world = Headed()
    with RunLog(tmp_path / "run") as log:
        log.write("start")
        report = looking_down(world, False, log).run()
    assert (report.outcome, world.turns) == (Outcome.BLOCKED, [])
    events = read_log(tmp_path / "run")
    downs = [e for e in events if e["event"] == "down"]
    assert [e["clear"] for e in downs] == [False] * 3
    assert all((tmp_path / "run" / e["image"]).exists() for e in downs)
    assert len(list(looks(tmp_path / "run", events))) == report.looks


def test_a_blocked_way_is_looked_at_again_from_straight_ahead() -> None:
    """Seen at the image's edge a way may only seem blocked; the head is level before any turn."""

    def run(blocked_ahead: bool) -> tuple[Headed, TurnLoop]:
        world = Headed()

        def decide(frame: Frame) -> Decision:
            if world.heading == 0.0 and (blocked_ahead or world.head != (25.0, 0.0)):
                return decision(frame, Reason.BLOCKED, 25.0)
            return sees(world, 25.0)(frame)

        return world, loop(world, decide)

    world, free = run(blocked_ahead=False)
    report = free.run()
    assert (report.outcome, report.goes, report.looks) == (Outcome.ALIGNED, 1, 4)
    assert world.aims == [(25.0, 0.0), (0.0, 5.0)] and world.turns == [25.0]
    world, blocked = run(blocked_ahead=True)
    assert blocked.run().outcome is Outcome.BLOCKED
    assert world.aims == [(25.0, 0.0), (0.0, 5.0)] and world.turns == []


def test_without_permission_no_head_is_moved() -> None:
    world = Headed()
    driver = Driver(world, move=False, clock=lambda: world.now)
    assert driver.aim(0.0, -10.0) is None
    assert world.aims == []


def test_it_turns_until_it_faces_the_doorway_although_it_slips() -> None:
    world = World(slip=0.2)
    report = loop(world, sees(world, 25.0)).run()
    assert report.outcome is Outcome.ALIGNED
    assert abs(world.heading - 25.0) <= 3
    assert (report.goes, report.searches, world.stops) == (2, 0, 1)


@pytest.mark.parametrize("door", [90.0, -100.0, 179.0])
def test_it_looks_around_and_finds_the_doorway(door: float) -> None:
    world = World()
    report = loop(world, sees(world, door)).run()
    assert report.outcome is Outcome.ALIGNED
    assert abs((world.heading - door + 180) % 360 - 180) <= 3


def test_without_a_door_it_looks_around_once_and_stops() -> None:
    world = World()
    report = loop(world, sees(world, None)).run()
    assert report.outcome is Outcome.NO_DOOR
    assert world.turns == [40.0] * 8
    assert report.looks == 9


def test_a_blocked_way_is_looked_at_again_and_never_turned_to() -> None:
    world = World()
    report = loop(world, lambda f: decision(f, Reason.BLOCKED, 12.0)).run()
    assert (report.outcome, report.looks, world.turns) == (Outcome.BLOCKED, 3, [])


def test_a_way_that_becomes_free_is_taken() -> None:
    world = World()
    see = sees(world, 10.0)
    report = loop(
        world, lambda f: decision(f, Reason.BLOCKED, 10.0) if world.now < 102 else see(f)
    ).run()
    assert report.outcome is Outcome.ALIGNED


def test_unsure_it_glances_to_the_side_and_gives_up_at_last() -> None:
    world = World()
    report = loop(world, lambda f: decision(f, Reason.UNSURE, -20.0, "right")).run()
    assert report.outcome is Outcome.UNSURE
    assert world.turns == [-20.0] * 4


def test_a_method_that_never_arrives_is_ended() -> None:
    world = World()
    report = loop(world, lambda f: decision(f, Reason.TURN, 15.0)).run()
    assert (report.outcome, report.goes) == (Outcome.UNSURE, 6)


def test_without_permission_it_says_what_it_would_do() -> None:
    world = World()
    report = loop(world, sees(world, 20.0), move=False).run()
    assert report.outcome is Outcome.DRY
    assert "+20.0 deg" in report.why
    assert (world.turns, world.stops) == ([], 0)


def test_old_decisions_move_nothing() -> None:
    world = World()

    def slow(frame: Frame) -> Decision:
        world.now += 3.0
        return decision(frame, Reason.TURN, 20.0)

    report = loop(world, slow, ttl_s=2.0).run()
    assert world.turns == []
    assert report.outcome is Outcome.UNSURE
    assert "old" in report.why


def test_pictures_from_before_the_turn_ended_are_not_decided_on() -> None:
    world = World()
    decided: list[float] = []
    see = sees(world, 20.0)

    def decide(frame: Frame) -> Decision:
        decided.append(frame.stamp_s)
        return see(frame)

    loop(world, decide).run()
    # The turn took one second; blurred pictures of 0.3 s after it are skipped.
    assert decided[1] - decided[0] >= 1.3


def test_a_camera_that_goes_ends_the_run_with_a_stop() -> None:
    world = World()
    world.lose_after = 1
    report = loop(world, sees(world, 50.0)).run()
    assert (report.outcome, world.stops) == (Outcome.LOST, 1)
    assert report.took_s < 10


@pytest.mark.parametrize(
    ("end", "outcome"),
    [(TurnEnd.BUMPER, Outcome.HALTED), (TurnEnd.FALLEN, Outcome.HALTED),
     (TurnEnd.LOST, Outcome.LOST)],
)  # fmt: skip
def test_a_turn_that_ends_badly_ends_the_run(end: TurnEnd, outcome: Outcome) -> None:
    world = World(end)
    report = loop(world, sees(world, 20.0)).run()
    assert (report.outcome, world.turns, world.stops) == (outcome, [20.0], 1)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ZeroDivisionError(), UserError("x")])
def test_whatever_happens_the_robot_is_stopped_and_the_log_whole(
    error: BaseException, tmp_path: Path
) -> None:
    world = World()

    def fail(frame: Frame) -> Decision:
        raise error

    with RunLog(tmp_path / "run") as log, pytest.raises(type(error)):
        log.write("start")
        loop(world, fail, log=log).run()
    assert world.stops == 1
    assert [e["event"] for e in read_log(tmp_path / "run")] == ["start", "error", "end"]


def test_a_robot_that_cannot_be_told_to_stop_is_said(tmp_path: Path) -> None:
    class Gone(World):
        def stop(self) -> None:
            raise RobotLost("gone")

    world = Gone(TurnEnd.LOST)
    with RunLog(tmp_path / "run") as log:
        log.write("start")
        report = loop(world, sees(world, 20.0), log=log).run()
    assert "could not be told to stop" in report.why
    assert read_log(tmp_path / "run")[-1]["stopped"] is False


def test_a_run_is_read_back_with_the_same_pictures(tmp_path: Path) -> None:
    world = World()
    with RunLog(tmp_path / "run", clock=lambda: world.now) as log:
        log.write("start")
        loop(world, sees(world, 25.0), log=log).run()
    events = read_log(tmp_path / "run")
    assert [e["event"] for e in events] == ["start", "look", "turn", "look", "end"]
    seen = list(looks(tmp_path / "run", events))
    first, second = (int(look.frame.image[0, 0, 0]) for look in seen)
    assert first == 1
    assert second == 5  # those in between were taken while it still shook
    assert seen[0].frame.camera == CAMERA
    assert [look.action for look in seen] == ["go +25.0 deg", "aligned"]


def test_a_look_s_reason_is_written_as_asked() -> None:
    world, lines = World(), list[str]()
    eyes, driver = Looks(world, sees(world, 20.0)), Driver(world, clock=lambda: world.now)
    clock = {"clock": lambda: world.now, "sleep": world.sleep}
    TurnLoop(eyes, driver, tell=lines.append, word=lambda reason: f"[{reason}]", **clock).run()
    assert lines[0] == "look 1: [turn] -> dry"
