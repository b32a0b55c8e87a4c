"""Films that the other scripts make up, to measure on."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from doorway3ds.lab.benchmark import made_up_jpeg


def made_up_film(path: Path, fps: float = 30.0, seconds: float = 20.0) -> Path:
    """640x480 MPEG-4: a camera that pans over the image of `made_up_jpeg` and back."""
    data = np.frombuffer(made_up_jpeg(960, 480), np.uint8)
    wide = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, (640, 480))
    if not writer.isOpened():
        raise SystemExit(f"cannot write the film {path}")
    count = round(fps * seconds)
    for left in np.round(160 - 160 * np.cos(2 * np.pi * np.arange(count) / count)).astype(int):
        writer.write(np.ascontiguousarray(wide[:, left : left + 640]))
    writer.release()
    return path
