"""`doornet`: one forward pass gives p_open, opening columns, depth in metres and floor.

The file (ONNX, metadata JSON under "doorway3ds") takes "image", float32 (1, 3, h, w) RGB 0..255,
h and w open multiples of 32, and gives
- "p_open" (1,): logit that an open doorway is in the image, temperature scaling included;
- "score", "left", "right" (1, N): for each of N equal strips of columns the logit that it looks
  through an open doorway, and the distances from the strip's centre to that doorway's left and
  right edge as fractions of w;
- "clear" (1, N), in newer files: logit that the way to the opening in that strip is free;
- "depth" (1, h', w'): metres for a camera whose focal length is `canonical_f_px` pixels of the
  network's input; another camera's are longer in proportion to its focal length;
- "floor" (1, h', w'): logit that the pixel shows floor.
Metadata: `canonical_f_px`, `depth_error` (relative standard deviation), and if it has them
`thresholds`, limits of the `opening` method chosen with this network, `presets`, further operating
points by name (each an object of `open_from`, the gate's limit, and `limits`), and `costs` (see
`doorway3ds.networks.costs`), by which its p_open is weighed.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.networks.adapter import Answer, OnnxNetwork, resized
from doorway3ds.networks.base import COLUMNS, DEPTH, FLOOR, P_OPEN
from doorway3ds.networks.costs import Costs, weigh
from doorway3ds.networks.limits import override
from doorway3ds.types import ColumnVotes, Perception

PIXELS = 192 * 256
MULTIPLE = 32
MAX_ASPECT = 2.0  # wider or taller images are padded: training saw nothing longer


@dataclass(frozen=True)
class Placement:
    """Where an image lies on the network's input of `height` x `width` pixels."""

    width: int
    height: int
    left: int
    top: int
    content_width: int
    content_height: int


def place(width: int, height: int, pixels: int = PIXELS, multiple: int = MULTIPLE) -> Placement:
    """The input for an image of width x height: about `pixels`, of its aspect, sides multiples.

    4:3 becomes 256x192, 16:9 288x160. Beyond 1:2 and 2:1 the image keeps its aspect and lies
    in the middle.
    """
    aspect = width / height
    held = min(max(aspect, 1 / MAX_ASPECT), MAX_ASPECT)
    net_width, net_height = (
        max(1, round(side / multiple)) * multiple
        for side in (math.sqrt(pixels * held), math.sqrt(pixels / held))
    )
    content_width = max(1, round(net_width * min(1.0, aspect / held)))
    content_height = max(1, round(net_height * min(1.0, held / aspect)))
    return Placement(
        net_width,
        net_height,
        (net_width - content_width) // 2,
        (net_height - content_height) // 2,
        content_width,
        content_height,
    )


def prepare(image: NDArray[np.uint8], at: Placement) -> NDArray[np.float32]:
    """(H, W, 3) uint8 RGB to (1, 3, h, w) float32 0..255, edges repeated into the padding."""
    height, width = image.shape[:2]
    size = (at.content_width, at.content_height)
    if (width, height) != size:
        image = resized(image, *size)
    if size != (at.width, at.height):
        right = at.width - at.left - at.content_width
        bottom = at.height - at.top - at.content_height
        image = np.pad(image, ((at.top, bottom), (at.left, right), (0, 0)), mode="edge")
    return np.ascontiguousarray(image.transpose(2, 0, 1)[None], np.float32)


