"""Memory between frames: one doorway followed, a decision that does not flicker.

The belief that a doorway is open is a Bayes filter over the frames' p_open. Openings are
associated between frames by bearing, after the robot's known turns are taken off; the followed
one's bearing and range are smoothed, and evidence on the way to it is gathered. Times come from
the frames' stamps, so that what is decided does not depend on the frame rate or the clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from doorway3ds.arguments import require, require_number
from doorway3ds.live.filters import Belief
from doorway3ds.live.track import Track, TrackerParams
from doorway3ds.types import Decision, Opening, Reason, Selection

_MEASURED = (
    *("belief", "bearing_deg", "bearing_sd_deg", "bearing_error_deg"),
    *("range_m", "range_sd_m", "range_error_m"),
)


@dataclass(frozen=True)
class Tracked:
    """What is known after a frame.

    decision: the decision with memory; its p_open is the belief. raw: this frame's own.
    bearing_sd_deg, range_sd_m: how steady the smoothed values are (standard deviations), which
        says nothing of how near they are to the truth; `bearing_error_deg`, `range_error_m` do.
    age_s: how long the doorway is followed; unseen_s: since when it was not seen.
    number: counts the doorways followed, 0 where there is none.
    """

    decision: Decision
    raw: Decision = field(repr=False)
    belief: float
    bearing_deg: float | None = None
    bearing_sd_deg: float | None = None
    range_m: float | None = None
    range_sd_m: float | None = None
    free: float | None = None
    age_s: float = 0.0
    unseen_s: float = 0.0
    number: int = 0

    @property
    def bearing_error_deg(self) -> float | None:
        """The network's measured error of a bearing, None if there is none or it is unknown."""
        return None if self.bearing_deg is None else self.decision.perception.bearing_error_deg

    @property
    def range_error_m(self) -> float | None:
        """The network's measured error at that distance (standard deviation), None if unknown."""
        return self.decision.perception.range_error_m(self.range_m)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        decision = self.decision
        return {
            "reason": str(decision.reason),
            "turn_deg": decision.turn_deg,
            "open": decision.open,
            **{name: getattr(self, name) for name in _MEASURED},
            "clear": decision.selection.clear if self.number else None,
            "free": self.free,
            "look": decision.selection.look if decision.reason is Reason.UNSURE else None,
            "age_s": self.age_s,
            "unseen_s": self.unseen_s,
            "number": self.number,
        }


