"""One image of one home from a stated place: examples, tests, a look around."""

from __future__ import annotations

import json
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.images.codec import read_image, write_image
from doorway3ds.lab.evaluate.report.sheets import Tile, contact_sheet
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
    """The image and truth of a home's seed; noise: seed of the sensor's errors, None = ideal."""
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
    """Image at `path`; NAME.json, NAME.depth.png (mm) and NAME.floor.png in truth/ beside it,
    where `3ds look` of the folder does not take them for images."""
    folder = path.parent / "truth"
    folder.mkdir(parents=True, exist_ok=True)
    truth, depth, floor = (
        folder / (path.stem + end) for end in (".json", ".depth.png", ".floor.png")
    )
    write_shot(shot, path, depth, floor, 93, effort=9)
    truth.write_text(json.dumps(truth_object(shot, path.name, home), indent=1) + "\n")
    return [path, truth, depth, floor]


GREEN, RED, YELLOW = (60, 220, 60), (240, 60, 60), (240, 210, 40)


def marked(picture: NDArray[np.uint8], truth: dict[str, Any]) -> Tile:
    """RGB image with its openings: green = way free, red = blocked, yellow = cannot tell."""
    out = picture.copy()
    row = picture.shape[0] // 2
    for o in truth["openings"]:
        colour = YELLOW if o["clear"] is None else GREEN if o["clear"] else RED
        left, right = round(o["left_px"]), round(o["right_px"])
        cv2.line(out, (left, row), (right, row), colour, 1, cv2.LINE_AA)
        for x in (left, right):
            cv2.line(out, (x, row - 8), (x, row + 8), colour, 2)
    names = [f"{o['state']} {o['range_m']:.1f} m" for o in truth["openings"]]
    return Tile(out, ", ".join(names or truth["in_view"][:3] or ["nothing"]))


def write_contact_sheet(folder: Path, count: int = 48, columns: int = 6) -> Path:
    """contact.jpg with images spread evenly over the data set."""
    truths = [json.loads(line) for line in (folder / "truth.jsonl").read_text().splitlines()]
    step = max(1, len(truths) // count)
    tiles = [
        marked(read_image(folder / "images" / truth["image"]).image, truth)
        for truth in islice(truths, 0, step * count, step)
    ]
    return write_image(folder / "contact.jpg", contact_sheet(tiles, columns))
