"""`densedepth`: the paper's depth network (Alhashim & Wonka, arXiv 1812.11941).

The file takes "image", float32 (1, 480, 640, 3) or (1, 3, 480, 640), RGB 0..1 (that is, / 255),
and gives "depth", 240x320 with any axes of length 1: the raw output, 10 m / depth.
It becomes metres, clipped to 0.1 .. 10; a raw value of 0 or less, beyond any distance, is 10 m.
The whole picture is squeezed into 640x480. As published, the camera's focal length is not used.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.networks.base import DEPTH
from doorway3ds.networks.cnn_srin import squeeze
from doorway3ds.networks.session import Session
from doorway3ds.types import Perception

WIDTH, HEIGHT = 640, 480
MAP = (240, 320)
NEAREST_M, FARTHEST_M = 0.1, 10.0
PUBLISHED_ERROR = 0.123  # mean absolute relative error on NYU, the authors' Table 1


class DenseDepth:
    """The depth network from an ONNX file of the signature above.

    Raises UserError where the file is missing, damaged or of another signature.
    """

    gives: ClassVar[frozenset[str]] = frozenset({DEPTH})
    outputs: ClassVar[tuple[str, ...]] = ("depth",)

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        name: str = "densedepth",
        sha256: str | None = None,
        threads: int | None = None,
        providers: Sequence[str] | None = None,
    ) -> None:
        self.name = name
        self.session = Session(
            path,
            [(1, HEIGHT, WIDTH, 3), (1, 3, HEIGHT, WIDTH)],
            self.outputs,
            sha256=sha256,
            threads=threads,
            providers=providers,
        )
        self._depth_error = _measured_error(self.session)

    def __call__(self, image: NDArray[np.uint8], camera: Camera) -> Perception:
        start = time.perf_counter()
        tensor = squeeze(image, WIDTH, HEIGHT, channels_last=self.session.layout[-1] == 3)
        tensor /= np.float32(255)
        prepared = time.perf_counter()
        raw = self.session.run(tensor)["depth"]
        if tuple(n for n in raw.shape if n != 1) != MAP:
            raise self.session.misfit("depth", "of 240x320 values", raw.shape)
        depth = FARTHEST_M / np.clip(raw.reshape(MAP), 1.0, FARTHEST_M / NEAREST_M)
        return Perception(
            p_open=float("nan"),
            depth_m=np.asarray(depth, np.float32),
            depth_error=self._depth_error,
            network=self.name,
            timings_ms={
                "prepare": (prepared - start) * 1e3,
                "network": (time.perf_counter() - prepared) * 1e3,
            },
        )


def _measured_error(session: Session) -> float:
    """`depth_error` from the file's own metadata, where its training wrote one."""
    try:
        return float(json.loads(session.metadata["doorway3ds"])["depth_error"])
    except (KeyError, ValueError, TypeError):
        return PUBLISHED_ERROR
