"""`3ds replay`: decide a recorded run once more."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doorway3ds.cli.shared.options import Threads
from doorway3ds.errors import CallError, UserError

if TYPE_CHECKING:
    from doorway3ds.decide.pipeline import Pipeline
    from doorway3ds.types import Perception


def replay(
    run: Annotated[
        Path, typer.Argument(metavar="DIR", help="A folder that `3ds run` or `3ds live` wrote.")
    ],
    network: Annotated[
        str | None,
        typer.Option(metavar="NAME[+NAME]", help="Another network than the run's."),
    ] = None,
    method: Annotated[str | None, typer.Option(help="Another method: opening or paper.")] = None,
    tolerance: Annotated[float, typer.Option(help="Numbers may differ by this share.")] = 1e-6,
    threads: Threads = None,
) -> None:
    """Decide on each recorded picture again and say where the answer differs.

    Exit status: 0 all decisions are the same, 1 some differ or the run cannot be read.
    """
    from doorway3ds.decide.follow import follow
    from doorway3ds.robots.runlog import differences, looks, read_log

    events = read_log(run)
    pipeline, kept = _pipeline(events[0], network, method, threads)
    total = changed = 0
    for look in looks(run, events):
        total += 1
        if kept is not None:
            kept.perception = look.perception
        decision = pipeline.decide(look.frame)
        now = follow(decision, look.expected_deg, pipeline.params, pipeline.gates).to_dict()
        names = differences(look.decision, now, tolerance)
        before = f"look {look.step}: {_short(look.decision)} -> {look.action}"
        if names:
            changed += 1
            sys.stdout.write(f"{before}; now {_short(now)} (differs: {', '.join(names)})\n")
        else:
            sys.stdout.write(f"{before}; the same\n")
    sys.stderr.write(f"{total - changed} of {total} decisions are the same\n")
    if events[-1]["event"] != "end":
        sys.stderr.write("the run has no end: it was cut off\n")
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
            raise UserError("this look was recorded without what the network said")
        return self.perception


def _pipeline(
    start: dict[str, Any], network: str | None, method: str | None, threads: int | None
) -> tuple[Pipeline, _Kept | None]:
    from doorway3ds.cli.shared.pipeline import build_pipeline
    from doorway3ds.decide.gates import Gates
    from doorway3ds.decide.pipeline import Method, Pipeline

    if method not in (None, "opening", "paper"):
        raise CallError(f"--method must be opening or paper, got {method!r}")
    try:
        name, gates = str(start["network"]), Gates(**start["gates"])
        how: Method = "paper" if (method or start["method"]) == "paper" else "opening"
    except (KeyError, TypeError) as error:
        raise UserError(f"the run's first line lacks {error}") from error
    if network is None and name == "truth":
        kept = _Kept(name)
        return Pipeline(kept, method=how, gates=gates), kept
    params = start.get("params") or {}
    width = (params.get("clearance") or {}).get("width_m")
    built = build_pipeline(how, network or name, width, gates.max_unseen_m, threads)
    return replace(built, gates=gates), None


def _short(decision: dict[str, Any]) -> str:
    turn = decision.get("turn_deg")
    return f"{decision['reason']}" + ("" if turn is None else f" {turn:+.2f} deg")
