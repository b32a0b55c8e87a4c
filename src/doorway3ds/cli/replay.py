"""`3ds replay`: decide a recorded run once more."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doorway3ds.cli.shared.options import expand
from doorway3ds.cli.shared.output import linked, say
from doorway3ds.cli.shared.viewer import Rerun, viewer_of
from doorway3ds.decide.options import DecideOptions, Method
from doorway3ds.errors import UserError
from doorway3ds.options import THREADS, setting
from doorway3ds.types import Reason

if TYPE_CHECKING:
    from doorway3ds.decide.pipeline import Pipeline
    from doorway3ds.types import Perception


@expand
def replay(
    run: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder that `3ds run` or `3ds live` wrote.")
    ],
    network: str | None = setting(
        None, "Network to use instead of the run's.", metavar="NAME[+NAME]"
    ),
    method: Method | None = setting(None, "Method to use instead of the run's."),
    tolerance: float = setting(
        1e-6, "Relative difference within which numbers agree.", low=0, high=1
    ),
    threads: int | None = setting(None, "CPU threads of the network.", **THREADS),
    rerun: Rerun = None,
) -> None:
    """Decide on each recorded image again and report where the answer differs.

    Exit status: 0 all decisions are the same, 1 some differ or the run cannot be read.

    docs/reasons.md says what each reason asks you to do.

    Example: 3ds replay 3ds-run-20261128-101500 --method paper
    """
    from doorway3ds.draw.words import help_page
    from doorway3ds.robots.runlog import differences, looks, read_log

    events = read_log(run)
    pipeline, kept = _pipeline(events[0], network, method, threads)
    total = changed = 0
    with viewer_of(rerun) as viewer:
        for look in looks(run, events):
            total += 1
            if kept is not None:
                kept.perception = look.perception
            decision = pipeline.decide(look.frame, look.expected_deg)
            if viewer is not None:
                viewer.add(decision)
            now = decision.to_dict()
            names = differences(look.decision, now, tolerance)
            before = f"look {look.step}: {_short(look.decision)} -> {look.action}"
            if names:
                changed += 1
                sys.stdout.write(f"{before}; now {_short(now)} (differs: {', '.join(names)})\n")
            else:
                sys.stdout.write(f"{before}; the same\n")
    reasons = linked(help_page(), None, sys.stderr)
    say(f"{total - changed} of {total} decisions are the same; reasons: {reasons}")
    if events[-1]["event"] != "end":
        say("the run has no end: it was cut off")
    if changed:
        raise typer.Exit(1)


class _Kept:
    """What the network of the run said, for networks that cannot be asked again."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.gives = frozenset({"p_open", "columns", "depth", "floor"})
        self.perception: Perception | None = None

    def __call__(self, image: Any, camera: Any) -> Perception:
        if self.perception is None:
            raise UserError("this look was recorded without the network's output")
        return self.perception


def _pipeline(
    start: dict[str, Any], network: str | None, method: Method | None, threads: int | None
) -> tuple[Pipeline, _Kept | None]:
    from doorway3ds.decide.pipeline import build_pipeline

    try:
        options = DecideOptions(**start["options"])
    except (KeyError, TypeError) as error:
        raise UserError(f"the run's first line lacks {error}") from error
    given: dict[str, Any] = {"network": network, "method": method, "threads": threads}
    options = replace(options, **{name: v for name, v in given.items() if v is not None})
    kept = _Kept(options.network) if options.network == "truth" else None
    return build_pipeline(options, kept), kept


def _short(decision: dict[str, Any]) -> str:
    turn, reason = decision.get("turn_deg"), Reason(decision["reason"])
    return linked(reason, reason, sys.stdout) + ("" if turn is None else f" {turn:+.2f} deg")
