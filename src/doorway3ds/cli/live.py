"""`3ds live`: decisions with memory on a camera, a stream, a video or a robot's eyes."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doorway3ds.camera.options import CameraOptions
from doorway3ds.cli.shared.options import expand
from doorway3ds.cli.shared.output import apart, complain, quiet_decoders, say
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
from doorway3ds.cli.shared.watch import Watch, counts, print_json
from doorway3ds.decide.options import DecideOptions
from doorway3ds.errors import CallError, UserError
from doorway3ds.images.film import Film, require_film
from doorway3ds.options import setting
from doorway3ds.robots.options import MotionOptions
from doorway3ds.sources.options import SourceOptions
from doorway3ds.threads import Worker

if TYPE_CHECKING:
    from doorway3ds.decide.pipeline import Pipeline
    from doorway3ds.live.eyes import Update
    from doorway3ds.robots.base import Driver, Robot
    from doorway3ds.robots.loop import LoopParams, Report
    from doorway3ds.robots.runlog import RunLog


@expand
def live(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="webcam://0, rtsp://..., http://... (MJPEG), a video, a folder, 'pattern*.jpg', "
            "- (images on standard input), bag://..., sim://... or nao://...",
        ),
    ],
    motion: MotionOptions,
    camera: CameraOptions,
    decide: DecideOptions,
    reading: SourceOptions,
    as_json: bool = setting(
        False, "Print one JSON object per frame, one per line.", names=("--json",)
    ),
    out: Path | None = setting(
        None, "Annotated video to write: .mp4, .mkv, .avi or .webm.", metavar="FILE"
    ),
    bag: Path | None = setting(
        None, "Bag to write: images, decisions, markers and depth.", metavar="DIR"
    ),
    rerun: Rerun = None,
    frames: int | None = setting(None, "Stop after N frames.", low=1, high=10**9),
    log: RunFolder = None,
    robot: str | None = setting(None, ROBOT_HELP, metavar="ROBOT"),
) -> None:
    """Decide on every frame, with memory between frames, until the source ends or Ctrl-C.

    In a terminal a panel shows the decision; elsewhere a line is printed when it changes.
    With --robot it ends as `3ds run` does, with every decision shown meanwhile.

    Exit status: 0 the source ended, 1 it was lost or held images that could not be read,
    2 wrong call, 130 ended by Ctrl-C; with --robot that of `3ds run`.

    docs/reasons.md says what each reason asks you to do.

    Example: 3ds live webcam://0 --camera pepper-top
    """
    if robot is not None:
        require_robot(robot)
        if frames is not None:
            raise CallError("--frames would stop a robot half-way; leave out --frames or --robot")
    elif motion.move:
        raise CallError("--move allows a robot to turn; name it by --robot")
    require_film(out)
    panelled = not as_json and sys.stdout.isatty()
    pace = reading.pace
    if pace is None:
        pace = panelled and not any((out, log, bag, rerun))
    quiet_decoders()

    from doorway3ds.live.session import Session
    from doorway3ds.robots.loop import LoopParams
    from doorway3ds.robots.runlog import LOG

    line = None if log is None else log / LOG
    apart({"--out": out, "--bag": bag, "--rerun": recorded(rerun), "--log": line}, [source])
    with ExitStack() as stack:
        stack.enter_context(ended_by_sigterm())
        read_as = asdict(replace(reading, pace=pace))
        found = stack.enter_context(open_eyes(source, camera, **read_as))
        found.notice = complain  # before the session, which reads ahead at once
        pipeline = pipeline_for(found, decide)
        film = None
        if out is not None:
            film = Film(out, found.fps)
            stack.callback(film.close)
        keep: list[Callable[[Update, dict[str, Any]], None]] = []
        if bag is not None:
            from doorway3ds.ros.recorder import BagRecorder

            recorder = BagRecorder(bag)
            stack.callback(recorder.close)
            keep.append(lambda update, line: recorder.add(update.decision, line))
        viewer = stack.enter_context(viewer_of(rerun))
        if viewer is not None:
            show = viewer.add
            keep.append(lambda update, _: show(update.decision, belief=update.tracked.belief))
        driver = None
        if robot is not None:
            driver = stack.enter_context(driver_of(robot, found, motion))
        heading = _heading(None if driver is None or not driver.move else driver.robot)
        session = Session(found, pipeline, ahead=1 if found.live or pace else 2, heading=heading)
        watch = Watch(session, as_json, film)
        watch.keep = keep
        if log is not None and robot is None:
            record = stack.enter_context(logged(log, decide, pipeline, found))
            watch.log = stack.enter_context(_ending(record, watch))
        if panelled:
            from doorway3ds.cli.shared.panel import Panel

            named = [found.name, decide.method, pipeline.network.name]
            named += [] if robot is None else [f"robot {robot}"]
            watch.panel = stack.enter_context(Panel(" · ".join(named), found))
            found.notice = watch.panel.say
        stack.enter_context(session)
        if driver is None:
            watch.all(frames)
        else:
            params = LoopParams(aligned_deg=decide.aligned_deg, blocked_s=motion.blocked_s)
            with logged(log, decide, pipeline, found, driver) as record:
                report = _drive(watch, pipeline, driver, params, record)
    if driver is not None:
        _conclude(report, record.folder, as_json)
    if found.damaged and not found.live:
        raise typer.Exit(1)


def _drive(
    watch: Watch,
    pipeline: Pipeline,
    driver: Driver,
    params: LoopParams,
    log: RunLog,
) -> Report:
    """The closed loop of `3ds run`, fed by the watch, which goes on in a thread of its own.

    Signals reach the main thread, and so the loop, which stops the robot before anything else.
    """
    from doorway3ds.live.eyes import Relay
    from doorway3ds.robots.loop import TurnLoop
    from doorway3ds.sources import SourceLost

    relay = Relay(pipeline)
    watch.offer = relay.offer
    failed: list[UserError] = []
    tell, word = (watch.panel.say, str) if watch.panel else (say, reason_word)

    def watching() -> None:
        try:
            watch.all()
            relay.end()
        except BaseException as error:
            if isinstance(error, UserError) and not isinstance(error, SourceLost):
                failed.append(error)
            relay.end(error)

    watcher = Worker(watching, "watch", watch.session.stop)
    try:
        report = TurnLoop(relay, driver, params, log=log, tell=tell, word=word).run()
    finally:
        watcher.close(None)
    if failed:  # a film that cannot be written, say: the robot has been stopped by now
        raise failed[0]
    return report


def _heading(robot: Robot | None) -> Callable[[], float | None]:
    """The heading of a robot that may turn, asked for with every frame until it fails once."""
    from doorway3ds.robots.base import RobotError

    def ask() -> float | None:
        nonlocal robot
        try:
            return None if robot is None else robot.pose().heading_deg
        except RobotError:
            robot = None
            return None

    return ask


def _conclude(report: Report, folder: Path | None, as_json: bool) -> None:
    """How the robot ended, as text or as one more line of JSON, and as exit status."""
    if as_json:
        ended = {"outcome": str(report.outcome), "why": report.why, "looks": report.looks}
        print_json({**ended, "goes": report.goes, "searches": report.searches})
    else:
        sys.stdout.write(f"{outcome_words(report)}\n")
    say(f"log in {folder}")
    if report.outcome.status:
        raise typer.Exit(report.outcome.status)


@contextlib.contextmanager
def _ending(log: RunLog, watch: Watch) -> Iterator[RunLog]:
    """The log, whose last line says how the watch ended."""
    why = "interrupted"
    try:
        yield log
        why = watch.why
    except BaseException as error:
        why = str(error) or type(error).__name__
        raise
    finally:
        log.write("end", outcome="ended", why=why, **counts(watch.session.source))
