"""`3ds run`: the closed loop on a robot."""

from __future__ import annotations

import contextlib
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doorway3ds.cli.shared.camera import CameraOptions, require_range
from doorway3ds.cli.shared.options import Camera, MaxUnseenM, Method, Threads, WidthM
from doorway3ds.cli.shared.robot import (
    MOVE_HELP,
    ROBOT_HELP,
    logged,
    pipeline_for,
    require_robot,
    robot_of,
)
from doorway3ds.errors import UserError

if TYPE_CHECKING:
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
        typer.Option(metavar="ROBOT", help=ROBOT_HELP),
    ] = "dry",
    move: Annotated[bool, typer.Option("--move", help=MOVE_HELP)] = False,
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

    from doorway3ds.cli.shared.signals import ended_by_sigterm
    from doorway3ds.decide.follow import follow
    from doorway3ds.robots.base import Driver, Limits
    from doorway3ds.robots.loop import Loop, LoopParams
    from doorway3ds.sources import open_source

    require_robot(robot)
    limits = Limits(max_turn_deg=max_turn_deg, ttl_s=ttl_s, turn_timeout_s=turn_timeout_s)
    with ExitStack() as stack:
        stack.enter_context(ended_by_sigterm())
        eyes: dict[str, Any] = {"camera": choice.fit, "pose": choice.pose} if camera else {}
        found = stack.enter_context(open_source(source, **eyes))
        pipeline = pipeline_for(found, method, network, width_m, max_unseen_m, threads)
        legs = stack.enter_context(robot_of(robot, found, limits))
        driver = Driver(legs, move=move, limits=limits)
        record = stack.enter_context(logged(log, pipeline, found, driver))
        params = LoopParams(aligned_deg=aligned_deg, blocked_s=blocked_s)

        def decide(frame: Frame, expected_deg: float | None) -> Decision:
            decision = pipeline.decide(frame)
            return follow(decision, expected_deg, pipeline.params, pipeline.gates)

        check = pipeline.check_way if method == "opening" else None
        report = Loop(found, decide, driver, params, check=check, log=record, tell=_tell).run()
        if say and move:
            with contextlib.suppress(UserError):
                legs.say(_SAID.get(report.outcome, "I stopped."))
        if rest and move and hasattr(legs, "rest"):
            legs.rest()
    sys.stdout.write(f"{report.outcome}: {report.why}\n")
    _tell(
        f"{report.looks} looks, {report.goes} turns towards a doorway, {report.searches} to look "
        f"around, {report.took_s:.1f} s; log in {record.folder}"
    )
    if report.outcome.status:
        raise typer.Exit(report.outcome.status)


def _tell(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()
