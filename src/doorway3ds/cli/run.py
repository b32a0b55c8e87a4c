"""`3ds run`: the closed loop on a robot."""

from __future__ import annotations

import contextlib
import sys
from contextlib import ExitStack
from typing import Annotated, Any

import typer

from doorway3ds.camera.options import CameraOptions
from doorway3ds.cli.shared.options import expand
from doorway3ds.cli.shared.output import apart
from doorway3ds.cli.shared.output import say as tell
from doorway3ds.cli.shared.robot import (
    ROBOT_HELP,
    RunFolder,
    driver_of,
    ended_by_sigterm,
    logged,
    open_eyes,
    outcome_words,
    pipeline_for,
    reason_word,
    require_robot,
)
from doorway3ds.cli.shared.viewer import Rerun, recorded, viewer_of
from doorway3ds.decide.options import DecideOptions
from doorway3ds.errors import UserError
from doorway3ds.options import setting
from doorway3ds.robots.options import MotionOptions

_SAID = {
    "aligned": "I am facing the doorway.",
    "no_door": "I see no open door.",
    "blocked": "Something is in my way.",
    "unsure": "I am not sure.",
    "lost": "I cannot see.",
}


@expand
def run(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE", help="The robot's camera: nao://HOST, sim://home?..., webcam://0, ..."
        ),
    ],
    motion: MotionOptions,
    camera: CameraOptions,
    decide: DecideOptions,
    robot: str = setting("dry", ROBOT_HELP, metavar="ROBOT"),
    log: RunFolder = None,
    rerun: Rerun = None,
    say: bool = setting(False, "Let the robot say how it ended."),
    rest: bool = setting(False, "Let NAO rest afterwards, motors off."),
) -> None:
    """Look, decide, turn, look again, until the robot faces the doorway or should not.

    Without --move nothing moves and the first step is only reported.

    Exit status: 0 it faces the doorway (or reports what it would do), 1 an error, 2 wrong call,
    3 no open doorway in a full circle, 4 blocked, 5 unsure, 6 camera or robot lost,
    7 bumper or fall, 130 Ctrl-C.

    docs/reasons.md says what each reason asks you to do.

    Example: 3ds run 'sim://home?seed=7' --robot sim --move
    """
    from doorway3ds.draw.words import counted
    from doorway3ds.live.session import Session
    from doorway3ds.robots.loop import LoopParams, TurnLoop
    from doorway3ds.robots.runlog import LOG

    require_robot(robot)
    apart({"--log": None if log is None else log / LOG, "--rerun": recorded(rerun)})
    with ExitStack() as stack:
        stack.enter_context(ended_by_sigterm())
        found = stack.enter_context(open_eyes(source, camera))
        found.notice = tell
        pipeline = pipeline_for(found, decide)
        driver = stack.enter_context(driver_of(robot, found, motion))
        record = stack.enter_context(logged(log, decide, pipeline, found, driver))
        params = LoopParams(aligned_deg=decide.aligned_deg, blocked_s=motion.blocked_s)
        viewer = stack.enter_context(viewer_of(rerun))
        # It looks when the loop asks, so that no look is older than it must be.
        eyes = stack.enter_context(Session(found, pipeline, ahead=0))
        shown: dict[str, Any] = {"decided": viewer.add} if viewer else {}
        report = TurnLoop(
            eyes, driver, params, log=record, tell=tell, word=reason_word, **shown
        ).run()
        if say and motion.move:
            with contextlib.suppress(UserError):
                driver.robot.say(_SAID.get(report.outcome, "I stopped."))
        if rest and motion.move and hasattr(driver.robot, "rest"):
            driver.robot.rest()
    sys.stdout.write(f"{outcome_words(report)}\n")
    tell(
        f"{counted(report.looks, 'look')}, {counted(report.goes, 'turn')} towards a doorway, "
        f"{report.searches} to look around, {report.took_s:.1f} s; log in {record.folder}"
    )
    if report.outcome.status:
        raise typer.Exit(report.outcome.status)
