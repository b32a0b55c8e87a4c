"""Simulated homes as a camera: sim://home?seed=7&scenario=doorway&robot=nao&resolution=vga."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import CallError
from doorway3ds.lab.sim.pictures.perceive import TruthNetwork
from doorway3ds.sources.address import query
from doorway3ds.sources.base import Source, View
from doorway3ds.types import Frame

if TYPE_CHECKING:
    from doorway3ds.lab.sim.pictures.truth import Truth
    from doorway3ds.lab.sim.robot.world import World

SIZES = {"qvga": (320, 240), "vga": (640, 480)}


def open_uri(uri: str, view: View, **options: Any) -> Source:
    """The source of a sim:// URI; see `doorway3ds.sources.open_source`."""
    from doorway3ds.lab.sim.robot.world import Studio, World
    from doorway3ds.lab.sim.stages.scenarios import SCENES

    parts, given = query(uri, {"seed": int, "scenario": str, "robot": str, "resolution": str})
    if parts.netloc != "home" or parts.path not in ("", "/"):
        raise CallError(f"expected sim://home?seed=7&scenario=doorway, got {uri}")
    scene = given.get("scenario", "doorway")
    robot, resolution = given.get("robot", "nao"), given.get("resolution", "vga")
    for name, value, known in (
        ("scenario", scene, tuple(SCENES)),
        ("robot", robot, ("nao", "pepper")),
        ("resolution", resolution, tuple(SIZES)),
    ):
        if value not in known:
            raise CallError(f"{uri}: {name} must be one of {', '.join(known)}, got {value!r}")
    seed = given.get("seed", 0)
    if seed < 0:
        raise CallError(f"{uri}: seed must be 0 or more, got {seed}")
    studio = Studio(SIZES[resolution])
    try:
        return SimSource(uri, World.of_scene(studio, scene, seed, model=robot), view, resolution)
    except BaseException:
        studio.close()
        raise


class SimSource(Source):
    """What a simulated robot sees; `world` is where it stands, for a robot to turn in."""

    live = True

    def __init__(self, name: str, world: World, view: View, resolution: str = "vga") -> None:
        super().__init__(name)
        self.world, self._view = world, view
        self.truth = TruthNetwork(self._seen)
        self._size = SIZES[resolution]

    def read(self, timeout_s: float | None = None) -> Frame | None:
        if self.ended:
            return None
        stamp_s, place = time.monotonic(), self.world.eye()
        shot = self.world.shot(*self._size)
        if self.world.eye() == place:
            stamp_s = time.monotonic()  # drawing takes time that an exposure does not
        return self._view.frame(shot.rgb, stamp_s, camera=shot.camera, pose=shot.eye.pose)

    def _seen(self) -> tuple[Truth, NDArray[np.float32]] | None:
        shot = self.world.last
        return None if shot is None else (shot.truth, shot.depth)

    def close(self) -> None:
        if not self.ended:
            self.ended = True
            self.world.studio.close()
