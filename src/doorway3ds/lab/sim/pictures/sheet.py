"""A contact sheet of a rendered data set: pictures with what the truth says marked on them."""

from __future__ import annotations

import json
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.images.codec import read_image, write_image
from doorway3ds.lab.evaluate.report.sheets import Tile, contact_sheet

GREEN, RED, YELLOW = (60, 220, 60), (240, 60, 60), (240, 210, 40)


def marked(picture: NDArray[np.uint8], truth: dict[str, Any]) -> Tile:
    """RGB picture with its openings: green = way free, red = blocked, yellow = cannot tell."""
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
    """contact.jpg with pictures spread evenly over the data set."""
    truths = [json.loads(line) for line in (folder / "truth.jsonl").read_text().splitlines()]
    step = max(1, len(truths) // count)
    tiles = [
        marked(read_image(folder / "images" / truth["image"]).image, truth)
        for truth in islice(truths, 0, step * count, step)
    ]
    return write_image(folder / "contact.jpg", contact_sheet(tiles, columns))
