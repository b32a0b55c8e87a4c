"""The closed loop: look, decide, turn, look again, until the robot faces the doorway or should not.

The loop decides nothing about doorways and moves nothing itself: decisions come from who looks,
motion goes through a `Driver`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

from doorway3ds.arguments import require, require_numbers, shown
from doorway3ds.compat import StrEnum
from doorway3ds.decide.options import ALIGNED_DEG
from doorway3ds.draw.words import counted
from doorway3ds.errors import CallError, UserError
from doorway3ds.robots.base import HALTING, Driver, Refused, RobotLost, TurnEnd, TurnResult
from doorway3ds.robots.runlog import RunLog
from doorway3ds.sources.base import SourceLost
from doorway3ds.types import Decision, Frame, Reason

T = TypeVar("T")


class Outcome(StrEnum):
    """How a run ended; `status` is the command's exit status."""

    ALIGNED = "aligned"  # it faces the doorway
    NO_DOOR = "no_door"  # a full circle shows none
    BLOCKED = "blocked"  # something stayed in the way
    UNSURE = "unsure"  # it could not make sure
    LOST = "lost"  # the camera or the robot is gone
    HALTED = "halted"  # bumper, fall or lost ground
    DRY = "dry"  # it was not allowed to move and says what it would have done

    @property
    def status(self) -> int:
        return _STATUS[self]


_STATUS = dict(zip(Outcome, (0, 3, 4, 5, 6, 7, 0), strict=True))
_UNSEEN = Outcome.LOST, "no fresh image comes from the camera"

SAME_WAY_DEG = 6.0
"""A way this near to one that was looked down along is that way."""


class Eyes(Protocol):
    """What the loop needs of a session; `doorway3ds.live.eyes.Eyes` says what each returns."""

    @property
    def looks_down(self) -> bool: ...

    def look(
        self, after_s: float, within_s: float, expected_deg: float | None = None
    ) -> Decision | None: ...

    def check_way(
        self, after_s: float, within_s: float, decision: Decision
    ) -> tuple[Frame, bool | None] | None: ...


@dataclass(frozen=True)
class LoopParams:
    """aligned_deg: it faces the doorway within this.

    search_deg: one step of the search; glance_deg: of a look to the side of a cut doorway, at most.
    settle_s: how long after a turn images are still blurred. frame_s: without a fresh image
    for so long the camera is lost. blocked_looks, blocked_s: how often to look at a blocked way,
    and how long to wait in between; freed_looks: in a row that must call a way free that was
    blocked, since a network's answer may flicker. down_deg: how far the head is lowered to look
    along the way before the robot commits itself (0: never). unsure_looks: looks that end in
    nothing. goes: turns towards a doorway before it gives up on ever facing it.
    """

    aligned_deg: float = ALIGNED_DEG
    search_deg: float = 40.0
    glance_deg: float = 25.0
    settle_s: float = 0.3
    frame_s: float = 5.0
    blocked_looks: int = 3
    blocked_s: float = 2.0
    freed_looks: int = 2
    down_deg: float = 10.0
    unsure_looks: int = 4
    goes: int = 6

    def __post_init__(self) -> None:
        require_numbers(self)


@dataclass(frozen=True)
class Report:
    """What a run did. goes: turns towards a doorway; searches: turns to look around."""

    outcome: Outcome
    why: str
    looks: int
    goes: int
    searches: int
    took_s: float


@dataclass(frozen=True)
class _Action:
    """Either a turn (deg, kind), a wait, or an end."""

    kind: str  # "go", "glance", "search", "look down", "wait", "end"
    turn_deg: float = 0.0
    outcome: Outcome | None = None
    why: str = ""
    bearing_deg: float | None = None

    def __str__(self) -> str:
        turn = f" {self.turn_deg:+.1f} deg" if self.turn_deg else ""
        return f"{self.kind}{turn}" if self.outcome is None else str(self.outcome)


