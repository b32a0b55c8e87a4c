"""The robot of `3ds run` and `3ds live`: who turns, what perceives for it, how a run is logged."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from doorway3ds.cli.shared.pipeline import build_pipeline
from doorway3ds.errors import CallError

if TYPE_CHECKING:
    from doorway3ds.decide.pipeline import Pipeline
    from doorway3ds.robots.base import Driver, Limits, Robot
    from doorway3ds.robots.runlog import RunLog
    from doorway3ds.sources import Source

ROBOT_HELP = "nao://HOST[:PORT], sim (the robot of a sim:// source), or dry."
MOVE_HELP = "Allow motion. Without it nothing moves."


def require_robot(name: str) -> None:
    """CallError for what names no robot."""
    if name not in ("dry", "sim") and not name.startswith("nao://"):
        raise CallError(f"--robot must be nao://HOST[:PORT], sim or dry, got {name!r}")


def pipeline_for(
    source: Source,
    method: str,
    network: str,
    width_m: float | None,
    max_unseen_m: float | None,
    threads: int | None,
) -> Pipeline:
    """`build_pipeline`; for `--network truth` one that makes no mistakes about a sim:// source."""
    if network != "truth":
        return build_pipeline(method, network, width_m, max_unseen_m, threads)

    from doorway3ds.decide.gates import Gates
    from doorway3ds.decide.pipeline import Pipeline
    from doorway3ds.lab.sim.robot.source import TruthNetwork

    if method not in ("opening", "paper"):
        raise CallError(f"--method must be opening or paper, got {method!r}")
    return Pipeline(
        TruthNetwork(source),
        method="paper" if method == "paper" else "opening",
        gates=Gates(max_unseen_m=max_unseen_m),
    )


@contextlib.contextmanager
def robot_of(name: str, source: Source, limits: Limits) -> Iterator[Robot]:
    """The robot that `--robot` names, let go at the end; CallError for another name."""
    from doorway3ds.robots.base import DryRobot

    require_robot(name)
    legs: Robot
    if name == "dry":
        legs = DryRobot()
    elif name == "sim":
        from doorway3ds.lab.sim.robot.source import SimSource
        from doorway3ds.lab.sim.robot.world import SimRobot

        if not isinstance(source, SimSource):
            raise CallError("--robot sim needs a sim:// source, whose robot it is")
        legs = SimRobot(source.world)
    else:
        from doorway3ds.robots.nao.robot import NaoRobot

        legs = NaoRobot(name, limits, tell=_tell)
    try:
        yield legs
    finally:
        legs.close()


def _tell(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


@contextlib.contextmanager
def logged(
    folder: Path | None, pipeline: Pipeline, source: Source, driver: Driver
) -> Iterator[RunLog]:
    """The log of a run, begun; folder: default 3ds-run-DATE-TIME."""
    from doorway3ds import __version__
    from doorway3ds.robots.runlog import RunLog

    folder = folder or Path(time.strftime("3ds-run-%Y%m%d-%H%M%S"))
    with RunLog(folder, perception=pipeline.network.name == "truth") as log:
        log.write(
            "start", version=__version__, method=pipeline.method, network=pipeline.network.name,
            gates=asdict(pipeline.gates), params=pipeline.params and asdict(pipeline.params),
            limits=asdict(driver.limits), source=source.name, robot=driver.robot.name,
            move=driver.move,
        )  # fmt: skip
        yield log
