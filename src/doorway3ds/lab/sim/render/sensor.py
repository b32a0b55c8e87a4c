"""From an ideal rendering to what a camera delivers: lens, exposure, colour, noise."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera, grid_rays, pixel_to_ray

Rng = np.random.Generator


def pinhole_for(camera: Camera, limit: tuple[int, int] = (1024, 768)) -> Camera:
    """An undistorted camera of the same focal length that sees all that `camera` sees."""
    if camera.lens.plain:
        return camera
    w, h = camera.width, camera.height
    across, down = np.arange(-0.5, w, 1.0), np.arange(-0.5, h, 1.0)
    rim = np.concatenate(
        [np.stack([across, np.full_like(across, e)], -1) for e in (-0.5, h - 0.5)]
        + [np.stack([np.full_like(down, e), down], -1) for e in (-0.5, w - 0.5)]
    )
    rays = pixel_to_ray(camera, rim)[:, :2]
    low, high = rays.min(0), rays.max(0)
    f = np.array([camera.fx, camera.fy])
    size = np.ceil((high - low) * f).astype(int) + 3
    size = np.minimum(size, limit)
    centre = -low * f + 0.5
    width, height = map(int, size)
    cx, cy = map(float, centre)
    return Camera("pinhole", width, height, camera.fx, camera.fy, cx, cy)


def distort(
    camera: Camera, pinhole: Camera, rgb: NDArray[np.uint8], depth: NDArray[np.float32]
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """What `camera` sees, from a pinhole's image and depth.

    Depth is interpolated in 1 / depth (exact on planes), and taken from the nearest pixel where
    neighbours belong to different things.
    """
    if pinhole is camera:
        return rgb, depth
    rays = grid_rays(camera)
    x = (rays[..., 0] * pinhole.fx + pinhole.cx).astype(np.float32)
    y = (rays[..., 1] * pinhole.fy + pinhole.cy).astype(np.float32)
    picture = cv2.remap(rgb, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    inverse = np.where(np.isnan(depth), 0.0, 1.0 / depth).astype(np.float32)
    nearest = cv2.remap(inverse, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    smooth = cv2.remap(inverse, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    same = np.abs(smooth - nearest) < 0.02 * nearest
    out = np.where(same, smooth, nearest)
    with np.errstate(divide="ignore"):
        metres = np.where(out > 0, 1.0 / out, np.nan)
    return np.asarray(picture, np.uint8), metres.astype(np.float32)


def expose(rng: Rng, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Automatic exposure that misses a little, white balance, vignetting, blur and noise."""
    picture = (rgb.astype(np.float32) / 255.0) ** 2.0
    target = rng.uniform(0.16, 0.36)
    gain = float(np.clip(target / max(float(picture.mean()), 1e-3), 0.6, 9.0))
    picture *= gain * np.exp(rng.normal(0, 0.06, 3)).astype(np.float32)
    h, w = rgb.shape[:2]
    if rng.random() < 0.6:
        y, x = np.mgrid[-1 : 1 : h * 1j, -1 : 1 : w * 1j].astype(np.float32)
        picture *= (1 - rng.uniform(0.05, 0.35) * (x * x + y * y) / 2)[..., None]
    # A soft shoulder instead of hard clipping, as cameras have.
    picture = np.where(picture > 0.7, 0.7 + 0.3 * np.tanh((picture - 0.7) / 0.3), picture)
    picture = np.sqrt(np.clip(picture, 0, 1))
    if rng.random() < 0.35:
        picture = cv2.GaussianBlur(picture, (0, 0), float(rng.uniform(0.3, 1.0) * w / 320))
    if rng.random() < 0.08:
        length = int(rng.integers(3, 6) * w / 320)
        picture = cv2.blur(picture, (length, 1))
    noise = rng.uniform(0.002, 0.009) * np.sqrt(gain)
    grain = rng.standard_normal((h, w, 3), np.float32)
    if rng.random() < 0.5:  # demosaicking smears the grain
        grain = cv2.GaussianBlur(grain, (0, 0), 0.6) * 1.8
    picture = picture + noise * grain * (0.5 + np.sqrt(picture))
    contrast, colour = rng.uniform(0.9, 1.15), rng.uniform(0.75, 1.15)
    grey = picture.mean(-1, keepdims=True)
    picture = (grey + (picture - grey) * colour - 0.5) * contrast + 0.5
    return np.asarray(np.clip(picture, 0, 1) * 255 + 0.5, np.uint8)
