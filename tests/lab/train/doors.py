"""Made-up pictures of doorways and rooms with depth, for tests of training."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np


def room(
    rng: np.random.Generator, *, is_open: bool, width: int = 96, height: int = 72
) -> np.ndarray:
    """(H, W, 3) uint8 RGB: blurred colours, and a bright door where it is open."""
    coarse = rng.integers(20, 180, (6, 8, 3), dtype=np.uint8)
    image = np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC))
    if is_open:
        left = int(rng.integers(width // 8, width // 2))
        image[height // 6 :, left : left + width // 4] = 250
    return image


def save(path: Path, image: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image[..., ::-1] if image.ndim == 3 else image)
    return path


def classes(folder: Path, count: int, seed: int = 0) -> Path:
    """`count` pictures in each of no-door/ and open-door/."""
    rng = np.random.default_rng(seed)
    for index in range(count):
        for name, is_open in (("no-door", False), ("open-door", True)):
            save(folder / name / f"{index:02d}.png", room(rng, is_open=is_open))
    return folder


def depth_pairs(folder: Path, count: int, scale: float = 1000.0, seed: int = 0) -> Path:
    """images/ and depth/ with 16-bit depth of 1 to 4 m, `scale` counts per metre."""
    rng = np.random.default_rng(seed)
    for index in range(count):
        image = room(rng, is_open=index % 2 == 0)
        depth = np.linspace(1, 4, image.shape[1])[None] * np.ones((image.shape[0], 1)) * scale
        save(folder / "images" / f"{index:02d}.png", image)
        save(folder / "depth" / f"{index:02d}.png", np.round(depth).astype(np.uint16))
    return folder