class DoorNet(OnnxNetwork):
    """The packaged network, or another file of its signature."""

    default_name = "doornet"
    gives = frozenset({P_OPEN, COLUMNS, DEPTH, FLOOR})
    shapes = ((1, 3, None, None),)
    outputs = ("p_open", "score", "left", "right", "depth", "floor")
    optional = ("clear",)

    def __init__(self, path: str | os.PathLike[str], **options: Any) -> None:
        super().__init__(path, **options)
        self.metadata = self._read_metadata()
        self.thresholds: Mapping[str, Any] = self.metadata.get("thresholds") or {}
        self.presets: Mapping[str, Any] = self.metadata.get("presets") or {}
        self._costs = override(Costs(), self.metadata.get("costs") or {})
        self._canonical_f_px = float(self.metadata["canonical_f_px"])
        self._depth_error = float(self.metadata["depth_error"])
        bearing_error = self.metadata.get("bearing_error_deg")
        self._bearing_error = None if bearing_error is None else float(bearing_error)

    def _read_metadata(self) -> Mapping[str, Any]:
        metadata = self.own_metadata()
        try:
            if metadata["canonical_f_px"] > 0 and metadata["depth_error"] >= 0:
                return dict(metadata)
        except (TypeError, KeyError):
            pass
        expected = "in its metadata as JSON with canonical_f_px > 0 and depth_error >= 0"
        text = self.session.metadata.get("doorway3ds", "")
        raise self.session.misfit("doorway3ds", expected, repr(text[:80]))

    def prepare(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        return prepare(image, place(image.shape[1], image.shape[0]))

    def read(self, answer: Answer, camera: Camera, width: int, height: int) -> Perception:
        at = place(width, height)
        # Depth is as far as the focal length is long, both in pixels of this input.
        focal = camera.fx * at.content_width / width
        depth = self._map(answer, "depth", at) * np.float32(focal / self._canonical_f_px)
        depth = np.where(depth > 0, depth, np.float32(np.nan))
        return Perception(
            p_open=weigh(float(_sigmoid(answer["p_open"].reshape(-1)[0])), depth, self._costs),
            columns=self._columns(answer, at, width),
            depth_m=depth,
            floor=_sigmoid(self._map(answer, "floor", at)),
            depth_error=self._depth_error,
            bearing_error_deg=self._bearing_error,
        )

    def _columns(self, answer: Answer, at: Placement, width: int) -> ColumnVotes:
        names = [key for key in ("score", "left", "right", "clear") if key in answer]
        shapes = {answer[key].shape for key in names}
        shape = next(iter(shapes))
        if len(shapes) != 1 or len(shape) != 2 or shape[0] != 1:
            raise self.session.misfit(", ".join(names), "of one shape (1, N)", shapes)
        count = shape[1]
        # The image's own strips, each answered by the input's strip under its centre:
        # the same strips but for padded images.
        centre = at.left + (np.arange(count) + 0.5) / count * at.content_width
        strip = np.minimum((centre / at.width * count).astype(int), count - 1)
        voted = (strip + 0.5) / count * at.width

        def to_picture(edge: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
            columns = (edge - at.left) / at.content_width * width - 0.5
            return np.clip(columns, -0.5, width - 0.5)

        return ColumnVotes(
            score=_sigmoid(answer["score"][0, strip]),
            left_px=to_picture(voted - answer["left"][0, strip] * at.width),
            right_px=to_picture(voted + answer["right"][0, strip] * at.width),
            clear=_sigmoid(answer["clear"][0, strip]) if "clear" in answer else None,
        )

    def _map(self, answer: Answer, key: str, at: Placement) -> NDArray[np.float32]:
        """One (h', w') map without its padding."""
        value = answer[key]
        if value.ndim != 3 or value.shape[0] != 1:
            raise self.session.misfit(key, "of shape (1, h, w)", value.shape)
        rows = _crop(value.shape[1], at.height, at.top, at.content_height)
        columns = _crop(value.shape[2], at.width, at.left, at.content_width)
        return value[0, rows, columns]


def _crop(count: int, total: int, start: int, length: int) -> slice:
    """The part of `count` cells over `total` pixels that covers start .. start + length."""
    first = min(round(start * count / total), count - 1)
    return slice(first, max(first + 1, round((start + length) * count / total)))


def _sigmoid(logits: Any) -> NDArray[np.float32]:
    # By tanh it neither overflows nor loses the small end to rounding that matters here.
    value: NDArray[np.float32] = np.asarray(
        0.5 * (1.0 + np.tanh(0.5 * np.asarray(logits, np.float64))), np.float32
    )
    return value
