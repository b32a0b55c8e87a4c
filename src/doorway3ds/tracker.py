"""Memory between frames: one doorway followed, a decision that does not flicker.

The belief that a doorway is open is a Bayes filter over the frames' p_open. Openings are
associated between frames by bearing, after the robot's known turns are taken off; the followed
one's bearing and range are smoothed, and evidence on the way to it is gathered. Times come from
the frames' stamps, so that what is decided does not depend on the frame rate or the clock.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from doorway3ds.filters import Belief, Smoothed
from doorway3ds.types import Decision, Opening, Reason, Selection


@dataclass(frozen=True)
class TrackerParams:
    """Limits of the tracker; times in seconds, angles in degrees.

    change_per_s, shared_s: of the beliefs, see filters.Belief.
    open_from, closed_below: the belief at which a doorway becomes open, and ceases to be.
    smooth_s: time of forgetting of bearing and range.
    bearing_sd_deg, range_sd: of one frame's bearing, and relative of its range, until learnt.
    gate_deg: an opening this near to where one was last is the same; of a wide one, gate_width
        of its width.
    confirm_s, confirm_frames: an opening is followed once seen for this long and this often.
    lost_after_s: it is lost when unseen for longer, or for lost_after_frames at the rate at which
        frames come. lost_shown_s: how long that is said.
    switch_margin: another opening takes over once its score is higher by this.
    free_evidence, blocked_evidence: how often a frame that calls the way free, or not, is right.
    way_from, way_below: the belief at which the way becomes free, and blocked.
    way_forget_s: the way is unknown again when not judged for this long.
    aligned_deg, turn_from_deg: facing the doorway up to the first, until beyond the second.
    restart_s: after a gap as long as this nothing is remembered.
    """

    change_per_s: float = 0.3
    shared_s: float = 0.2
    open_from: float = 0.65
    closed_below: float = 0.35
    smooth_s: float = 0.25
    bearing_sd_deg: float = 3.0
    range_sd: float = 0.15
    gate_deg: float = 8.0
    gate_width: float = 0.4
    confirm_s: float = 0.2
    confirm_frames: int = 3
    lost_after_s: float = 0.7
    lost_after_frames: float = 2.5
    lost_shown_s: float = 1.0
    switch_margin: float = 0.2
    free_evidence: float = 0.75
    blocked_evidence: float = 0.85
    way_from: float = 0.65
    way_below: float = 0.35
    way_forget_s: float = 2.0
    aligned_deg: float = 3.0
    turn_from_deg: float = 4.5
    restart_s: float = 5.0


@dataclass(frozen=True)
class Tracked:
    """What is known after a frame.

    decision: the decision with memory; its p_open is the belief. raw: this frame's own.
    bearing_sd_deg, range_sd_m: standard deviations of the smoothed values.
    age_s: how long the doorway is followed; unseen_s: since when it was not seen.
    number: counts the doorways followed, 0 where there is none.
    """

    decision: Decision
    raw: Decision
    belief: float
    bearing_deg: float | None = None
    bearing_sd_deg: float | None = None
    range_m: float | None = None
    range_sd_m: float | None = None
    free: float | None = None
    age_s: float = 0.0
    unseen_s: float = 0.0
    number: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        decision = self.decision
        return {
            "reason": str(decision.reason),
            "turn_deg": decision.turn_deg,
            "open": decision.open,
            "belief": self.belief,
            "bearing_deg": self.bearing_deg,
            "bearing_sd_deg": self.bearing_sd_deg,
            "range_m": self.range_m,
            "range_sd_m": self.range_sd_m,
            "clear": decision.selection.clear if self.number else None,
            "free": self.free,
            "look": decision.selection.look if decision.reason is Reason.UNSURE else None,
            "age_s": self.age_s,
            "unseen_s": self.unseen_s,
            "number": self.number,
        }


class Tracker:
    """Give it every decision, in the order of their frames' stamps.

    >>> tracker = Tracker()
    >>> tracked = tracker.update(decision)  # doctest: +SKIP
    """

    def __init__(self, params: TrackerParams | None = None) -> None:
        self.params = params or TrackerParams()
        self._followed_so_far = 0
        self._restart()

    def _restart(self) -> None:
        params = self.params
        self._belief = Belief(params.change_per_s, params.shared_s)
        self._tracks: list[_Track] = []
        self._main: _Track | None = None
        self._open = False
        self._last_s: float | None = None
        self._gap_s = 0.0
        self._lost_at_s: float | None = None
        self._last: Tracked | None = None

    def update(self, decision: Decision, turned_deg: float = 0.0) -> Tracked:
        """Takes in one frame's decision.

        turned_deg: by how much the robot has turned since the frame before, + left.
        """
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
        taken: dict[int, _Track] = {}
        for _, _, index, track in sorted(pairs, key=lambda pair: pair[:2]):
            if index not in taken and track not in taken.values():
                taken[index] = track
        for index, opening in enumerate(openings):
            if index in taken:
                taken[index].measure(opening, now)
            else:
                track = _Track(opening, now, self.params)
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


class _Track:
    """One opening over time."""

    def __init__(self, opening: Opening, now: float, params: TrackerParams) -> None:
        self._params = params
        self._opening: Opening | None = opening
        self._seen_deg = opening.bearing_deg
        self._seen_s = self._ranged_s = self._judged_s = self._doubted_s = self.since_s = now
        self._frames = 1
        self._doubt: Smoothed | None = None
        self._why: Selection | None = None
        self._aligned = self._doubtful = False
        self.number = 0
        self.score = opening.score
        self.bearing = Smoothed(opening.bearing_deg, params.smooth_s, params.bearing_sd_deg)
        self.range: Smoothed | None = None
        self.way = Belief(params.change_per_s, params.shared_s)
        self.clear: bool | None = None
        self._measure_range(opening, now)

    def unseen_s(self, now: float) -> float:
        return now - self._seen_s

    def confirmed(self, now: float) -> bool:
        params = self._params
        # Stamps are sums of fractions; a nanosecond must not cost a frame.
        seen_s = self._seen_s - self.since_s + 1e-6
        return self._frames >= params.confirm_frames and seen_s >= params.confirm_s

    def turn(self, turned_deg: float) -> None:
        self._seen_deg -= turned_deg
        self.bearing.shift(-turned_deg)

    def distance(self, opening: Opening) -> float:
        """To where it was seen last or, where that was a stray value, to where it is by all."""
        bearing = opening.bearing_deg
        return min(abs(bearing - self._seen_deg), abs(bearing - self.bearing.value))

    def gate(self, opening: Opening) -> float:
        width = opening.left_deg - opening.right_deg
        return max(self._params.gate_deg, self._params.gate_width * width)

    def measure(self, opening: Opening, now: float) -> None:
        self.bearing.measure(opening.bearing_deg, now - self._seen_s)
        self._measure_range(opening, now)
        self._opening, self._seen_deg, self._seen_s = opening, opening.bearing_deg, now
        self._frames += 1

    def _measure_range(self, opening: Opening, now: float) -> None:
        if opening.range_m is None:
            return
        if self.range is None:
            first_sd = self._params.range_sd * opening.range_m
            self.range = Smoothed(opening.range_m, self._params.smooth_s, first_sd)
        else:
            self.range.measure(opening.range_m, now - self._ranged_s)
        self._ranged_s = now

    def judge(self, decision: Decision, now: float) -> None:
        """What the frame says of the way to this opening, and of its own doubts."""
        params, dt = self._params, now - self._judged_s
        selection = decision.selection
        if selection.clear is not None:
            right = params.free_evidence if selection.clear else 1 - params.blocked_evidence
            self.way.pass_time(dt)
            self.way.observe(right, dt)
            self._judged_s = now
            if self.way.p >= params.way_from:
                self.clear = True
            elif self.way.p <= params.way_below:
                self.clear = False
        doubt = float(selection.unsure is not None)
        if doubt:
            self._why = selection
        if self._doubt is None:
            self._doubt = Smoothed(doubt, params.smooth_s, 0.5)
        else:
            self._doubt.measure(doubt, now - self._doubted_s)
        self._doubted_s = now
        self._doubtful = self._doubt.value > (0.4 if self._doubtful else 0.6)

    def pass_time(self, now: float, dt: float) -> None:
        seen = self._seen_s == now
        if not seen:
            self._opening = None
        if now - self._judged_s > self._params.way_forget_s:
            self.clear = None
        score = self._opening.score if self._opening is not None else 0.0
        self.score += min(1.0, dt / self._params.smooth_s) * (score - self.score)

    def reason(self, method: str) -> Reason:
        params, size = self._params, abs(self.bearing.value)
        self._aligned = size <= (params.turn_from_deg if self._aligned else params.aligned_deg)
        if self.clear is False:
            return Reason.BLOCKED
        if self._doubtful:
            return Reason.UNSURE
        return Reason.ALIGNED if self._aligned and method != "paper" else Reason.TURN

    def selection(self, raw: Selection) -> Selection:
        """The frame's selection with what is known of this opening in its place."""
        seen, openings = self._opening, raw.openings
        if seen is not None and seen in openings:
            openings = (seen, *(opening for opening in openings if opening is not seen))
        # The frame's own pixel and way are those of its best opening.
        followed = seen is not None and (not raw.openings or seen is raw.openings[0])
        why = self._why if self._doubtful else None
        return replace(
            raw,
            bearing_deg=self.bearing.value,
            range_m=None if self.range is None else self.range.value,
            clear=self.clear,
            openings=openings,
            pixel=raw.pixel if followed else None,
            unsure=None if why is None else why.unsure,
            look=None if why is None else why.look,
            evidence=raw.evidence if followed else {},
        )


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
