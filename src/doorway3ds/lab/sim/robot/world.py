"""A robot that stands in a simulated home: what its cameras see, as it turns.

Its camera is the source sim://home?seed=7&scenario=doorway&robot=nao&resolution=vga.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.closing import Closing
from doorway3ds.errors import CallError
from doorway3ds.lab.sim.homes.apartment import Home
from doorway3ds.lab.sim.homes.plan import Plan
from doorway3ds.lab.sim.pictures.dataset import Shot, exposed, largest, take, texels_a_metre
from doorway3ds.lab.sim.pictures.truth import Truth, TruthNetwork, truth_of
from doorway3ds.lab.sim.render.renderer import Eye, Renderer, open_context
from doorway3ds.lab.sim.render.scene import build
from doorway3ds.lab.sim.robot.body import Body, Clock, Gait
from doorway3ds.lab.sim.robot.ground import Ground
from doorway3ds.lab.sim.robot.model import MODELS
from doorway3ds.lab.sim.stages.scenarios import SCENES, Stage, find
from doorway3ds.robots.base import Robot, RobotPose, TurnEnd, TurnResult
from doorway3ds.robots.nao.format import FRAME_ROBOT
from doorway3ds.sources.address import query
from doorway3ds.sources.base import Source, View
from doorway3ds.types import Frame

T = TypeVar("T")
VIEWS_KEPT = 8
AIM_S = 0.5
SIZES = {"qvga": (320, 240), "vga": (640, 480)}


class Studio(Closing):
    """Draws homes, one at a time. OpenGL belongs to one thread, which is here; calls may come from
    any other.

    size: of the largest image. plain: coarse textures and no shadows, where only depth counts.
    The last views of a home are kept: a robot that stands still sees the same again, and drawing
    is most of an episode's work.
    """

    def __init__(self, size: tuple[int, int] = (640, 480), plain: bool = False) -> None:
        self._size, self._plain = size, plain
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="renderer")
        self._renderer: Renderer | None = None
        self._plan: Plan | None = None
        self._home: Home | None = None
        self._kept: dict[Any, Any] = {}
        try:
            self._context: Any = self._do(open_context)
        except BaseException:
            self._thread.shutdown()
            raise

    def shot(self, home: Home, camera: Camera, eye: Eye, rng: np.random.Generator | None) -> Shot:
        """The image and truth; rng: of the sensor's errors, None = an ideal one."""

        def draw() -> Shot:
            renderer, plan = self._enter(home)
            return take(renderer, plan, camera, eye, None)

        return exposed(self._do(lambda: self._once(home, ("shot", camera, eye), draw)), rng)

    def truth(self, home: Home, camera: Camera, eye: Eye) -> tuple[NDArray[np.float32], Truth]:
        """Depth and truth alone, in half the time."""

        def draw() -> tuple[NDArray[np.float32], Truth]:
            renderer, plan = self._enter(home)
            depth = renderer.draw(camera, eye, shadows=False)[1]
            return depth, truth_of(plan, camera, eye, depth)

        return self._do(lambda: self._once(home, ("truth", camera, eye), draw))

    def plan(self, home: Home) -> Plan:
        """What stands where in a home."""
        return self._do(lambda: self._enter(home)[1])

    def close(self) -> None:
        if self._context is None:
            return
        context, self._context = self._context, None

        def free() -> None:
            if self._renderer is not None:
                self._renderer.close()
            context.free()

        with contextlib.suppress(RuntimeError):
            self._do(free)
        self._thread.shutdown()

    def _do(self, work: Callable[[], T]) -> T:
        return self._thread.submit(work).result()

    def _once(self, home: Home, view: Any, draw: Callable[[], T]) -> T:
        """What `draw` gives, or gave for the same view of the same home."""
        if self._home != home:
            self._kept.clear()
        if view not in self._kept:
            fresh = draw()
            while len(self._kept) >= VIEWS_KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[view] = fresh
        found: T = self._kept[view]
        return found

    def _enter(self, home: Home) -> tuple[Renderer, Plan]:
        if self._renderer is None or self._plan is None or self._home != home:
            if self._renderer is not None:
                self._renderer.close()
                self._renderer = None
            ppm = 16.0 if self._plain else texels_a_metre(self._size[0])
            scene = build(home, ppm, largest(self._size))
            self._renderer = Renderer(scene, self._context)
            self._plan, self._home = Plan(scene.furnished), home
        return self._renderer, self._plan


