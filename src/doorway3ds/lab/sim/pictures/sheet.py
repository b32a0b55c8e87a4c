"""A contact sheet of a rendered data set: pictures with what the truth says marked on them."""

from __future__ import annotations

import json
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

GREEN, RED, YELLOW, WHITE = (60, 220, 60), (60, 60, 240), (40, 210, 240), (255, 255, 255)


def marked(picture: NDArray[np.uint8], truth: dict[str, Any]) -> NDArray[np.uint8]:
    """BGR picture with its openings: green = way free, red = blocked, yellow = cannot tell."""
    out = picture.copy()
    row = picture.shape[0] // 2
    for o in truth["openings"]:
        colour = YELLOW if o["clear"] is None else GREEN if o["clear"] else RED
        left, right = round(o["left_px"]), round(o["right_px"])
        cv2.line(out, (left, row), (right, row), colour, 1, cv2.LINE_AA)
        for x in (left, right):
            cv2.line(out, (x, row - 8), (x, row + 8), colour, 2)
    names = [f"{o['state']} {o['range_m']:.1f} m" for o in truth["openings"]]
    text = ", ".join(names or truth["in_view"][:3] or ["nothing"])
    cv2.putText(out, text, (5, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(out, text, (5, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.42, WHITE, 1, cv2.LINE_AA)
    return np.asarray(out, np.uint8)


def write_contact_sheet(folder: Path, count: int = 48, columns: int = 6) -> Path:
    """contact.jpg with pictures spread evenly over the data set."""
    lines = (folder / "truth.jsonl").read_text().splitlines()
    step = max(1, len(lines) // count)
    cells = []
    for line in islice(lines, 0, step * count, step):
        truth = json.loads(line)
        picture = cv2.imread(str(folder / "images" / truth["image"]))
        cells.append(cv2.resize(marked(np.asarray(picture, np.uint8), truth), (320, 240)))
    while len(cells) % columns:
        cells.append(np.zeros_like(cells[0]))
    rows = [np.hstack(cells[i : i + columns]) for i in range(0, len(cells), columns)]
    path = folder / "contact.jpg"
    cv2.imwrite(str(path), np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 88])
    return path
