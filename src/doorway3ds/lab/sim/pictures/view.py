"""One picture of one home from a stated place: examples, tests, a look around."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from doorway3ds.camera.model import Camera
from doorway3ds.lab.sim.homes import apartment as homes
from doorway3ds.lab.sim.homes.plan import Plan
from doorway3ds.lab.sim.pictures.dataset import (
    Shot,
    largest,
    take,
    texels_a_metre,
    truth_object,
    write_shot,
)
from doorway3ds.lab.sim.render.renderer import Eye, Renderer, open_context
from doorway3ds.lab.sim.render.scene import build


def photograph(home: int, camera: Camera, eye: Eye, noise: int | None = 0) -> Shot:
    """The picture and truth of a home's seed; noise: seed of the sensor's errors, None = ideal."""
    size = (camera.width, camera.height)
    context = open_context()
    try:
        scene = build(homes.generate(home), texels_a_metre(camera.width), largest(size))
        renderer = Renderer(scene, context)
        rng = None if noise is None else np.random.default_rng([0x707, home, noise])
        try:
            return take(renderer, Plan(scene.furnished), camera, eye, rng)
        finally:
            renderer.close()
    finally:
        context.free()


def save(shot: Shot, home: int, path: Path) -> list[Path]:
    """Picture at `path`; NAME.json, NAME.depth.png (mm) and NAME.floor.png in truth/ beside it,
    where `3ds look` of the folder does not take them for pictures."""
    folder = path.parent / "truth"
    folder.mkdir(parents=True, exist_ok=True)
    truth, depth, floor = (
        folder / (path.stem + end) for end in (".json", ".depth.png", ".floor.png")
    )
    write_shot(shot, path, depth, floor, 93, effort=9)
    truth.write_text(json.dumps(truth_object(shot, path.name, home), indent=1) + "\n")
    return [path, truth, depth, floor]
