"""`densedepth`: the paper's depth network (Alhashim & Wonka, arXiv 1812.11941).

The file takes "image", float32 (1, 480, 640, 3) or (1, 3, 480, 640), RGB 0..1 (that is, / 255),
and returns "depth", 240x320 with any axes of length 1: the raw output, 10 m / depth.
It becomes metres, clipped to 0.1 .. 10; a raw value of 0 or less, beyond any distance, is 10 m.
The whole image is squeezed into 640x480. As published, the camera's focal length is not used.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.networks.adapter import Answer, OnnxNetwork, squeeze
from doorway3ds.networks.base import DEPTH
from doorway3ds.types import Perception

WIDTH, HEIGHT = 640, 480
MAP = (240, 320)
NEAREST_M, FARTHEST_M = 0.1, 10.0
PUBLISHED_ERROR = 0.123  # mean absolute relative error on NYU, the authors' Table 1


class DenseDepth(OnnxNetwork):
    """The depth network from an ONNX file of the signature above."""

    default_name = "densedepth"
    gives = frozenset({DEPTH})
    shapes = ((1, HEIGHT, WIDTH, 3), (1, 3, HEIGHT, WIDTH))
    outputs = ("depth",)

    def prepare(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        tensor = squeeze(image, WIDTH, HEIGHT, channels_last=self.channels_last)
        tensor /= np.float32(255)
        return tensor

    def read(self, answer: Answer, camera: Camera, width: int, height: int) -> Perception:
        raw = answer["depth"]
        if tuple(n for n in raw.shape if n != 1) != MAP:
            raise self.session.misfit("depth", "of 240x320 values", raw.shape)
        depth = FARTHEST_M / np.clip(raw.reshape(MAP), 1.0, FARTHEST_M / NEAREST_M)
        return Perception(
            math.nan, depth_m=np.asarray(depth, np.float32), depth_error=self._depth_error()
        )

    def _depth_error(self) -> float:
        """The file's own, if its training wrote one."""
        try:
            return float(self.own_metadata()["depth_error"])
        except (KeyError, ValueError, TypeError):
            return PUBLISHED_ERROR
