"""A generated site: rooms with a bright opening in a dark wall, and the same walls without one."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

ROOMS = 16


def write_site(folder: Path, marked: bool = True, rooms: int = ROOMS, each: int = 4) -> Path:
    """Half of each room's pictures show the opening; marked in doorways.csv, or by folders."""
    rows = ["image,open,left_px,right_px,clear,confidence,second,state,place"]
    for room in range(rooms):
        rng = np.random.default_rng(room)
        wall = rng.integers(30, 90, 3)
        for number in range(each):
            is_open = number % 2 == 0
            image = np.clip(wall + rng.normal(0, 6, (120, 160, 3)), 0, 255).astype(np.uint8)
            image[90:] //= 2
            left = int(rng.integers(5, 85))
            right = left + int(rng.integers(50, 70))
            if is_open:
                image[20:105, left:right] = rng.integers(200, 250, 3)
            name = f"room{room:02d}/{number}.png"
            if not marked:
                name = f"{'open-door' if is_open else 'no-door'}/{name}"
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / name), image)
            span = f"{left - 0.5},{right - 0.5},1,3,0,open" if is_open else ",,,3,0,none"
            rows.append(f"{name},{int(is_open)},{span},room{room:02d}")
    if marked:
        (folder / "doorways.csv").write_text("\n".join(rows) + "\n")
    return folder
