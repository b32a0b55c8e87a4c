"""`3ds live`: decisions with memory on a camera, a stream, a video or a robot's eyes."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doorway3ds.cli.shared.camera import CameraOptions, require_range
from doorway3ds.cli.shared.options import (
    Camera,
    FovDeg,
    HeightM,
    MaxUnseenM,
    Method,
    Network,
    PitchDeg,
    RollDeg,
    Threads,
    WidthM,
)
from doorway3ds.cli.shared.robot import (
    MOVE_HELP,
    ROBOT_HELP,
    logged,
    pipeline_for,
    require_robot,
    robot_of,
)
from doorway3ds.cli.shared.signals import ended_by_sigterm
from doorway3ds.cli.shared.watch import Watch, counts, print_json
from doorway3ds.errors import CallError, UserError
from doorway3ds.images.film import Film, require_film

if TYPE_CHECKING:
    from doorway3ds.cli.shared.camera import CameraChoice
    from doorway3ds.decide.pipeline import Pipeline
    from doorway3ds.robots.base import Driver, Robot
    from doorway3ds.robots.loop import Report
    from doorway3ds.robots.runlog import RunLog
    from doorway3ds.sources import Source
    from doorway3ds.types import Decision, Frame


def live(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="webcam://0, rtsp://..., http://... (MJPEG), a video, a folder, 'pattern*.jpg', "
            "- (images on standard input), sim://... or nao://...",
        ),
    ],
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON object per frame and line.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Annotated film: .mp4, .mkv, .avi, .webm.")
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Every picture and decision, for `3ds replay`."),
    ] = None,
    robot: Annotated[
        str | None, typer.Option(metavar="ROBOT", help=f"Who turns: {ROBOT_HELP}")
    ] = None,
    move: Annotated[bool, typer.Option("--move", help=MOVE_HELP)] = False,
    method: Method = "opening",
    network: Network = "doornet",
    camera: Camera = None,
    fov_deg: FovDeg = None,
    height_m: HeightM = None,
    pitch_deg: PitchDeg = None,
    roll_deg: RollDeg = None,
    width_m: WidthM = None,
    max_unseen_m: MaxUnseenM = None,
    pace: Annotated[
        bool | None,
        typer.Option(
            "--pace/--no-pace",
            help="Videos and folders in their own time, frames skipped as if live; default: only "
            "where a panel shows them and nothing is written.",
        ),
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Begin a file again at its end.")] = False,
    fps: Annotated[
        float | None, typer.Option(help="Of a folder's images and of standard input.")
    ] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="End after so many.")] = None,
    patience_s: Annotated[
        float, typer.Option(help="End when a camera or stream stays away for so long.")
    ] = 60.0,
    threads: Threads = None,
) -> None:
    """Decide on every frame, with memory between frames, until the source ends or Ctrl-C.

    In a terminal a panel shows the decision; elsewhere a line is printed when it changes.
    With --robot it ends as `3ds run` does, by the robot's doing; the decisions are shown meanwhile.
    Exit status: 0 the source ended, 1 it was lost or held pictures that could not be read,
    2 wrong call, 130 ended by Ctrl-C; with --robot that of `3ds run`.
    """
    if robot is not None:
        require_robot(robot)
        if frames is not None:
            raise CallError("--frames would stop a robot half-way; leave it out, or --robot")
    elif move:
        raise CallError("--move allows a robot to turn; name it by --robot")
    require_film(out)
    require_range("--fps", fps, 0.001, 1000)
    require_range("--patience-s", patience_s, 0, 1e6)
    choice = CameraOptions(camera, fov_deg, height_m, pitch_deg, roll_deg).resolve()
    panelled = not as_json and sys.stdout.isatty()
    if pace is None:
        pace = panelled and out is None and record is None
    # libav writes warnings of its own for every hiccup of a stream.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

    import cv2

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    with ExitStack() as stack:
        stack.enter_context(ended_by_sigterm())
        given = {"pace": pace, "loop": loop, "fps": fps, "patience_s": patience_s}
        found = stack.enter_context(_open(source, choice, camera, fov_deg, given))
        pipeline = pipeline_for(found, method, network, width_m, max_unseen_m, threads)
        watch = Watch(pipeline, found, as_json, prefetch=not (found.live or pace))
        if out is not None:
            film = Film(out, found.fps)
            stack.callback(film.close)
            watch.film = film
        if record is not None and robot is None:
            watch.log = stack.enter_context(_recording(record, pipeline, found, watch))
        driver = None if robot is None else stack.enter_context(_driver(robot, found, move))
        if panelled:
            from doorway3ds.cli.shared.panel import Panel

            named = [found.name, method, pipeline.network.name]
            named += [] if robot is None else [f"robot {robot}"]
            watch.panel = stack.enter_context(Panel(" · ".join(named), found))
        found.notice = watch.panel.say if watch.panel else _complain
        if driver is None:
            watch.all(frames)
        else:
            tell = watch.panel.say if watch.panel else _tell
            report, folder = _drive(watch, pipeline, found, driver, record, tell)
    if driver is not None:
        _conclude(report, folder, as_json)
    if found.damaged and not found.live:
        raise typer.Exit(1)


@contextlib.contextmanager
def _driver(name: str, source: Source, move: bool) -> Iterator[Driver]:
    from doorway3ds.robots.base import Driver, Limits

    limits = Limits()
    with robot_of(name, source, limits) as legs:
        yield Driver(legs, move=move, limits=limits)


def _drive(
    watch: Watch,
    pipeline: Pipeline,
    source: Source,
    driver: Driver,
    folder: Path | None,
    tell: Callable[[str], None],
) -> tuple[Report, Path | None]:
    """The closed loop of `3ds run`, fed by the watch, which goes on in a thread of its own.

    Signals reach the main thread, and so the loop, which stops the robot before anything else.
    """
    from doorway3ds.robots.loop import Loop
    from doorway3ds.robots.relay import Relay
    from doorway3ds.sources import SourceLost

    relay = Relay(pipeline.params, pipeline.gates)
    watch.decided = relay.offer
    if driver.move:
        watch.heading = _heading(driver.robot)
    failed: list[UserError] = []

    def check(frame: Frame, decision: Decision) -> bool | None:
        return pipeline.check_way(frame, decision, relay.perception(frame))

    looks_down = check if pipeline.method == "opening" else None

    def watching() -> None:
        try:
            watch.all()
            relay.end()
        except BaseException as error:
            if isinstance(error, UserError) and not isinstance(error, SourceLost):
                failed.append(error)
            relay.end(error)

    with logged(folder, pipeline, source, driver) as log:
        thread = threading.Thread(target=watching, name="watch", daemon=True)
        thread.start()
        try:
            loop = Loop(relay, relay.decide, driver, check=looks_down, log=log, tell=tell)
            report = loop.run()
        finally:
            watch.stop()
            thread.join()
    if failed:  # a film that cannot be written, say: the robot has been stopped by now
        raise failed[0]
    return report, log.folder


def _heading(robot: Robot) -> Callable[[], float | None]:
    """The robot's heading, asked for with every frame until it fails once."""
    from doorway3ds.robots.base import RobotError

    gone = False

    def ask() -> float | None:
        nonlocal gone
        if gone:
            return None
        try:
            return robot.pose().heading_deg
        except RobotError:
            gone = True
            return None

    return ask


