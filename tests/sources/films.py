"""Small video files whose frames say their own number."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

STEP = 4


def film(
    path: Path, count: int = 30, fps: float = 20.0, fourcc: str = "MJPG", width: int = 64
) -> Path:
    """Grey frames, STEP levels brighter each time; `number` reads them back."""
    size = (width, width * 3 // 4)
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*fourcc), fps, size, []
    )
    assert writer.isOpened()
    for index in range(count):
        writer.write(np.full((size[1], size[0], 3), index * STEP % 256, np.uint8))
    writer.release()
    return path


def number(image: NDArray[np.uint8]) -> int:
    return round(float(image.mean()) / STEP)
