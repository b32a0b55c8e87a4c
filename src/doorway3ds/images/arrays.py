"""Images of other libraries as this one takes them: (H, W, 3) uint8 RGB."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from doorway3ds.arguments import require_image


def from_bgr(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An image as OpenCV reads it, in RGB.

    >>> blue = np.zeros((2, 2, 3), np.uint8)
    >>> blue[..., 0] = 255  # OpenCV puts blue first
    >>> from_bgr(blue)[0, 0].tolist()
    [0, 0, 255]

    Args:
        image: uint8, (H, W, 3) BGR, (H, W, 4) BGRA, whose alpha is dropped, or (H, W) grey.

    Returns:
        (H, W, 3) uint8 RGB, in memory of its own.

    Raises:
        UserError: for an array of another shape or type.
    """
    require_image("image", image, depths=(3, 4, None))
    if image.ndim == 2:
        return np.repeat(image[..., None], 3, axis=2)
    return np.ascontiguousarray(image[..., 2::-1])