def _conclude(report: Report, folder: Path | None, as_json: bool) -> None:
    """How the robot ended, as text or as one more line of JSON, and as exit status."""
    if as_json:
        ended = {"outcome": str(report.outcome), "why": report.why, "looks": report.looks}
        print_json({**ended, "goes": report.goes, "searches": report.searches})
    else:
        sys.stdout.write(f"{report.outcome}: {report.why}\n")
    _tell(f"log in {folder}")
    if report.outcome.status:
        raise typer.Exit(report.outcome.status)


def _open(
    uri: str,
    choice: CameraChoice,
    camera: str | None,
    fov_deg: float | None,
    options: dict[str, Any],
) -> Source:
    """The source; what the user says of the camera outranks what the source knows."""
    from doorway3ds.camera.model import Pose
    from doorway3ds.sources import open_source

    return open_source(
        uri,
        camera=choice.fit if camera is not None or fov_deg is not None else None,
        pose=None if choice.pose == Pose() else choice.pose,
        **options,
    )


@contextlib.contextmanager
def _recording(folder: Path, pipeline: Pipeline, source: Source, watch: Watch) -> Iterator[RunLog]:
    """A log that also says how it ended."""
    from dataclasses import asdict

    from doorway3ds import __version__
    from doorway3ds.robots.runlog import RunLog

    with RunLog(folder) as log:
        log.write(
            "start", version=__version__, method=pipeline.method, network=pipeline.network.name,
            gates=asdict(pipeline.gates), params=pipeline.params and asdict(pipeline.params),
            source=source.name, robot=None,
        )  # fmt: skip
        why = "interrupted"
        try:
            yield log
            why = watch.why
        except BaseException as error:
            why = str(error) or type(error).__name__
            raise
        finally:
            log.write("end", outcome="ended", why=why, **counts(source))


def _complain(message: str) -> None:
    sys.stderr.write(f"3ds: {message}\n")
    sys.stderr.flush()


def _tell(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()
