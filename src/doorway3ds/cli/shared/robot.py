"""The robot of `3ds run` and `3ds live`: its eyes, who turns, and how a run is logged."""

from __future__ import annotations

import contextlib
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from doorway3ds.cli.shared.output import linked, say
from doorway3ds.errors import CallError
from doorway3ds.types import Reason

if TYPE_CHECKING:
    from doorway3ds.camera.options import CameraOptions
    from doorway3ds.decide.options import DecideOptions
    from doorway3ds.decide.pipeline import Pipeline
    from doorway3ds.robots.base import Driver, Robot
    from doorway3ds.robots.loop import Report
    from doorway3ds.robots.options import MotionOptions
    from doorway3ds.robots.runlog import RunLog
    from doorway3ds.sources import Source

ROBOT_HELP = "Robot to turn: nao://HOST[:PORT], sim (of a sim:// source), or dry."
RunFolder = Annotated[
    Path | None,
    typer.Option(
        "--log", "--record", metavar="DIR",
        help="Folder for images and decisions, read by `3ds replay`; default of a robot's run: "
        "3ds-run-DATE-TIME.",
    ),
]  # fmt: skip


def reason_word(reason: Reason) -> str:
    """A look's reason on standard error, with a link to its page."""
    return linked(reason, reason, sys.stderr)


def outcome_words(report: Report) -> str:
    """How a run ended and why; an outcome that is a reason links to its page."""
    name = str(report.outcome)
    with contextlib.suppress(ValueError):  # halted and dry are no reasons
        name = linked(name, Reason(name), sys.stdout)
    return f"{name}: {report.why}"


def require_robot(name: str) -> None:
    """CallError for what names no robot."""
    if name not in ("dry", "sim") and not name.startswith("nao://"):
        raise CallError(f"--robot must be nao://HOST[:PORT], sim or dry, got {name!r}")


def open_eyes(uri: str, camera: CameraOptions, **options: Any) -> Source:
    """The source of a URI; what the user says of the camera outranks what the source knows."""
    from doorway3ds.camera.choice import choose_camera
    from doorway3ds.sources import open_source

    choice = choose_camera(camera)
    fit = choice.fit if choice.given else None
    return open_source(uri, camera=fit, pose=choice.pose_of, **options)


def pipeline_for(source: Source, options: DecideOptions) -> Pipeline:
    """`build_pipeline`; for `--network truth` with the source's network that makes no mistakes."""
    from doorway3ds.decide.pipeline import build_pipeline

    if options.network != "truth":
        return build_pipeline(options)
    if source.truth is None:
        raise CallError(f"--network truth needs a sim:// source, got {source.name}")
    if options.mirror:
        raise CallError("--mirror averages a network's errors, and --network truth makes none")
    return build_pipeline(options, source.truth)


@contextlib.contextmanager
def driver_of(name: str, source: Source, motion: MotionOptions) -> Iterator[Driver]:
    """The gate to the robot that `--robot` names; the robot is let go at the end."""
    from doorway3ds.robots.base import Driver, DryRobot

    require_robot(name)
    limits = motion.limits()
    legs: Robot
    if name == "dry":
        legs = DryRobot()
    elif name == "sim":
        from doorway3ds.lab.sim.robot.world import SimRobot, SimSource

        if not isinstance(source, SimSource):
            raise CallError("--robot sim needs a sim:// source, whose robot it is")
        legs = SimRobot(source.world)
    else:
        from doorway3ds.robots.nao.robot import NaoRobot

        legs = NaoRobot(name, limits, tell=say)
    try:
        yield Driver(legs, move=motion.move, limits=limits)
    finally:
        legs.close()


@contextlib.contextmanager
def logged(
    folder: Path | None,
    options: DecideOptions,
    pipeline: Pipeline,
    source: Source,
    driver: Driver | None = None,
) -> Iterator[RunLog]:
    """The log of a run, begun with all that `3ds replay` needs; default 3ds-run-DATE-TIME."""
    from doorway3ds import __version__
    from doorway3ds.robots.runlog import RunLog

    folder = folder or Path(time.strftime("3ds-run-%Y%m%d-%H%M%S"))
    with RunLog(folder, perception=options.network == "truth") as log:
        log.write(
            "start", version=__version__, options=asdict(options), network=pipeline.network.name,
            gates=asdict(pipeline.gates), params=pipeline.params and asdict(pipeline.params),
            limits=driver and asdict(driver.limits), source=source.name,
            robot=driver and driver.robot.name, move=driver is not None and driver.move,
        )  # fmt: skip
        yield log


@contextlib.contextmanager
def ended_by_sigterm() -> Iterator[None]:
    """SIGTERM, too, raises KeyboardInterrupt, so that whatever is open is stopped and closed."""

    def stop(_: int, __: FrameType | None) -> None:
        raise KeyboardInterrupt

    try:
        before = signal.signal(signal.SIGTERM, stop)
    except ValueError:  # not the main thread, which alone may say so
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
