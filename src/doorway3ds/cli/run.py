"""`3ds run`: the closed loop on a robot."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doorway3ds.cli._camera import CameraOptions, require_range
from doorway3ds.cli._options import Camera, MaxUnseenM, Method, Threads, WidthM
from doorway3ds.errors import CallError, UserError

if TYPE_CHECKING:
    from doorway3ds.pipeline import Pipeline
    from doorway3ds.robots.base import Limits, Robot
    from doorway3ds.sources import Source
    from doorway3ds.types import Decision, Frame

_SAID = {
    "aligned": "I am facing the doorway.",
    "no_door": "I see no open door.",
    "blocked": "Something is in my way.",
    "unsure": "I am not sure.",
    "lost": "I cannot see.",
}


def run(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE", help="The robot's camera: nao://HOST, sim://home?..., webcam://0, ..."
        ),
    ],
    robot: Annotated[
        str,
        typer.Option(
            metavar="ROBOT", help="nao://HOST[:PORT], sim (the robot of a sim:// source), or dry."
        ),
    ] = "dry",
    move: Annotated[
        bool, typer.Option("--move", help="Allow motion. Without it nothing moves.")
    ] = False,
    method: Method = "opening",
    network: Annotated[
        str,
        typer.Option(
            metavar="NAME[+NAME]", help="See `3ds models`; an .onnx file; truth on a sim:// source."
        ),
    ] = "doornet",
    log: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where the run is logged; default 3ds-run-DATE-TIME."),
    ] = None,
    say: Annotated[bool, typer.Option("--say", help="The robot says how it ended.")] = False,
    rest: Annotated[bool, typer.Option("--rest", help="NAO rests afterwards: motors off.")] = False,
    camera: Camera = None,
    width_m: WidthM = None,
    max_unseen_m: MaxUnseenM = None,
    aligned_deg: Annotated[float, typer.Option(help="It faces a doorway within this.")] = 3.0,
    max_turn_deg: Annotated[float, typer.Option(help="No turn is larger.")] = 60.0,
    ttl_s: Annotated[float, typer.Option(help="No motion on an older decision.")] = 2.0,
    turn_timeout_s: Annotated[float, typer.Option(help="A longer turn is stopped.")] = 20.0,
    blocked_s: Annotated[float, typer.Option(help="Between looks at a blocked way.")] = 2.0,
    threads: Threads = None,
) -> None:
    """Look, decide, turn, look again, until the robot faces the doorway or should not.

    Without --move nothing moves and the first step is only said. Exit status: 0 it faces the
    doorway (or says what it would do), 1 an error, 2 wrong call, 3 no open doorway in a full
    circle, 4 blocked, 5 unsure, 6 camera or robot lost, 7 bumper or fall, 130 Ctrl-C.
    """
    require_range("--aligned-deg", aligned_deg, 0.5, 30)
    require_range("--max-turn-deg", max_turn_deg, 1, 180)
    require_range("--ttl-s", ttl_s, 0.05, 60)
    require_range("--turn-timeout-s", turn_timeout_s, 0.5, 120)
    require_range("--blocked-s", blocked_s, 0, 600)
    choice = CameraOptions(camera).resolve()

    from doorway3ds.cli._signals import ended_by_sigterm
    from doorway3ds.follow import follow
    from doorway3ds.loop import Loop, LoopParams
    from doorway3ds.robots.base import Driver, Limits
    from doorway3ds.runlog import RunLog
    from doorway3ds.sources import open_source

    limits = Limits(max_turn_deg=max_turn_deg, ttl_s=ttl_s, turn_timeout_s=turn_timeout_s)
    folder = log or Path(time.strftime("3ds-run-%Y%m%d-%H%M%S"))
    with ExitStack() as stack:
        stack.enter_context(ended_by_sigterm())
        eyes: dict[str, Any] = {"camera": choice.fit, "pose": choice.pose} if camera else {}
        found = stack.enter_context(open_source(source, **eyes))
        pipeline = _pipeline(found, method, network, width_m, max_unseen_m, threads)
        legs = stack.enter_context(_robot(robot, found, limits))
        record = stack.enter_context(RunLog(folder, perception=network == "truth"))
        record.write(
            "start", version=_version(), method=method, network=pipeline.network.name,
            gates=asdict(pipeline.gates), params=pipeline.params and asdict(pipeline.params),
            limits=asdict(limits), source=found.name, robot=legs.name, move=move,
        )  # fmt: skip
        params = LoopParams(aligned_deg=aligned_deg, blocked_s=blocked_s)
        driver = Driver(legs, move=move, limits=limits)

        def decide(frame: Frame, expected_deg: float | None) -> Decision:
            decision = pipeline.decide(frame)
            return follow(decision, expected_deg, pipeline.params, pipeline.gates)

        report = Loop(found, decide, driver, params, log=record, tell=_tell).run()
        if say and move:
            with contextlib.suppress(UserError):
                legs.say(_SAID.get(report.outcome, "I stopped."))
        if rest and move and hasattr(legs, "rest"):
            legs.rest()
    sys.stdout.write(f"{report.outcome}: {report.why}\n")
    _tell(
        f"{report.looks} looks, {report.goes} turns towards a doorway, {report.searches} to look "
        f"around, {report.took_s:.1f} s; log in {folder}"
    )
    if report.outcome.status:
        raise typer.Exit(report.outcome.status)


def _pipeline(
    source: Source,
    method: str,
    network: str,
    width_m: float | None,
    max_unseen_m: float | None,
    threads: int | None,
) -> Pipeline:
    from doorway3ds.cli._pipeline import build_pipeline

    if network != "truth":
        return build_pipeline(method, network, width_m, max_unseen_m, threads)

    from doorway3ds.decision import Gates
    from doorway3ds.pipeline import Pipeline
    from doorway3ds.sources.sim import TruthNetwork

    if method not in ("opening", "paper"):
        raise CallError(f"--method must be opening or paper, got {method!r}")
    return Pipeline(
        TruthNetwork(source),
        method="paper" if method == "paper" else "opening",
        gates=Gates(max_unseen_m=max_unseen_m),
    )


@contextlib.contextmanager
def _robot(name: str, source: Source, limits: Limits) -> Iterator[Robot]:
    from doorway3ds.robots.base import DryRobot

    legs: Robot
    if name == "dry":
        legs = DryRobot()
    elif name == "sim":
        from doorway3ds.sim.world import SimRobot
        from doorway3ds.sources.sim import SimSource

        if not isinstance(source, SimSource):
            raise CallError("--robot sim needs a sim:// source, whose robot it is")
        legs = SimRobot(source.world)
    elif name.startswith("nao://"):
        from doorway3ds.robots.nao import NaoRobot

        legs = NaoRobot(name, limits)
    else:
        raise CallError(f"--robot must be nao://HOST[:PORT], sim or dry, got {name!r}")
    try:
        yield legs
    finally:
        legs.close()


def _version() -> str:
    from doorway3ds import __version__

    return __version__


def _tell(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()