class TurnLoop:
    """The closed loop: look, decide, turn, look again, until the robot faces the doorway.

    >>> from doorway3ds import Driver, watch
    >>> from doorway3ds.robots import DryRobot
    >>> with watch("examples/no-doorway.jpg") as eyes:
    ...     report = TurnLoop(eyes, Driver(DryRobot())).run()
    >>> report.outcome, report.why
    (<Outcome.DRY: 'dry'>, 'it would search +40.0 deg')

    Args:
        eyes: what looks and decides, such as `watch` returns.
        driver: the gate to the robot's motion.
        params: when it is content, and for how long it tries.
        log: of the run. tell: is called with one line about each look and turn. word: how a
            look's reason is written there. decided: is called with each decision.
        clock: of the frames, in seconds.
        sleep: waits on that clock.
    """

    def __init__(
        self,
        eyes: Eyes,
        driver: Driver,
        params: LoopParams | None = None,
        *,
        log: RunLog | None = None,
        tell: Callable[[str], None] = lambda line: None,
        word: Callable[[Reason], str] = str,
        decided: Callable[[Decision], object] = lambda decision: None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not (callable(getattr(eyes, "look", None)) and hasattr(eyes, "check_way")):
            raise CallError(f"eyes must look, as what `watch` returns, got {shown(eyes)}")
        require("driver", driver, Driver, "a Driver")
        require("params", params, (LoopParams, type(None)), "LoopParams or None")
        self._eyes, self._driver = eyes, driver
        self._params, self._log = params or LoopParams(), log or RunLog(None)
        self._tell, self._word, self._decided = tell, word, decided
        self._clock, self._sleep = clock, sleep
        self._ready_s = -math.inf
        self._looks = self._goes = self._searches = 0
        self._blocked = self._freed = self._unsure = self._stale = 0
        self._searched_deg = 0.0
        self._checked_deg: float | None = None
        self._ahead: tuple[float, float] | None = None
        self._side = 1.0
        self._expected_deg: float | None = None

    def __repr__(self) -> str:
        return f"<TurnLoop of {self._driver.robot.name}, {counted(self._looks, 'look')}>"

    def run(self) -> Report:
        """Runs until an outcome. Whatever ends it, the robot has been told to stop.

        Ctrl-C and errors that are no outcome go on to the caller after the stop.
        """
        start = self._clock()
        outcome, why = Outcome.UNSURE, "interrupted"
        try:
            try:
                self._driver.prepare()
                # Images from before the robot stood up are of something else.
                self._ready_s = self._clock() if self._driver.move else -math.inf
                outcome, why = self._steps()
                if outcome is not Outcome.LOST:
                    self._face_ahead()
            except RobotLost as error:
                outcome, why = Outcome.LOST, str(error)
        except BaseException as error:
            self._log.write("error", what=f"{type(error).__name__}: {error}")
            raise
        finally:
            stopped = self._stop()
            if not stopped:
                why = f"{why}; the robot could not be told to stop"
            self._log.write(
                "end", outcome=str(outcome), why=why, looks=self._looks, goes=self._goes,
                searches=self._searches, stopped=stopped,
            )  # fmt: skip
        took = self._clock() - start
        return Report(outcome, why, self._looks, self._goes, self._searches, took)

    def _steps(self) -> tuple[Outcome, str]:
        while True:
            decision = self._seen(self._eyes.look, self._expected_deg)
            if decision is None:
                return _UNSEEN
            self._decided(decision)
            self._looks += 1
            checks = self._unchecked(decision)
            action = _Action("look down") if checks else self._plan(decision)
            self._log.look(self._looks, decision, str(action), self._expected_deg)
            self._tell(f"look {self._looks}: {self._word(decision.reason)} -> {action}")
            if action.kind == "wait":
                self._face(decision)
                self._wait(self._params.blocked_s)
                continue
            if action.outcome is not None:
                return action.outcome, action.why
            end = self._look_down(decision) if checks else self._turn(action, decision.frame)
            if end is not None:
                return end

    def _seen(self, look: Callable[..., T | None], *what: Any) -> T | None:
        """A look at an image taken after the last motion; None if the camera is lost."""
        try:
            return look(self._ready_s, self._params.frame_s, *what)
        except SourceLost as error:
            self._log.write("lost", what=str(error))
            return None

    def _plan(self, decision: Decision) -> _Action:
        """What to do about one decision."""
        params = self._params
        if decision.reason in (Reason.TURN, Reason.ALIGNED) and self._blocked:
            self._freed += 1
            if self._freed < params.freed_looks:
                return _Action("wait")
        if decision.reason is Reason.TURN and decision.turn_deg is not None:
            self._blocked = self._unsure = 0
            self._searched_deg = 0.0
            if abs(decision.turn_deg) <= params.aligned_deg:
                return _Action("end", outcome=Outcome.ALIGNED, why="it faces the doorway")
            if self._goes >= params.goes:
                why = f"after {self._goes} turns it does not face it yet"
                return _Action("end", outcome=Outcome.UNSURE, why=why)
            turn = self._driver.clamp(decision.turn_deg)
            return self._or_dry(_Action("go", turn, bearing_deg=decision.turn_deg))
        if decision.reason is Reason.ALIGNED:
            return _Action("end", outcome=Outcome.ALIGNED, why="it faces the doorway")
        if decision.reason is Reason.BLOCKED:
            self._blocked += 1
            self._freed = 0
            if self._blocked >= params.blocked_looks or not self._driver.move:
                why = f"the way is blocked in {counted(self._blocked, 'look')}"
                return _Action("end", outcome=Outcome.BLOCKED, why=why)
            return _Action("wait")
        if decision.reason is Reason.UNSURE:
            return self._make_sure(decision)
        if decision.reason is Reason.NO_DOOR:
            return self._search()
        return _Action("end", outcome=Outcome.LOST, why="the doorway is lost")

    def _unchecked(self, decision: Decision) -> bool:
        """Whether the robot should look down along the way before it does as decided."""
        bearing = decision.selection.bearing_deg
        if not (self._eyes.looks_down and self._driver.move and self._params.down_deg > 0):
            return False
        if decision.reason not in (Reason.TURN, Reason.ALIGNED) or bearing is None:
            return False
        return self._checked_deg is None or abs(bearing - self._checked_deg) > SAME_WAY_DEG

    def _look_down(self, decision: Decision) -> tuple[Outcome, str] | None:
        """Looks for what stands below the level image; an outcome if that ends the run."""
        found, params = decision.selection, self._params
        self._checked_deg = found.bearing_deg
        before = self._driver.aim(found.bearing_deg or 0.0, -params.down_deg)
        if before is None:  # no head to lower
            return None
        self._ready_s = self._clock() + params.settle_s
        seen = self._seen(self._eyes.check_way, decision)
        self._driver.aim(*before)
        self._ready_s = self._clock() + params.settle_s
        if seen is None:
            return _UNSEEN
        frame, clear = seen
        self._log.down(self._looks, frame, found, clear)
        self._tell(f"look down: {'free' if clear is not False else 'blocked'}")
        if clear is not False:
            return None
        self._checked_deg = None
        action = self._plan(replace(decision, reason=Reason.BLOCKED, turn_deg=None))
        if action.outcome is not None:
            return action.outcome, action.why
        self._wait(params.blocked_s)
        return None

    def _face(self, decision: Decision) -> None:
        """Turns the head towards a blocked way: seen at the image's edge it may only seem so."""
        bearing = decision.selection.bearing_deg
        if self._ahead is None and decision.reason is Reason.BLOCKED and bearing is not None:
            self._ahead = self._driver.aim(bearing, 0.0)

    def _face_ahead(self) -> None:
        """Turns the head back to where it was before `_face`."""
        if self._ahead is not None:
            self._driver.aim(*self._ahead)
            self._ahead = None

    def _make_sure(self, decision: Decision) -> _Action:
        params, found = self._params, decision.selection
        self._unsure += 1
        if self._unsure > params.unsure_looks:
            why = found.unsure or "no look made sure"
            return _Action("end", outcome=Outcome.UNSURE, why=why)
        if found.look is None:
            return _Action("wait")
        self._side = 1.0 if found.look == "left" else -1.0
        bearing = abs(found.bearing_deg) if found.bearing_deg is not None else params.glance_deg
        step = min(max(bearing, params.glance_deg / 2), params.glance_deg)
        return self._or_dry(_Action("glance", self._driver.clamp(self._side * step)))

    def _search(self) -> _Action:
        """The next step of a full circle, towards the side where a doorway was last thought of."""
        step = abs(self._driver.clamp(self._params.search_deg))
        if self._searched_deg + step > 360.0 - step / 2 and self._searched_deg > 0:
            return _Action(
                "end", outcome=Outcome.NO_DOOR, why="a full circle shows no open doorway"
            )
        return self._or_dry(_Action("search", self._side * step))

    def _or_dry(self, action: _Action) -> _Action:
        if self._driver.move:
            return action
        why = f"it would {action}"
        return _Action("end", outcome=Outcome.DRY, why=why)

    def _turn(self, action: _Action, frame: Frame) -> tuple[Outcome, str] | None:
        """Turns; an outcome where that ends the run."""
        self._face_ahead()
        try:
            result = self._driver.turn(action.turn_deg, frame.stamp_s)
        except Refused as error:
            self._log.write("refused", what=str(error))
            self._tell(str(error))
            self._stale += 1
            if self._stale > 3 or self._driver.age_s(frame.stamp_s) <= self._driver.limits.ttl_s:
                return Outcome.UNSURE, str(error)
            return None
        self._ready_s = self._clock() + self._params.settle_s
        self._checked_deg = None
        self._count(action, result)
        # Where the doorway should be now; a glance or a search follows none.
        self._expected_deg = None
        if action.bearing_deg is not None and result.turned_deg is not None:
            self._expected_deg = action.bearing_deg - result.turned_deg
        turned = "unknown" if result.turned_deg is None else f"{result.turned_deg:+.1f} deg"
        self._tell(f"turn {action.turn_deg:+.1f} deg: {result.end}, turned {turned}")
        self._log.write(
            "turn", step=self._looks, kind=action.kind, asked_deg=action.turn_deg,
            turned_deg=result.turned_deg, end=str(result.end), took_s=result.took_s,
        )  # fmt: skip
        if result.end in HALTING:
            return Outcome.HALTED, f"the robot reports: {result.end}"
        if result.end is TurnEnd.LOST:
            return Outcome.LOST, "the robot is gone in the middle of a turn"
        return None

    def _count(self, action: _Action, result: TurnResult) -> None:
        self._stale = 0
        if action.kind == "go":
            self._goes += 1
            return
        self._searches += 1
        if action.kind == "search" and result.turned_deg is not None:
            self._searched_deg += abs(result.turned_deg)

    def _wait(self, seconds: float) -> None:
        self._sleep(seconds)
        self._ready_s = self._clock()

    def _stop(self) -> bool:
        try:
            self._driver.stop()
        except UserError:
            return False
        return True
