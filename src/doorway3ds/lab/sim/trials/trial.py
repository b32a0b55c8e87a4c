"""Episodes: a robot on a stage, a method, whether it ended where it should, and films of them.

The loop, the gate to motion and the methods are those of `3ds run`; only the body, its clock and
its camera are simulated.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera, wrapped_deg
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.files import write_bytes
from doorway3ds.lab.sim.pictures.truth import Truth, TruthNetwork
from doorway3ds.lab.sim.render.renderer import Eye
from doorway3ds.lab.sim.robot.body import FastClock
from doorway3ds.lab.sim.robot.world import SimRobot, Studio, World, stage_of
from doorway3ds.lab.sim.stages.scenarios import Stage
from doorway3ds.live.session import Session
from doorway3ds.networks.base import Network
from doorway3ds.robots.base import Driver, TurnResult
from doorway3ds.robots.loop import LoopParams, Outcome, TurnLoop
from doorway3ds.sources.base import Source
from doorway3ds.types import Decision, Frame

Method = Literal["opening", "paper"]
SIZE = (320, 240)
LOOK_S = 0.3  # simulated: exposure, transfer and network
FACES_DEG = 5.0
HOLD_MS, STEP_MS = 1100, 120  # of a film: at a decision, and between two
STEP_DEG, MOST_STEPS = 4.0, 2
COLOURS = 56


@dataclass(frozen=True)
class Episode:
    """One run. off_deg: from the nearest open doorway of the room at the end, None without one.

    wrong_turns: turns towards a doorway that led away from every one in the image.
    without_door, when_blocked: it turned towards something, or said it faced it, where it
    should not have.
    clear: whether the way to that doorway is free in the last image, by its truth.
    took_s: simulated time.
    """

    scene: str
    seed: int
    method: str
    network: str
    outcome: str
    why: str
    success: bool
    off_deg: float | None
    clear: bool | None
    wrong_turns: int
    without_door: bool
    when_blocked: bool
    goes: int
    turns: int
    looks: int
    took_s: float


class _Eyes(Source):
    """The camera of a world, with the truth of the last image at hand.

    A network needs the image; truth needs only depth, which is drawn in half the time.
    """

    live = True

    def __init__(self, world: World, clock: FastClock, images: bool) -> None:
        super().__init__("sim")
        self._world, self._clock, self._images = world, clock, images
        self._camera: Camera = world.body.camera(*SIZE)
        self.shown: Truth | None = None
        self.depth = np.zeros((0, 0), np.float32)

    def read(self, timeout_s: float | None = None) -> Frame:
        self._clock.sleep(LOOK_S / 2)
        stamp, eye = self._clock.now(), self._world.eye()
        if self._images:
            shot = self._world.shot(*SIZE)
            image, self.shown = shot.rgb, shot.truth
        else:
            image = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
            home = self._world.stage.home
            self.depth, self.shown = self._world.studio.truth(home, self._camera, eye)
        self._clock.sleep(LOOK_S / 2)
        return Frame(image, self._camera, eye.pose, stamp)

    def seen(self) -> tuple[Truth, NDArray[np.float32]] | None:
        """Truth and depth of the last image."""
        return None if self.shown is None else (self.shown, self.depth)

    def close(self) -> None:
        self.ended = True


class _Judge(SimRobot):
    """Turns as the simulated robot does, and knows whether that led away from every doorway."""

    def __init__(self, world: World, eyes: _Eyes) -> None:
        super().__init__(world)
        self._eyes = eyes
        self.away: list[bool] = []

    def turn(self, theta_deg: float, timeout_s: float) -> TurnResult:
        truth = self._eyes.shown
        bearings = [o.bearing_deg for o in truth.openings] if truth is not None else []
        was, now = (
            min((abs(b - turned) for b in bearings), default=180.0) for turned in (0.0, theta_deg)
        )
        self.away.append(not bearings or bool(now > was + 1 and now > FACES_DEG))
        return super().turn(theta_deg, timeout_s)


def play(
    studio: Studio,
    stage: Stage,
    method: Method,
    network: Network | None = None,
    params: LoopParams | None = None,
    watch: Callable[[Decision, World], None] = lambda decision, world: None,
) -> Episode:
    """Plays an episode. network: None for true perception."""
    clock = FastClock()
    world = World(studio, stage, clock=clock)
    eyes = _Eyes(world, clock, network is not None)
    robot = _Judge(world, eyes)
    pipeline = Pipeline(network or TruthNetwork(eyes.seen), method)
    goes: list[int] = []

    def note(line: str) -> None:
        if line.startswith("look") and "-> go" in line:
            goes.append(len(robot.away))

    driver = Driver(robot, move=True, clock=clock.now)
    report = TurnLoop(
        Session(eyes, pipeline, ahead=0, clock=clock.now, lens=False), driver, params,
        tell=note, decided=lambda decision: watch(decision, world),
        clock=clock.now, sleep=clock.sleep,
    ).run()  # fmt: skip
    wrong = sum(robot.away[k] for k in goes if k < len(robot.away))
    off, clear = _off(studio, world)
    went = bool(goes) or report.outcome is Outcome.ALIGNED
    return Episode(
        scene=stage.scene,
        seed=stage.seed,
        method=method,
        network=pipeline.network.name,
        outcome=str(report.outcome),
        why=report.why,
        success=bool(_succeeded(stage, report.outcome, off, bool(goes))),
        off_deg=off,
        clear=clear,
        wrong_turns=int(wrong),
        without_door="no_door" in stage.ends and went,
        when_blocked=stage.ends == ("blocked",) and went,
        goes=report.goes,
        turns=report.goes + report.searches,
        looks=report.looks,
        took_s=report.took_s,
    )


def _succeeded(stage: Stage, outcome: Outcome, off: float | None, went: bool) -> bool:
    if outcome is Outcome.ALIGNED:
        return "aligned" in stage.ends and off is not None and off <= FACES_DEG
    return str(outcome) in stage.ends and ("aligned" in stage.ends or not went)


def _bearings(stage: Stage, x: float, y: float) -> list[float]:
    """Plan bearings of the open doorways of the robot's room."""
    room = stage.home.room_at(x, y)
    out = []
    for portal in stage.home.portals_of(room.index) if room is not None else []:
        if portal.is_open:
            px, py = portal.point(sum(portal.free) / 2)
            out.append(float(np.degrees(np.arctan2(py - y, px - x))))
    return out