class Tracker:
    """Give it every decision, in the order of their frames' stamps.

    >>> from doorway3ds import Decision
    >>> tracker = Tracker()
    >>> decision = Decision.from_dict({"reason": "no_door", "p_open": 0.03})
    >>> tracker.update(decision).decision.reason
    <Reason.NO_DOOR: 'no_door'>

    It is for one camera and one thread.
    """

    def __init__(self, params: TrackerParams | None = None) -> None:
        require("params", params, (TrackerParams, type(None)), "TrackerParams or None")
        self.params = params or TrackerParams()
        self._followed_so_far = 0
        self._restart()

    def __repr__(self) -> str:
        followed = "none" if self._main is None else f"{self._main.bearing.value:+.1f} deg"
        return f"<Tracker following {followed}, belief {self._belief.p:.2f}>"

    def _restart(self) -> None:
        params = self.params
        self._belief = Belief(params.change_per_s, params.shared_s)
        self._tracks: list[Track] = []
        self._main: Track | None = None
        self._open = False
        self._last_s: float | None = None
        self._gap_s = 0.0
        self._lost_at_s: float | None = None
        self._last: Tracked | None = None

    def update(self, decision: Decision, turned_deg: float = 0.0) -> Tracked:
        """Takes in one frame's decision.

        turned_deg: by how much the robot has turned since the frame before, + left.
        """
        require("decision", decision, Decision, "a Decision")
        require_number("turned_deg", turned_deg)
        params, now = self.params, decision.frame.stamp_s
        gap = None if self._last_s is None else now - self._last_s
        if gap is not None and not 0 <= gap < params.restart_s:
            self._restart()
            gap = None
        dt = gap or 0.0
        self._last_s = now
        self._gap_s += (dt - self._gap_s) * (0.2 if self._gap_s else 1.0)
        if dt > self._patience_s:
            self._tracks = []
        self._belief.pass_time(dt)
        self._belief.observe(decision.p_open, dt)
        for track in self._tracks:
            track.turn(turned_deg)
        self._associate(decision, now, dt)
        self._settle(now)
        self._last = self._answer(decision, now)
        return self._last

    def without_picture(self, stamp_s: float) -> Tracked | None:
        """What is known at `stamp_s` where no further frame has come; None before the first.

        Once it has been silent for too long the decision is `lost`. Nothing is changed.
        """
        if self._last is None or self._last_s is None:
            return None
        silent_s = stamp_s - self._last_s
        last = self._last
        if silent_s <= self._patience_s:
            return replace(last, unseen_s=last.unseen_s + max(silent_s, 0.0))
        belief = Belief(self.params.change_per_s, self.params.shared_s)
        belief.p = last.belief
        belief.pass_time(silent_s)
        selection = replace(last.raw.selection, bearing_deg=None, range_m=None, clear=None)
        return Tracked(
            _decision(last.raw, Reason.LOST, selection, belief.p, False), last.raw, belief.p
        )

    @property
    def _patience_s(self) -> float:
        return max(self.params.lost_after_s, self.params.lost_after_frames * self._gap_s)

    def _associate(self, decision: Decision, now: float, dt: float) -> None:
        """Gives each opening of the frame to the nearest track, or begins one for it."""
        openings = _measurements(decision)
        # Openings that are known come first, so that a stray one does not take their place.
        pairs = [
            (not track.confirmed(now), track.distance(opening), index, track)
            for track in self._tracks
            for index, opening in enumerate(openings)
            if track.distance(opening) <= track.gate(opening)
        ]
        taken: dict[int, Track] = {}
        for _, _, index, track in sorted(pairs, key=lambda pair: pair[:2]):
            if index not in taken and track not in taken.values():
                taken[index] = track
        for index, opening in enumerate(openings):
            if index in taken:
                taken[index].measure(opening, now)
            else:
                track = Track(opening, now, self.params)
                self._tracks.append(track)
                taken[index] = track
        if openings:
            taken[0].judge(decision, now)
        for track in self._tracks:
            track.pass_time(now, dt)
        self._tracks = [track for track in self._tracks if track.unseen_s(now) <= self._patience_s]

    def _settle(self, now: float) -> None:
        """Which track is followed, and whether the doorway counts as open."""
        params, belief = self.params, self._belief.p
        was_open = self._open
        self._open = belief >= (params.closed_below if was_open else params.open_from)
        if not self._open:
            if was_open and self._main is not None:
                self._lost_at_s = now
            if was_open:
                self._tracks = []
            self._main = None
            return
        if self._main is not None and self._main not in self._tracks:
            self._main = None
            self._lost_at_s = now
        known = [track for track in self._tracks if track.confirmed(now)]
        if not known:
            return
        best = max(known, key=lambda track: track.score)
        if self._main is None or best.score > self._main.score + params.switch_margin:
            if best.number == 0:
                self._followed_so_far += 1
                best.number = self._followed_so_far
            self._main, self._lost_at_s = best, None

    def _answer(self, raw: Decision, now: float) -> Tracked:
        track, belief = self._main, self._belief.p
        if track is None:
            reason, why = self._without_track(raw, now)
            selection = replace(
                raw.selection, bearing_deg=None, range_m=None, clear=None, unsure=why
            )
            decision = _decision(raw, reason, selection, belief, self._open)
            return Tracked(decision, raw, belief)
        reason = track.reason(raw.method)
        selection = track.selection(raw.selection)
        turn_deg = {Reason.ALIGNED: 0.0, Reason.TURN: track.bearing.value}.get(reason)
        distance = track.range
        return Tracked(
            decision=_decision(raw, reason, selection, belief, True, turn_deg),
            raw=raw,
            belief=belief,
            bearing_deg=track.bearing.value,
            bearing_sd_deg=track.bearing.sd,
            range_m=None if distance is None else distance.value,
            range_sd_m=None if distance is None else distance.sd,
            free=None if track.clear is None else track.way.p,
            age_s=now - track.since_s,
            unseen_s=track.unseen_s(now),
            number=track.number,
        )

    def _without_track(self, raw: Decision, now: float) -> tuple[Reason, str | None]:
        lost = self._lost_at_s
        if lost is not None and now - lost <= self.params.lost_shown_s:
            return Reason.LOST, None
        if not self._open:
            return Reason.NO_DOOR, None
        return Reason.UNSURE, raw.selection.unsure or "it has not been seen for long enough"


def _measurements(decision: Decision) -> tuple[Opening, ...]:
    """The frame's openings; of a method that gives only a bearing, that."""
    selection = decision.selection
    if selection.openings or selection.bearing_deg is None or not decision.open:
        return selection.openings
    bearing = selection.bearing_deg
    column = float(selection.pixel[1]) if selection.pixel else 0.0
    score = float(decision.p_open)
    return (Opening(column, column, bearing, bearing, bearing, selection.range_m, score, cut=None),)


def _decision(
    raw: Decision,
    reason: Reason,
    selection: Selection,
    belief: float,
    is_open: bool,
    turn_deg: float | None = None,
) -> Decision:
    return replace(
        raw, reason=reason, turn_deg=turn_deg, p_open=belief, open=is_open, selection=selection
    )
