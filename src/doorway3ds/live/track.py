"""One opening over time: where it is, how far, and whether the way to it is free."""

from __future__ import annotations

from dataclasses import dataclass, replace

from doorway3ds.arguments import require_numbers
from doorway3ds.decide.options import ALIGNED_DEG
from doorway3ds.live.filters import Belief, Smoothed
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
    aligned_deg: float = ALIGNED_DEG
    turn_from_deg: float = 4.5
    restart_s: float = 5.0

    def __post_init__(self) -> None:
        require_numbers(self)


class Track:
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
