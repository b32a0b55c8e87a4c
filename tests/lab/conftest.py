"""Marked data sets in miniature, written here."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.factories import HEADER, write_picture


@pytest.fixture
def nyu(tmp_path: Path) -> Path:
    """Three pictures of two places: a doorway with a further one, one doorway, none."""
    root = tmp_path / "nyu"
    for number in (2, 3, 45):
        write_picture(root / "images" / f"{number:04d}.jpg", 640, 480)
        depth = np.full((480, 640), 51, np.uint8)
        depth[:, 300:400] = 255
        labels = np.zeros((480, 640), np.uint8)
        labels[:, :100] = 7
        for folder, picture in (("depth", depth), ("labels", labels)):
            (root / folder).mkdir(exist_ok=True)
            cv2.imwrite(str(root / folder / f"{number:04d}.png"), picture)
    rows = [
        HEADER,
        "0002.jpg,1,300,400,1,3,0",
        "0002.jpg,1,10.0,60.5,0,1,1",
        "0003.jpg,1,500,630,,2,0",
        "0045.jpg,0,,,,3,0",
    ]
    (root / "doorways.csv").write_text("\n".join(rows) + "\n")
    return root
