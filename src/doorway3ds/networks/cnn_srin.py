"""`cnn-srin`: the paper's classifier (VGG16 features, pooled, dense 1024, logistic unit).

The file takes "image", float32 (1, 224, 224, 3) or (1, 3, 224, 224), RGB 0..255, holds its own
preprocessing (Keras' VGG16: BGR minus the ImageNet means), and returns "p_open", (1,) or (1, 1):
the probability, after the logistic unit, that the image shows an open doorway.
The whole image is squeezed into the square, as in training.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.networks.adapter import Answer, OnnxNetwork, squeeze
from doorway3ds.networks.base import P_OPEN
from doorway3ds.types import Perception

SIDE = 224


class CnnSrin(OnnxNetwork):
    """The classifier from an ONNX file of the signature above."""

    default_name = "cnn-srin"
    gives = frozenset({P_OPEN})
    shapes = ((1, SIDE, SIDE, 3), (1, 3, SIDE, SIDE))
    outputs = ("p_open",)

    def prepare(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        return squeeze(image, SIDE, SIDE, channels_last=self.channels_last)

    def read(self, answer: Answer, camera: Camera, width: int, height: int) -> Perception:
        values = answer["p_open"].reshape(-1)
        if values.size != 1 or not 0.0 <= (p_open := float(values[0])) <= 1.0:
            raise self.session.misfit("p_open", "to be one probability", values[:4])
        return Perception(p_open)
