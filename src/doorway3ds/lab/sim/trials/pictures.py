"""Images of the stages that trials are played on: what homes drawn at random seldom show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from doorway3ds.camera.model import Camera
from doorway3ds.lab.sim.homes.apartment import Home
from doorway3ds.lab.sim.homes.plan import Plan
from doorway3ds.lab.sim.pictures import views
from doorway3ds.lab.sim.pictures.dataset import (
    Job,
    Shot,
    good,
    largest,
    take,
    texels_a_metre,
)
from doorway3ds.lab.sim.render.renderer import Eye, Renderer
from doorway3ds.lab.sim.render.scene import build
from doorway3ds.lab.sim.robot.world import Studio, stage_of
from doorway3ds.lab.sim.stages.scenarios import SCENES, Stage

VIEWS = 8  # images of one stage
TRIES = 6
ANYWHERE = 0.25  # share of views that look anywhere in the room; the others near what it is about


@dataclass(frozen=True)
class StageJob(Job):
    """Images taken from where the robot stands on one stage: its own first look, and others with
    other cameras, heights and headings."""

    scene: str
    seed: int

    @property
    def key(self) -> list[int]:
        return [0x19E7, list(SCENES).index(self.scene), self.seed]

    def shots(self, context: Any) -> Iterator[tuple[Home, Shot]]:
        with Studio(self.size, plain=True) as studio:
            stage = stage_of(studio, self.scene, self.seed)
        scene = build(stage.home, texels_a_metre(self.size[0]), largest(self.size))
        renderer, plan = Renderer(scene, context), Plan(scene.furnished)
        rng = np.random.default_rng([0x57A6E, *self.key])
        try:
            for number in range(self.count):
                for _ in range(TRIES):
                    shot = take(renderer, plan, *self._view(stage, number, rng), rng)
                    if number == 0 or good(shot):
                        yield stage.home, shot
                        break
        finally:
            renderer.close()

    def _view(self, stage: Stage, number: int, rng: views.Rng) -> tuple[Camera, Eye]:
        camera = views.random_camera(rng, *self.size)
        if number == 0:
            return camera, stage.eye
        spread = 180 if rng.random() < ANYWHERE else 0.45 * camera.hfov_deg
        heading = stage.eye.heading_deg + stage.eye.pose.yaw_deg + rng.uniform(-spread, spread)
        pose = views.low_pose(rng) if rng.random() < self.low else views.random_pose(rng)
        return camera, replace(stage.eye, heading_deg=float(heading % 360), pose=pose)


def stage_jobs(
    out: Path, count: int, seed: int, size: tuple[int, int], scenes: Sequence[str], low: float = 0.0
) -> list[Job]:
    """`count` images of stages, VIEWS of each and the scenes in turn.

    Seeds of stages count from 100000 times `seed` on.
    """
    return [
        StageJob(
            out, at, min(VIEWS, count - at), size, low,
            scenes[k % len(scenes)], seed * 100_000 + k // len(scenes),
        )
        for k, at in enumerate(range(0, count, VIEWS))
    ]  # fmt: skip
