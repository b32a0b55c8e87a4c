"""Any ONNX depth network, by a spec that says how it is fed and what its numbers mean.

The file takes one float32 image, (1, 3, h, w) or (1, h, w, 3), and gives a depth map that covers
the whole image at any size. The image is squeezed into the input.

Metres follow the focal length: what a network has learnt of size and distance holds for the focal
length of its training, in pixels of its input; through a longer lens the same image shows things
farther away, in proportion.
"""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.errors import UserError
from doorway3ds.networks.adapter import Answer, OnnxNetwork, squeeze
from doorway3ds.networks.base import DEPTH, RELATIVE
from doorway3ds.networks.depth.spec import INVERSE, METRES, RELATIVE_INVERSE, DepthSpec
from doorway3ds.networks.session import Session, Shape, Signature, signature, verify
from doorway3ds.types import Perception, RelativeDepth

# Median depth of an image from a room or a street: beyond, the unit is another.
PLAUSIBLE_M = (0.02, 60.0)


class DepthFile(OnnxNetwork):
    """A depth network from an ONNX file and its spec, which the file must fit."""

    def __init__(
        self,
        path: str | os.PathLike[str],
        spec: DepthSpec,
        *,
        name: str | None = None,
        sha256: str | None = None,
        threads: int | None = None,
    ) -> None:
        path = Path(path)
        self.name = name or path.stem
        self.gives = frozenset({RELATIVE if spec.relative else DEPTH})
        verify(path, sha256)
        seen = signature(path)
        self.spec, shape = _fit(spec, seen, path)
        self.session = Session(
            path,
            [shape],
            [_only("output", spec.output, seen.outputs, path)],
            input_name=_only("input", spec.input, tuple(seen.inputs), path),
            spare=True,
            threads=threads,
        )
        self._plausible = spec.relative

    def prepare(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        spec = self.spec
        size = spec.size_for(image.shape[1], image.shape[0])
        if spec.channels == "bgr":
            image = image[..., ::-1]
        # By channel value = a * pixel + b, a and b worked out before any pixel is touched.
        mean, std = (np.array(v, np.float32) for v in (spec.mean, spec.std))
        if spec.channels == "bgr":
            mean, std = mean[::-1], std[::-1]
        tensor = squeeze(np.ascontiguousarray(image), *size, channels_last=True)
        tensor *= np.float32(spec.white / 255) / std
        tensor -= mean / std
        if spec.layout == "nhwc":
            return tensor
        return np.ascontiguousarray(tensor.transpose(0, 3, 1, 2))

    def read(self, answer: Answer, camera: Camera, width: int, height: int) -> Perception:
        (raw,) = answer.values()
        shape = tuple(n for n in raw.shape if n != 1)
        if len(shape) != 2:
            raise self.session.misfit(self.session.outputs[0], "to be one map", raw.shape)
        value = raw.reshape(shape) * np.float32(self.spec.factor)
        seen = Perception(math.nan, depth_error=self.spec.depth_error)
        if self.spec.relative:
            shifted = self.spec.unit == RELATIVE_INVERSE
            inverse = value if shifted else _inverse(value)
            return replace(seen, relative=RelativeDepth(inverse, shifted))
        size = self.spec.size_for(width, height)
        return replace(seen, depth_m=self._metres(value, camera, size))

    def _metres(
        self, value: NDArray[np.float32], camera: Camera, size: tuple[int, int]
    ) -> NDArray[np.float32]:
        """Output values as metres for this camera; nan where they cannot be."""
        spec = self.spec
        if spec.unit == INVERSE:
            depth = _inverse(value)
        else:
            depth = np.where(value > 0, value * np.float32(METRES[spec.unit]), np.float32(np.nan))
        known = depth[np.isfinite(depth)]
        if not self._plausible and known.size:
            median, (least, most) = float(np.median(known)), PLAUSIBLE_M
            if not least <= median <= most:
                raise UserError(
                    f"network {self.name} sees a median depth of {median:.3g} m, expected "
                    f"{least:g} to {most:g}; its unit is probably not {spec.unit}: see its sidecar"
                )
            self._plausible = True
        if spec.focal_px is not None:
            # The image may be squeezed to another aspect: areas count, not one of the sides.
            across = camera.fx * size[0] / camera.width
            down = camera.fy * size[1] / camera.height
            depth = depth * np.float32(math.sqrt(across * down) / spec.focal_px)
        return np.asarray(depth, np.float32)


def _inverse(value: NDArray[np.float32]) -> NDArray[np.float32]:
    """1 / value, nan for 0 and less."""
    with np.errstate(divide="ignore", over="ignore"):
        return np.where(value > 0, 1 / value, np.float32(np.nan)).astype(np.float32)


def _only(what: str, wanted: str | None, there: tuple[str, ...], path: Path) -> str:
    """The wanted name, or the file's only one."""
    if wanted is None and len(there) == 1:
        return there[0]
    if wanted in there and wanted is not None:
        return wanted
    if wanted is None:
        raise UserError(
            f"network file {path} has the {what}s {', '.join(there) or 'none'}; "
            f"expected one, or its name as '{what}' in the sidecar"
        )
    raise UserError(
        f"network file {path} has no {what} '{wanted}'; it has {', '.join(there) or 'none'}"
    )


def _fit(spec: DepthSpec, seen: Signature, path: Path) -> tuple[DepthSpec, Shape]:
    """The spec with the file's own layout and size filled in, and the input's shape.

    Raises UserError if they contradict each other, or none of them gives a size.
    """
    shape = seen.inputs[_only("input", spec.input, tuple(seen.inputs), path)]

    def wrong(expected: str) -> UserError:
        got = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        return UserError(f"network file {path}: expected {expected}, got an input of shape {got}")

    if len(shape) != 4 or shape[0] not in (1, None):
        raise wrong("one image of shape (1, 3, h, w) or (1, h, w, 3)")
    layout = spec.layout or ("nhwc" if shape[3] == 3 and shape[1] != 3 else "nchw")
    channels = shape[1] if layout == "nchw" else shape[3]
    if channels not in (3, None):
        raise wrong(f"3 colour channels in layout {layout}")
    height, width = shape[2:] if layout == "nchw" else shape[1:3]
    if spec.width is not None and spec.height is not None:
        if width not in (spec.width, None) or height not in (spec.height, None):
            raise wrong(f"{spec.width}x{spec.height} pixels as its sidecar says")
    elif width is not None and height is not None:
        spec = replace(spec, width=width, height=height, short_side=None)
    elif width is not None or height is not None or spec.short_side is None:
        raise wrong("a fixed size, or width and height (or short_side) in its sidecar")
    spec = replace(spec, layout=layout)
    size = (spec.height, spec.width)
    return spec, (1, 3, *size) if layout == "nchw" else (1, *size, 3)