class World:
    """A body on a stage.

    noise: whether the camera's sensor errs. clock: real by default; a FastClock makes turns cost
    nothing but simulated time.
    """

    def __init__(
        self,
        studio: Studio,
        stage: Stage,
        *,
        model: str = "nao",
        noise: bool = True,
        clock: Clock | None = None,
        gait: Gait | None = None,
    ) -> None:
        rng = np.random.default_rng([0x40B0, stage.seed])
        self.studio, self.stage = studio, stage
        self.body = Body(
            stage.eye.x, stage.eye.y, stage.eye.heading_deg,
            model=MODELS[model], clock=clock, rng=rng, gait=gait,
            ground=Ground(lambda: studio.plan(stage.home)),
        )  # fmt: skip
        self._sensor = np.random.default_rng([0x5E45, stage.seed]) if noise else None
        self.reset_head()
        self.last: Shot | None = None
        self._kept: tuple[Any, NDArray[np.uint8]] | None = None

    @classmethod
    def of_scene(cls, studio: Studio, scene: str, seed: int, *, model: str = "nao", **options: Any
                 ) -> World:  # fmt: skip
        """The world of a scene's seed."""
        return cls(studio, stage_of(studio, scene, seed, model), model=model, **options)

    def reset_head(self) -> None:
        """As the stage has it; at once."""
        for joint, angle in zip(("HeadYaw", "HeadPitch"), self.stage.head, strict=True):
            self.body.aim(joint, angle, 1e9)

    def eye(self, part: str = "CameraTop") -> Eye:
        x, y, heading = self.body.place()
        return Eye(x, y, heading % 360, self.pose(part))

    def pose(self, part: str = "CameraTop") -> Pose:
        return Pose.from_transform(self.body.transform(part, FRAME_ROBOT))

    def shot(self, width: int, height: int, part: str = "CameraTop") -> Shot:
        """What the camera sees now."""
        camera = self.body.camera(width, height)
        self.last = self.studio.shot(self.stage.home, camera, self.eye(part), self._sensor)
        return self.last

    def depth(self, part: str, width: int, height: int) -> NDArray[np.float32]:
        """For a virtual Pepper's depth camera: (H, W) metres, nan where there is nothing."""
        camera = self.body.camera(width, height, part)
        return self.studio.truth(self.stage.home, camera, self.eye(part))[0]

    def picture(self, part: str, width: int, height: int) -> NDArray[np.uint8]:
        """For a virtual NAO's ALVideoDevice."""
        # A robot that stands still sees the same: drawing takes longer than a camera does.
        seen = (part, width, height, self.eye(part))
        if self._kept is None or self._kept[0] != seen:
            scale = min(1.0, 640 / width)
            small = self.shot(int(width * scale), int(height * scale), part).rgb
            if scale < 1.0:
                import cv2

                small = np.asarray(cv2.resize(small, (width, height)), np.uint8)
            self._kept = (seen, small)
        return self._kept[1]


class SimRobot(Robot):
    """The body of a world as a robot, without NAOqi in between and without a voice."""

    name = "sim"

    def __init__(self, world: World) -> None:
        self._body, stage = world.body, world.stage
        self.name = f"sim://home?seed={stage.seed}&scenario={stage.scene}"

    def prepare(self) -> None:
        self._body.go("StandInit", 0.0)
        self._body.awake = True

    def turn(self, theta_deg: float, timeout_s: float) -> TurnResult:
        clock = self._body.clock
        start, before = clock.now(), self._body.odometry()[2]
        number = self._body.begin(0.0, 0.0, math.radians(theta_deg))
        try:
            arrived = self._body.wait(number)
        finally:
            self._body.stop()
        turned = self._body.odometry()[2] - before
        end = TurnEnd.DONE if arrived else TurnEnd.STOPPED
        return TurnResult(theta_deg, turned, end, clock.now() - start)

    def aim(self, yaw_deg: float, pitch_deg: float) -> tuple[float, float] | None:
        body = self._body
        before = body.angle("HeadYaw"), body.angle("HeadPitch")
        body.aim("HeadYaw", math.radians(yaw_deg), 1e9)
        body.aim("HeadPitch", -math.radians(pitch_deg), 1e9)
        body.clock.sleep(AIM_S)
        return math.degrees(before[0]), -math.degrees(before[1])

    def stop(self) -> None:
        self._body.stop()

    def pose(self) -> RobotPose:
        return RobotPose(*self._body.odometry())

    close = stop


def stage_of(studio: Studio, scene: str, seed: int, model: str = "nao") -> Stage:
    """The stage of a scene's seed, verified by images of this studio."""
    body = Body(model=MODELS[model])

    def pose(yaw: float, pitch: float) -> Pose:
        body.aim("HeadYaw", yaw, 1e12)
        body.aim("HeadPitch", pitch, 1e12)
        return Pose.from_transform(body.transform("CameraTop", FRAME_ROBOT))

    camera = body.camera(320, 240)
    return find(scene, seed, camera, pose, lambda home, eye: studio.truth(home, camera, eye)[1])


def open_uri(uri: str, view: View, **options: Any) -> Source:
    """The source of a sim:// URI; see `doorway3ds.sources.open_source`."""
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