def _off(studio: Studio, world: World) -> tuple[float | None, bool | None]:
    """How far from facing the nearest doorway, by the exact image, else by the plan."""
    eye = world.eye()
    # The head may look aside; what the robot faces is judged straight ahead.
    ahead = replace(eye, pose=replace(eye.pose, yaw_deg=0.0, pitch_deg=0.0))
    truth = studio.truth(world.stage.home, world.body.camera(*SIZE), ahead)[1]
    if truth.openings:
        nearest = min(truth.openings, key=lambda o: abs(o.bearing_deg))
        return float(abs(nearest.bearing_deg)), nearest.clear
    bearings = _bearings(world.stage, eye.x, eye.y)
    return min((abs(wrapped_deg(b - eye.heading_deg)) for b in bearings), default=None), None


def film_scene(scene: str, seed: int, network: str | None, path: Path) -> Path:
    """Plays an episode with the `opening` method and writes it as a GIF.

    Decisions are held; between them the robot's turn is seen in a few steps.
    """
    from doorway3ds.draw import overlay

    loaded = None
    if network is not None:
        from doorway3ds.networks import load

        loaded = load(network, threads=1)
    frames: list[NDArray[np.uint8]] = []
    times: list[int] = []
    before: list[Eye] = []
    with Studio(SIZE) as studio:
        stage = stage_of(studio, scene, seed)

        def picture(camera: Camera, eye: Eye) -> NDArray[np.uint8]:
            return studio.shot(stage.home, camera, eye, None).rgb

        def watch(decision: Decision, world: World) -> None:
            camera, eye = world.body.camera(*SIZE), world.eye()
            if before:
                for between in _between(before[-1], eye):
                    frames.append(picture(camera, between))
                    times.append(STEP_MS)
            before.append(eye)
            if loaded is None:  # true perception decides without an image
                shown = replace(decision.frame, image=picture(camera, eye))
                decision = replace(decision, frame=shown)
            frames.append(overlay(decision))
            times.append(HOLD_MS)

        play(studio, stage, "opening", loaded, watch=watch)
    return _write(path, frames, times)


def _between(a: Eye, b: Eye) -> list[Eye]:
    turn = wrapped_deg(b.heading_deg - a.heading_deg)
    steps = min(int(abs(turn) / STEP_DEG), MOST_STEPS)
    return [
        Eye(b.x, b.y, a.heading_deg + turn * (k + 1) / (steps + 1), b.pose) for k in range(steps)
    ]


def _write(path: Path, frames: list[NDArray[np.uint8]], times: list[int]) -> Path:
    """One palette for all frames, and no dither: what stands still then costs nothing."""
    from PIL import Image

    some = frames[:: max(1, len(frames) // 8)]
    palette = Image.fromarray(np.concatenate(some)).quantize(COLOURS)
    plain = Image.Dither.NONE
    pages = [Image.fromarray(frame).quantize(palette=palette, dither=plain) for frame in frames]
    buffer = io.BytesIO()
    pages[0].save(
        buffer, format="GIF", save_all=True, append_images=pages[1:], duration=times, loop=0
    )
    write_bytes(path, buffer.getvalue())
    return path
