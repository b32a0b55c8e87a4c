"""What `3ds live` does with each frame: panel, lines, film, recording."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from doorway3ds.cli.shared.panel import Panel
    from doorway3ds.images.film import Film
    from doorway3ds.live.eyes import Update
    from doorway3ds.live.session import Session
    from doorway3ds.live.tracker import Tracked
    from doorway3ds.robots.runlog import RunLog
    from doorway3ds.sources import Source

_WAIT_S = 0.25
_SAY_S = 1.0  # between lines without a panel, where the reason stays the same


class Watch:
    """Shows and keeps what a session decides.

    offer: is called with each update first. why: how `all` ended.
    keep: are called with every update and its line of JSON.
    """

    why = "the source ended"

    panel: Panel | None = None
    log: RunLog | None = None
    offer: Callable[[Update], None] | None = None

    def __init__(self, session: Session, as_json: bool, film: Film | None = None) -> None:
        self.session, self._as_json, self._film = session, as_json, film
        self.keep: list[Callable[[Update, dict[str, Any]], None]] = []
        self._lost = False
        self._said: tuple[str, float] = ("", 0.0)

    def all(self, most: int | None = None) -> None:
        """Until the source ends, `most` frames are answered, or the session is stopped."""
        last = None
        while not self.session.ended:
            update = self.session.read(_WAIT_S)
            if update is None:
                continue
            if not update.fresh:
                self._miss(update)
                continue
            last, self._lost = update, False
            self._answer(update)
            if most is not None and update.number >= most:
                self.why = "as many frames as asked for"
                break
        if last is not None and self.panel is not None:
            self.panel.show(last.tracked, last=True)

    def _answer(self, update: Update) -> None:
        tracked, raw = update.tracked, update.raw
        if self.offer is not None:
            self.offer(update)
        if self._as_json:
            print_json(self._line(tracked, update.name))
        elif self.panel is not None:
            self.panel.rate.tick()
            self.panel.means.add(dict(raw.timings_ms))
            self.panel.show(tracked)
        else:
            self._say(tracked, update.name)
        if self._film is not None:
            from doorway3ds.draw import overlay

            self._film.add(overlay(tracked.decision), raw.frame.stamp_s)
        if self.keep:
            line = self._line(tracked, update.name)
            for keep in self.keep:
                keep(update, line)
        if self.log is not None:
            self.log.look(update.number, raw, str(tracked.decision.reason))
            self.log.write("tracked", step=update.number, **tracked.to_dict())

    def _miss(self, update: Update) -> None:
        """No image comes any more: said once on paper, shown all the time in the panel."""
        if self.panel is not None:
            self.panel.show(update.tracked)
        if self._lost:
            return
        self._lost = True
        source = self.session.source
        if self._as_json:
            tracked = {"problem": source.problem, "tracked": update.tracked.to_dict()}
            lost = {"image": source.name, "reason": "lost", "turn_deg": None, **tracked}
            print_json({**lost, "stamp_s": time.monotonic(), "source": counts(source)})
        elif self.panel is None:
            self._say(update.tracked, source.name)

    def _line(self, tracked: Tracked, name: str) -> dict[str, Any]:
        """The object of `3ds look --json`, and what memory adds."""
        return {
            **tracked.raw.to_dict(name),
            "stamp_s": tracked.raw.frame.stamp_s,
            "tracked": tracked.to_dict(),
            "source": counts(self.session.source),
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
