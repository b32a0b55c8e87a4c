"""The base of every network that is an ONNX file: opened and checked, fed, timed."""

from __future__ import annotations

import json
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.networks.session import Session, Shape
from doorway3ds.types import Perception

_BATCH = 16  # images a run on a GPU

Answer = Mapping[str, NDArray[np.float32]]
"""A file's outputs by name."""


class OnnxNetwork(ABC):
    """A network from an ONNX file of the signature that its class states.

    default_name: what it is called unless told otherwise. gives: see `base.Network`. shapes,
    outputs, optional: see `Session`.

    Raises UserError if the file is missing, damaged or of another signature.
    """

    default_name: ClassVar[str]
    gives: frozenset[str]
    shapes: ClassVar[Sequence[Shape]]
    outputs: ClassVar[tuple[str, ...]]
    optional: ClassVar[tuple[str, ...]] = ()

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        name: str | None = None,
        sha256: str | None = None,
        threads: int | None = None,
        providers: Sequence[str] | None = None,
    ) -> None:
        self.name = name or self.default_name
        self.session = Session(
            path,
            self.shapes,
            self.outputs,
            self.optional,
            sha256=sha256,
            threads=threads,
            providers=providers,
        )

    def __call__(self, image: NDArray[np.uint8], camera: Camera) -> Perception:
        return self.together([(image, camera)])[0]

    def together(self, pictures: Sequence[tuple[NDArray[np.uint8], Camera]]) -> list[Perception]:
        """What is seen in several images, each with its camera: inputs of one size in one run."""
        start = time.perf_counter()
        inputs = [self.prepare(image) for image, _ in pictures]
        prepared = (time.perf_counter() - start) / len(pictures)
        alike: dict[tuple[int, ...], list[int]] = {}
        for index, tensor in enumerate(inputs):
            alike.setdefault(tensor.shape, []).append(index)
        seen: dict[int, Perception] = {}
        for indices in alike.values():
            start = time.perf_counter()
            answers = self.session.run(np.concatenate([inputs[index] for index in indices]))
            found = []
            for row, index in enumerate(indices):
                image, camera = pictures[index]
                answer = answers
                if len(indices) > 1:
                    answer = {name: values[row : row + 1] for name, values in answers.items()}
                found.append(self.read(answer, camera, image.shape[1], image.shape[0]))
            spent = (time.perf_counter() - start) / len(indices)
            timings = {"prepare": prepared * 1e3, "network": spent * 1e3}
            for index, perception in zip(indices, found, strict=True):
                seen[index] = replace(perception, network=self.name, timings_ms=timings)
        return [seen[index] for index in range(len(pictures))]

    @property
    def batch(self) -> int:
        """Images that are seen fastest in one run: one on a CPU, and if the file takes no more."""
        return _BATCH if self.session.takes_many and not self.session.on_cpu else 1

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}>"

    @abstractmethod
    def prepare(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        """The file's input for (H, W, 3) uint8 RGB."""

    @abstractmethod
    def read(self, answer: Answer, camera: Camera, width: int, height: int) -> Perception:
        """What the outputs mean for an image of width x height pixels taken by `camera`."""

    def own_metadata(self) -> Any:
        """What the file says of itself, read as JSON; None if that cannot be read."""
        try:
            return json.loads(self.session.metadata.get("doorway3ds", ""))
        except ValueError:
            return None

    @property
    def channels_last(self) -> bool:
        """Whether the input is (1, h, w, 3) rather than (1, 3, h, w)."""
        return self.session.layout[-1] == 3


def resized(image: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """The whole image (H, W, 3) at another size, averaged over areas if it becomes smaller."""
    shrinks = width * height < image.shape[0] * image.shape[1]
    method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, (width, height), interpolation=method), np.uint8)


def squeeze(
    image: NDArray[np.uint8], width: int, height: int, *, channels_last: bool
) -> NDArray[np.float32]:
    """The whole image as (1, height, width, 3) or (1, 3, height, width) float32 0..255."""
    small = np.asarray(resized(image, width, height), np.float32)[None]
    return small if channels_last else np.ascontiguousarray(small.transpose(0, 3, 1, 2))
