"""A short film of one episode: what the robot sees, and what it says about it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera import Camera
from doorway3ds.errors import UserError
from doorway3ds.sim.render import Eye
from doorway3ds.sim.trial import play
from doorway3ds.sim.world import Studio, World, stage_of
from doorway3ds.types import Decision

WIDTH, HEIGHT = 320, 240
HOLD_MS, STEP_MS = 1100, 90
STEP_DEG = 4.0


def film_scene(scene: str, seed: int, network: str | None, path: Path) -> Path:
    """Plays an episode with the `opening` method and writes it as a GIF.

    Decisions are held; between them the robot's turn is seen in steps of 4 deg.
    """
    from doorway3ds.draw import overlay

    loaded = None
    if network is not None:
        from doorway3ds.networks import load

        loaded = load(network, threads=1)
    frames: list[NDArray[np.uint8]] = []
    times: list[int] = []
    before: list[Eye] = []
    with Studio((WIDTH, HEIGHT)) as studio:
        stage = stage_of(studio, scene, seed)

        def picture(camera: Camera, eye: Eye) -> NDArray[np.uint8]:
            return studio.shot(stage.home, camera, eye, None).rgb

        def watch(decision: Decision, world: World) -> None:
            camera, eye = world.body.camera(WIDTH, HEIGHT), world.eye()
            if before:
                for between in _between(before[-1], eye):
                    frames.append(picture(camera, between))
                    times.append(STEP_MS)
            before.append(eye)
            if loaded is None:  # true perception decides without a picture
                shown = replace(decision.frame, image=picture(camera, eye))
                decision = replace(decision, frame=shown)
            frames.append(overlay(decision))
            times.append(HOLD_MS)

        play(studio, stage, "opening", loaded, watch=watch)
    return _write(path, frames, times)


def _between(a: Eye, b: Eye) -> list[Eye]:
    turn = (b.heading_deg - a.heading_deg + 180) % 360 - 180
    steps = int(abs(turn) / STEP_DEG)
    return [
        Eye(b.x, b.y, a.heading_deg + turn * (k + 1) / (steps + 1), b.pose) for k in range(steps)
    ]


def _write(path: Path, frames: list[NDArray[np.uint8]], times: list[int]) -> Path:
    animation = cv2.Animation()
    animation.frames = [cv2.cvtColor(frame, cv2.COLOR_RGB2BGR) for frame in frames]
    animation.durations = times
    animation.loop_count = 0
    path.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwriteanimation(str(path), animation):
        raise UserError(f"cannot write {path}")
    return path
