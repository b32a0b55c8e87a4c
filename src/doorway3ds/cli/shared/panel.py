"""What `3ds live` shows in a terminal: one panel that stays in place."""

from __future__ import annotations

import time
from collections import deque
from typing import TYPE_CHECKING, Any

from doorway3ds.types import Reason

if TYPE_CHECKING:
    from rich.console import RenderableType

    from doorway3ds.live.tracker import Tracked
    from doorway3ds.sources import Source

_REFRESH_S = 0.2
_RATE_S = 3.0
_WIDEST = 76
_LABEL = 10
_BAR = 22
_COLOURS = {
    Reason.TURN: "green",
    Reason.ALIGNED: "green",
    Reason.BLOCKED: "red",
    Reason.UNSURE: "yellow",
    Reason.NO_DOOR: "blue",
    Reason.LOST: "magenta",
}


class Rate:
    """Decisions a second, over the last three."""

    def __init__(self) -> None:
        self._times: deque[float] = deque()

    def tick(self) -> None:
        now = time.monotonic()
        self._times.append(now)
        while now - self._times[0] > _RATE_S:
            self._times.popleft()

    @property
    def per_s(self) -> float:
        if len(self._times) < 2:
            return 0.0
        return (len(self._times) - 1) / max(self._times[-1] - self._times[0], 1e-9)


class Means:
    """Milliseconds of each stage, averaged so that they can be read."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}

    def add(self, timings_ms: dict[str, float]) -> None:
        for stage, ms in timings_ms.items():
            self.ms[stage] = self.ms.get(stage, ms) + 0.05 * (ms - self.ms.get(stage, ms))


class Panel:
    """Draws at most five times a second, into the same lines."""

    def __init__(self, title: str, source: Source) -> None:
        from rich.console import Console
        from rich.live import Live

        self._console = Console()
        self._live = Live(console=self._console, auto_refresh=False, transient=False)
        self._title, self._source = title, source
        self._plain = not self._console.encoding.lower().startswith("utf")
        self._plus_minus = "+-" if self._plain else "±"
        self._drawn_s = 0.0
        self.rate, self.means = Rate(), Means()

    def __enter__(self) -> Panel:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def say(self, line: str) -> None:
        """A line above the panel."""
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)

    def show(self, tracked: Tracked, last: bool = False) -> None:
        now = time.monotonic()
        if not last and now - self._drawn_s < _REFRESH_S:
            return
        self._drawn_s = now
        self._live.update(self.render(tracked), refresh=True)

    def render(self, tracked: Tracked) -> RenderableType:
        from rich.table import Table
        from rich.text import Text

        from doorway3ds.draw.words import headline, help_link, help_page, sentence

        decision = tracked.decision
        width = min(self._console.width, _WIDEST)
        colour = _COLOURS[decision.reason]
        clear = decision.selection.clear if tracked.number else None
        word = {True: "free", False: "blocked", None: "not seen"}[clear]
        grid = Table.grid(padding=(0, 1))
        grid.width = width
        grid.add_column(width=_LABEL, style="dim")
        grid.add_column(overflow="fold")
        for label, value in (
            ("belief", self._bar(tracked.belief)),
            ("bearing", self._bearing(tracked)),
            ("distance", self._distance(tracked)),
            ("way", word if tracked.free is None else f"{word} (belief {tracked.free:.2f})"),
            ("followed", _followed(tracked)),
            ("camera", self._camera(tracked)),
            ("time", _stages(self.means.ms)),
            ("help", Text(help_page(decision.reason), f"link {help_link(decision.reason)}")),
        ):
            grid.add_row(label, value)
        rule = ("-" if self._plain else "─") * width
        head = Text.assemble((headline(decision), f"bold {colour}"))
        # Two lines whatever is said, so that nothing below moves.
        lines = Text(sentence(decision)).wrap(self._console, width)
        words = Text("\n").join([*lines, Text(""), Text("")][:2])
        whole = Table.grid()
        title = Text(self._title, "dim", no_wrap=True, overflow="ellipsis")
        for row in (title, Text(rule, "dim"), head, words, Text(""), grid):
            whole.add_row(row)
        return whole

    def _bar(self, share: float) -> str:
        full, rest = ("#", ".") if self._plain else ("█", "░")
        filled = round(share * _BAR)
        return f"{full * filled}{rest * (_BAR - filled)} {share:.2f}"

    def _bearing(self, tracked: Tracked) -> str:
        """A dial over the camera's field of view, left on the left."""
        dash, mark, middle = ("-", "o", "|") if self._plain else ("─", "●", "┼")
        dial = [dash] * (_BAR + 1)
        dial[_BAR // 2] = middle
        bearing, sd = tracked.bearing_deg, tracked.bearing_sd_deg
        if bearing is None or sd is None:
            return "".join(dial)
        half = tracked.raw.frame.camera.hfov_deg / 2
        at = round(_BAR / 2 * (1 - max(-1.0, min(1.0, bearing / half))))
        dial[at] = mark
        side = "left" if bearing > 0 else "right"
        degrees = " deg" if self._plain else "°"
        error = tracked.bearing_error_deg
        within = "" if error is None else f" {self._plus_minus} {error:.1f}{degrees}"
        return (
            f"{''.join(dial)} {abs(bearing):.1f}{degrees} {side}{within}, "
            f"steady to {sd:.1f}{degrees}"
        )

    def _distance(self, tracked: Tracked) -> str:
        if tracked.range_m is None or tracked.range_sd_m is None:
            return "unknown"
        steady = f"steady to {tracked.range_sd_m:.2f} m"
        if tracked.range_error_m is None:
            return f"{tracked.range_m:.2f} m, {steady}"
        error = f"{self._plus_minus} {tracked.range_error_m:.1f} m"
        return f"{tracked.range_m:.1f} m {error} as measured for this network, {steady}"

    def _camera(self, tracked: Tracked) -> str:
        source, camera = self._source, tracked.raw.frame.camera
        parts = [f"{self.rate.per_s:.1f} decisions/s", f"{camera.width}x{camera.height}"]
        for name in ("skipped", "damaged", "reconnects"):
            count = getattr(source, name)
            if count:
                parts.append(f"{count} {name}")
        if camera.assumed:
            parts.append("field of view assumed")
        if source.problem:
            parts.append(source.problem)
        return (" - " if self._plain else " · ").join(parts)


def _followed(tracked: Tracked) -> str:
    if not tracked.number:
        return "none"
    unseen = f", unseen for {tracked.unseen_s:.1f} s" if tracked.unseen_s > 0.15 else ""
    return f"doorway {tracked.number} for {tracked.age_s:.0f} s{unseen}"


def _stages(ms: dict[str, Any]) -> str:
    if not ms:
        return ""
    stages = ", ".join(f"{stage} {value:.1f}" for stage, value in ms.items())
    return f"{sum(ms.values()):.1f} ms: {stages}"
