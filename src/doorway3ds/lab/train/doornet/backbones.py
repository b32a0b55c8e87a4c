"""The encoder as a Keras graph, initialised from an ONNX file whose batch norm is folded.

Channel counts come from the shapes of the file's convolutions. Channels first throughout: the
PyTorch back end then needs no transposes.

Source: Sandler et al., "MobileNetV2" (CVPR 2018).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import UserError

Tensor = Any  # a Keras symbolic tensor; Keras ships no types


@dataclass(frozen=True)
class FoldedConv:
    """One convolution of an ONNX file with its batch norm folded in."""

    kernel: NDArray[np.float32]  # (out, in / groups, kh, kw)
    bias: NDArray[np.float32]  # (out,)
    groups: int


Source = str | Path | Sequence[FoldedConv]
"""An ONNX file, or the convolutions of one in graph order; what is left over is not looked at."""


def read_convolutions(path: str | Path) -> list[FoldedConv]:
    """Convolutions of an ONNX file in graph order.

    Raises UserError where the file is missing, damaged, or holds no convolution.
    """
    import onnx
    from onnx import numpy_helper

    try:
        graph = onnx.load(str(path)).graph
    except Exception as error:
        # protobuf and onnx raise many kinds of error on a damaged file
        raise UserError(f"cannot read the ONNX file {path}: {error}") from error
    weights = {item.name: item for item in graph.initializer}
    convolutions = []
    for node in graph.node:
        if node.op_type != "Conv":
            continue
        groups = next((a.i for a in node.attribute if a.name == "group"), 1)
        kernel = numpy_helper.to_array(weights[node.input[1]]).astype(np.float32)
        bias = numpy_helper.to_array(weights[node.input[2]]).astype(np.float32)
        convolutions.append(FoldedConv(kernel, bias, groups))
    if not convolutions:
        raise UserError(f"{path} holds no convolution; expected MobileNetV2 or DeepLab on it")
    return convolutions


class _Builder:
    """Adds Keras convolutions in the order of a file's convolutions and loads their weights."""

    def __init__(self, source: Source, prefix: str) -> None:
        convolutions = read_convolutions(source) if isinstance(source, (str, Path)) else source
        self._source: Iterator[FoldedConv] = iter(convolutions)
        self._prefix = prefix
        self._count = 0
        self._pending: list[tuple[Any, FoldedConv]] = []

    def conv(
        self,
        x: Tensor,
        *,
        stride: int = 1,
        pads: tuple[int, int, int, int] | None = None,
        activation: str | None = None,
    ) -> Tensor:
        """The next convolution; pads are (top, left, bottom, right), default half the kernel."""
        from keras import layers

        source = next(self._source)
        size = source.kernel.shape[-1]
        name = f"{self._prefix}_{self._count:02d}"
        self._count += 1
        padding = "valid"
        if pads is None and stride == 1:
            padding = "same"
        else:
            top, left, bottom, right = pads or (size // 2,) * 4
            if top or left or bottom or right:
                x = layers.ZeroPadding2D(((top, bottom), (left, right)), name=f"{name}_pad")(x)
        shared = {"padding": padding, "name": name}
        if source.groups == 1:
            layer = layers.Conv2D(source.kernel.shape[0], size, stride, **shared)
        else:
            layer = layers.DepthwiseConv2D(size, stride, **shared)
        self._pending.append((layer, source))
        x = layer(x)
        return layers.Activation(activation, name=f"{name}_{activation}")(x) if activation else x

    def load(self) -> None:
        for layer, source in self._pending:
            order = (2, 3, 1, 0) if source.groups == 1 else (2, 3, 0, 1)
            layer.set_weights([np.transpose(source.kernel, order), source.bias])


# (repeats, first stride) of the seven stages of inverted residual blocks
_MOBILENET_V2 = ((1, 1), (2, 2), (3, 2), (4, 2), (3, 1), (3, 2), (1, 1))


def mobilenet_v2(x: Tensor, source: Source, *, prefix: str = "sem") -> dict[str, Tensor]:
    """MobileNetV2 to its 320 channels.

    DeepLab dilates the last two stages instead of the stride that MobileNetV2 has there. Here they
    stride: every fourth of DeepLab's answers, the same to the last bit, at a quarter of the work.

    x: (B, 3, h, w) in -1..1. Returns features by stride: "s4" (24 channels), "s8" (32), "s16" (96)
    and "s32" (320).
    """
    from keras import layers

    build = _Builder(source, prefix)
    x = build.conv(x, stride=2, pads=(0, 0, 1, 1), activation="relu6")
    features: dict[str, Tensor] = {}
    stride = 2
    for stage, (repeats, first_stride) in enumerate(_MOBILENET_V2):
        for block in range(repeats):
            step = first_stride if block == 0 else 1
            entry = x
            if stage > 0:
                x = build.conv(x, activation="relu6")
            pads = (0, 0, 1, 1) if step == 2 else None
            x = build.conv(x, stride=step, pads=pads, activation="relu6")
            x = build.conv(x)
            if block > 0:
                x = layers.Add()([entry, x])
            stride *= step
        features[f"s{stride}"] = x
    build.load()
    return features
