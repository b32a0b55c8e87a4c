"""What `3ds live` does with each frame: panel, lines, film, recording."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from doorway3ds.live.feed import Feed
from doorway3ds.types import Decision, Frame, Perception, Reason

if TYPE_CHECKING:
    from doorway3ds.cli.shared.panel import Panel
    from doorway3ds.decide.pipeline import Pipeline
    from doorway3ds.images.film import Film
    from doorway3ds.live.tracker import Tracked
    from doorway3ds.robots.runlog import RunLog
    from doorway3ds.sources import Source

_WAIT_S = 0.25
_SAY_S = 1.0  # between lines without a panel, where the reason stays the same


@dataclass(frozen=True)
class _Seen:
    """A frame, what it is called, and what the network saw in it."""

    frame: Frame
    name: str
    perception: Perception


class Watch:
    """Decides on every frame of a source, with memory.

    decided: is called with each frame's own decision. heading: the robot's, in degrees, where one
    turns under the camera. why: how `all` ended.
    """

    why = "the source ended"

    panel: Panel | None = None
    film: Film | None = None
    log: RunLog | None = None
    decided: Callable[[Decision], None] | None = None
    heading: Callable[[], float | None] | None = None

    def __init__(
        self, pipeline: Pipeline, source: Source, as_json: bool, prefetch: bool = False
    ) -> None:
        from doorway3ds.live.tracker import Tracker

        self._pipeline, self._source, self._as_json = pipeline, source, as_json
        self._prefetch = prefetch
        self._tracker = Tracker()
        self._stopping = threading.Event()
        self._headed_deg: float | None = None
        self._done = 0
        self._lost = False
        self._said: tuple[str, float] = ("", 0.0)

    def all(self, most: int | None = None) -> None:
        """Until the source ends, `most` frames are answered, or `stop`."""
        tracked = None
        with Feed(self._source, self._see, prefetch=self._prefetch) as feed:
            while not feed.ended and not self._stopping.is_set():
                seen = feed.read(_WAIT_S)
                if seen is not None:
                    self._lost = False
                    tracked = self._decide(seen)
                    self._answer(tracked, seen.name)
                    if most is not None and self._done >= most:
                        self.why = "as many frames as asked for"
                        break
                elif self._source.live and feed.silent and not feed.ended:
                    silent = self._tracker.without_picture(time.monotonic())
                    if silent is not None and silent.decision.reason is Reason.LOST:
                        self._miss(silent)
        if tracked is not None and self.panel is not None:
            self.panel.show(tracked, last=True)

    def stop(self) -> None:
        """Ends `all`, from any thread."""
        self._stopping.set()

    def _see(self, frame: Frame, name: str) -> _Seen:
        return _Seen(frame, name, self._pipeline.perceive(frame))

    def _decide(self, seen: _Seen) -> Tracked:
        decision = self._pipeline.conclude(seen.frame, seen.perception)
        self._done += 1
        if self.decided is not None:
            self.decided(decision)
        return self._tracker.update(decision, self._turned_deg())

    def _turned_deg(self) -> float:
        """By how much the robot has turned since the frame before."""
        if self.heading is None:
            return 0.0
        before, self._headed_deg = self._headed_deg, self.heading()
        if before is None or self._headed_deg is None:
            return 0.0
        return (self._headed_deg - before + 180) % 360 - 180

    def _answer(self, tracked: Tracked, name: str) -> None:
        raw = tracked.raw
        if self._as_json:
            print_json(self._line(tracked, name))
        elif self.panel is not None:
            self.panel.rate.tick()
            self.panel.means.add(dict(raw.timings_ms))
            self.panel.show(tracked)
        else:
            self._say(tracked, name)
        if self.film is not None:
            from doorway3ds.draw import overlay

            self.film.add(overlay(tracked.decision), raw.frame.stamp_s)
        if self.log is not None:
            self.log.look(self._done, raw, str(tracked.decision.reason))
            self.log.write("tracked", step=self._done, **tracked.to_dict())

    def _miss(self, silent: Tracked) -> None:
        """No picture comes any more: said once on paper, shown all the time in the panel."""
        if self.panel is not None:
            self.panel.show(silent)
        if self._lost:
            return
        self._lost = True
        if self._as_json:
            source = self._source
            tracked = {"problem": source.problem, "tracked": silent.to_dict()}
            lost = {"image": source.name, "reason": "lost", "turn_deg": None, **tracked}
            print_json({**lost, "stamp_s": time.monotonic(), "source": counts(source)})
        elif self.panel is None:
            self._say(silent, self._source.name)

    def _line(self, tracked: Tracked, name: str) -> dict[str, Any]:
        """The object of `3ds look --json`, and what memory adds."""
        return {
            **tracked.raw.to_dict(name),
            "stamp_s": tracked.raw.frame.stamp_s,
            "tracked": tracked.to_dict(),
            "source": counts(self._source),
        }

    def _say(self, tracked: Tracked, name: str) -> None:
        """A line where the reason changes, else once a second."""
        from doorway3ds.draw.words import headline, sentence

        decision, now = tracked.decision, time.monotonic()
        reason, said_s = self._said
        if reason == decision.reason and now - said_s < _SAY_S:
            return
        self._said = (str(decision.reason), now)
        words = f"{headline(decision)}. {sentence(decision)}".replace("\u00a0", " ")
        sys.stdout.write(f"{name}: {words}\n")
        sys.stdout.flush()


def counts(source: Source) -> dict[str, int]:
    """What went wrong with a source so far."""
    return {name: getattr(source, name) for name in ("skipped", "damaged", "reconnects")}


def print_json(line: dict[str, Any]) -> None:
    """One object on a line of its own, flushed at once."""
    sys.stdout.write(json.dumps(line, allow_nan=False) + "\n")
    sys.stdout.flush()
