"""NAOqi's colour spaces, written as the robot writes them.

http://doc.aldebaran.com/2-8/family/nao_technical/video_naov6.html
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

LAYERS = {
    0: 1, 1: 1, 2: 1, 3: 1, 4: 1, 5: 1, 6: 1, 7: 1, 8: 1, 9: 2, 10: 3, 11: 3, 12: 3, 13: 3, 14: 2,
    15: 3, 16: 3, 17: 2, 19: 12, 20: 1, 21: 2, 23: 2,
}  # fmt: skip
"""Bytes of a pixel. 0 to 2 are Y, U and V alone, 3 to 5 R, G, B, 6 to 8 H, S, Y; 9 is YUV422,
10 YUV, 11 RGB, 12 HSY, 13 BGR, 14 YYCbCr, 15 the hue in false colours, 16 hue, saturation and their
mean; 17 depth (mm), 19 XYZ (m, float), 20 infrared, 21 distance (mm), 23 raw depth (mm)."""
_DEPTHS = (17, 19, 20, 21, 23)


def suits(colour: int, depth: bool) -> bool:
    """Whether a camera has a colour space; depth: whether it is the depth camera."""
    return colour in LAYERS and (depth or colour not in _DEPTHS)


def encode(seen: NDArray[np.generic], colour: int, across_rad: float) -> NDArray[np.generic]:
    """An image (H, W, 3) of RGB, or depth (H, W) in metres, in a colour space.

    across_rad: field of view, for XYZ.
    """
    if seen.ndim == 2:
        depth = np.nan_to_num(np.asarray(seen, np.float32), nan=0.0)
        if colour in _DEPTHS:
            return _depth(depth, colour, across_rad)
        grey = np.clip(depth / 5.0 * 255, 0, 255).astype(np.uint8)
        seen = np.repeat(grey[..., None], 3, 2)
    return _colour(np.ascontiguousarray(seen, np.uint8), colour)


def _depth(depth: NDArray[np.float32], colour: int, across_rad: float) -> NDArray[np.generic]:
    height, width = depth.shape
    focal = width / 2 / math.tan(across_rad / 2)
    x = (np.arange(width) - (width - 1) / 2) / focal
    y = (np.arange(height) - (height - 1) / 2)[:, None] / focal
    if colour == 19:
        points = np.stack(np.broadcast_arrays(depth, -x * depth, -y * depth), -1)
        return points.astype(np.float32)
    if colour == 20:
        return np.clip(255 / np.maximum(depth, 1.0), 0, 255).astype(np.uint8)
    metres = depth * np.sqrt(1 + x**2 + y**2) if colour == 21 else depth
    return np.clip(metres * 1000, 0, 65535).astype("<u2")


def _colour(rgb: NDArray[np.uint8], colour: int) -> NDArray[np.generic]:
    if colour == 11:
        return rgb
    if colour == 13:
        return rgb[..., ::-1]
    if colour in (3, 4, 5):
        return rgb[..., colour - 3]
    if colour in (0, 1, 2, 10):
        yuv = cv2.cvtColor(rgb, cv2.COLOR_RGB2YUV)
        return yuv if colour == 10 else yuv[..., colour]
    if colour == 9:
        return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2YUV_YUY2))
    if colour == 14:
        yuy2 = cv2.cvtColor(rgb, cv2.COLOR_RGB2YUV_YUY2).reshape(*rgb.shape[:1], -1, 4)
        return np.ascontiguousarray(yuy2[..., [0, 2, 1, 3]])
    hsv = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV_FULL)
    hsy = np.dstack([hsv[..., :2], cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)])
    if colour == 12:
        return hsy
    if colour in (6, 7, 8):
        return hsy[..., colour - 6]
    if colour == 15:
        full = np.full_like(hsv[..., 0], 255)
        return np.asarray(cv2.cvtColor(np.dstack([hsv[..., 0], full, full]),
                                       cv2.COLOR_HSV2RGB_FULL))  # fmt: skip
    mean = hsv[..., :2].astype(np.uint16).mean(-1).astype(np.uint8)
    return np.dstack([hsv[..., :2], mean])
