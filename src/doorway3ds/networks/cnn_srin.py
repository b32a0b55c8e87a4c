"""`cnn-srin`: the paper's classifier (VGG16 features, pooled, dense 1024, logistic unit).

The file takes "image", float32 (1, 224, 224, 3) or (1, 3, 224, 224), RGB 0..255, holds its own
preprocessing (Keras' VGG16: BGR minus the ImageNet means), and gives "p_open", (1,) or (1, 1):
the probability, after the logistic unit, that the picture shows an open doorway.
The whole picture is squeezed into the square, as in training.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.networks.base import P_OPEN
from doorway3ds.networks.session import Session
from doorway3ds.types import Perception

SIDE = 224


class CnnSrin:
    """The classifier from an ONNX file of the signature above.

    Raises UserError where the file is missing, damaged or of another signature.
    """

    gives: ClassVar[frozenset[str]] = frozenset({P_OPEN})
    outputs: ClassVar[tuple[str, ...]] = ("p_open",)

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        name: str = "cnn-srin",
        sha256: str | None = None,
        threads: int | None = None,
        providers: Sequence[str] | None = None,
    ) -> None:
        self.name = name
        self.session = Session(
            path,
            [(1, SIDE, SIDE, 3), (1, 3, SIDE, SIDE)],
            self.outputs,
            sha256=sha256,
            threads=threads,
            providers=providers,
        )

    def __call__(self, image: NDArray[np.uint8], camera: Camera) -> Perception:
        start = time.perf_counter()
        tensor = squeeze(image, SIDE, SIDE, channels_last=self.session.layout[-1] == 3)
        prepared = time.perf_counter()
        answer = self.session.run(tensor)["p_open"]
        if answer.size != 1 or not 0.0 <= (p_open := float(answer.reshape(-1)[0])) <= 1.0:
            raise self.session.misfit("p_open", "to be one probability", answer.reshape(-1)[:4])
        return Perception(
            p_open=p_open,
            network=self.name,
            timings_ms={
                "prepare": (prepared - start) * 1e3,
                "network": (time.perf_counter() - prepared) * 1e3,
            },
        )


def squeeze(
    image: NDArray[np.uint8], width: int, height: int, *, channels_last: bool
) -> NDArray[np.float32]:
    """The whole picture as (1, height, width, 3) or (1, 3, height, width) float32 0..255."""
    shrinks = width * height < image.shape[0] * image.shape[1]
    method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    small = np.asarray(cv2.resize(image, (width, height), interpolation=method), np.float32)[None]
    return small if channels_last else np.ascontiguousarray(small.transpose(0, 3, 1, 2))
