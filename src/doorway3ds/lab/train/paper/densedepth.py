"""DenseDepth (Alhashim & Wonka, arXiv 1812.11941): network and loss as published.

DenseNet-169 without its top; a 1x1 convolution; four blocks, each a bilinear upsampling by two
(corners aligned), a skip connection and two 3x3 convolutions with LeakyReLU 0.2; a 3x3 convolution
to one channel. RGB 0..1 in, farthest depth / depth out, at half the input's size.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from doorway3ds.errors import UserError
from doorway3ds.lab.train.engine.backend import start
from doorway3ds.lab.train.onnx import file as onnxfile
from doorway3ds.lab.train.paper.cnn_srin import application
from doorway3ds.lab.train.paper.published import assign, read_layers

DENSENET_169 = (6, 12, 32, 32)
GROWTH = 32
SKIPS = ("pool3_pool", "pool2_pool", "pool1", "conv1_relu")
L1_WEIGHT = 0.1
_WINDOW, _SIGMA, _K1, _K2 = 11, 1.5, 0.01, 0.03  # Wang et al. 2004, as tf.image.ssim


@dataclass(frozen=True)
class Setting:
    """What depends on the data: input size, and limits of depth in metres.

    plausible_m: where the median depth of the images must lie.
    """

    name: str
    height: int
    width: int
    nearest_m: float
    farthest_m: float
    plausible_m: tuple[float, float]

    @property
    def most(self) -> float:
        """The largest target: farthest / nearest."""
        return self.farthest_m / self.nearest_m


NYU = Setting("nyu", 480, 640, 0.1, 10.0, (0.4, 8.0))
KITTI = Setting("kitti", 384, 1280, 1.0, 80.0, (2.0, 60.0))
SETTINGS = {setting.name: setting for setting in (NYU, KITTI)}


@functools.cache
def _upsampling() -> Any:
    """The layer class; made late, as Keras is."""
    keras = start()
    import torch

    class BilinearUpSampling2D(keras.layers.Layer):  # type: ignore[misc, name-defined]
        """(B, C, h, w) to (B, C, 2h, 2w), bilinear, corner pixels kept in place."""

        def call(self, inputs: Any) -> Any:
            return torch.nn.functional.interpolate(
                inputs, scale_factor=2, mode="bilinear", align_corners=True
            )

        def compute_output_shape(self, shape: Sequence[int | None]) -> tuple[int | None, ...]:
            batch, channels, *sizes = shape
            return (batch, channels, *(None if size is None else 2 * size for size in sizes))

    return BilinearUpSampling2D


def build_densedepth(
    weights: str | Path = "imagenet",
    *,
    size: tuple[int | None, int | None] = (NYU.height, NYU.width),
    filters: int | None = None,
    blocks: Sequence[int] | None = None,
) -> Any:
    """(B, 3, h, w) RGB 0..1 to (B, 1, h/2, w/2), farthest depth / depth.

    weights: of the encoder: "imagenet", "none" or an HDF5 file. filters: of the first decoder
    convolution; the encoder's own 1664 as in the published models, or half of it as in the
    published code's default. blocks: layers of the four dense blocks, DENSENET_169 by default.
    """
    keras = start()
    layers = keras.layers
    encoder = _densenet(size, blocks or DENSENET_169)
    if str(weights) == "imagenet":
        _take_imagenet(encoder)
    elif str(weights) != "none":
        assign(encoder, read_layers(Path(weights)), Path(weights))
    deepest = encoder.output
    filters = filters or int(deepest.shape[1])
    x = layers.Conv2D(filters, 1, padding="same", name="conv2")(deepest)
    for number, skip in enumerate(SKIPS, 1):
        filters //= 2
        x = _upsampling()(name=f"up{number}_upsampling2d")(x)
        x = layers.Concatenate(axis=1, name=f"up{number}_concat")(
            [x, encoder.get_layer(skip).output]
        )
        for letter in "AB":
            name = f"up{number}_conv{letter}"
            x = layers.Conv2D(filters, 3, padding="same", name=name)(x)
            x = layers.LeakyReLU(negative_slope=0.2, name=f"{name}_act")(x)
    out = layers.Conv2D(1, 3, padding="same", name="conv3")(x)
    return keras.Model(encoder.input, out, name="densedepth")


def _densenet(size: tuple[int | None, int | None], blocks: Sequence[int]) -> Any:
    """DenseNet (Huang et al. 2017) without its top, layer by layer as keras.applications has it,
    which knows channels last only."""
    keras = start()
    layers = keras.layers

    def bn_relu(x: Any, name: str) -> Any:
        x = layers.BatchNormalization(axis=1, epsilon=1.001e-5, name=f"{name}bn")(x)
        return layers.Activation("relu", name=f"{name}relu")(x)

    def conv(x: Any, filters: int, kernel: int, name: str, stride: int = 1) -> Any:
        return layers.Conv2D(
            filters,
            kernel,
            stride,
            padding="same" if stride == 1 else "valid",
            use_bias=False,
            name=name,
        )(x)

    image = keras.Input((3, *size), name="image")
    x = layers.ZeroPadding2D(3, name="zero_padding2d")(image)
    x = bn_relu(conv(x, 64, 7, "conv1_conv", stride=2), "conv1_")
    x = layers.ZeroPadding2D(1, name="zero_padding2d_1")(x)
    x = layers.MaxPooling2D(3, 2, name="pool1")(x)
    for stage, repeats in enumerate(blocks, 2):
        for number in range(1, repeats + 1):
            name = f"conv{stage}_block{number}"
            y = conv(bn_relu(x, f"{name}_0_"), 4 * GROWTH, 1, f"{name}_1_conv")
            y = conv(bn_relu(y, f"{name}_1_"), GROWTH, 3, f"{name}_2_conv")
            x = layers.Concatenate(axis=1, name=f"{name}_concat")([x, y])
        if stage < 1 + len(blocks):
            y = bn_relu(x, f"pool{stage}_")
            x = conv(y, int(x.shape[1]) // 2, 1, f"pool{stage}_conv")
            x = layers.AveragePooling2D(2, 2, name=f"pool{stage}_pool")(x)
    return keras.Model(image, bn_relu(x, ""), name="densenet")


def _take_imagenet(encoder: Any) -> None:
    """Gives the encoder the ImageNet weights of Keras' own download."""
    keras = start()
    keras.config.set_image_data_format("channels_last")
    try:
        found = application(keras.applications.DenseNet169, "imagenet")
    finally:
        keras.config.set_image_data_format("channels_first")
    for layer in encoder.layers:
        if layer.weights:
            layer.set_weights(found.get_layer(layer.name).get_weights())


def encoder_layers(model: Any) -> list[Any]:
    """The layers that came with the encoder: all before the decoder's first."""
    names = [layer.name for layer in model.layers]
    return list(model.layers[: names.index("conv2")])


def import_weights(path: Path, size: tuple[int | None, int | None] | None = None) -> Any:
    """The network with the weights of a published Keras 1 or 2 file.

    The decoder's width is the file's. size: of the input, NYU's by default. Raises UserError
    naming the first layer that misfits.
    """
    layers = read_layers(path)
    if "conv2" not in layers:
        raise UserError(
            f"{path} does not fit: the decoder's layer conv2 is missing; expected a file of "
            f"DenseDepth, this one begins with {', '.join(list(layers)[:3])}"
        )
    filters = int(layers["conv2"][0].shape[-1])
    model = build_densedepth("none", size=size or (NYU.height, NYU.width), filters=filters)
    assign(model, layers, path)
    return model


def untrained() -> Any:
    """The network with random weights."""
    return build_densedepth("none")


def export(model: Any, path: Path, metadata: Mapping[str, Any], setting: Setting = NYU) -> float:
    """Writes the network's file; the largest difference to Keras."""
    shape = (3, setting.height, setting.width)
    return onnxfile.export(model, path, [shape], ["depth"], lambda raw: raw, metadata)


def losses(output: Any, target: Any, most: float = NYU.most) -> dict[str, Any]:
    """The published loss, (1 - SSIM) / 2 + gradients + 0.1 L1, and its parts.

    output, target: (B, 1, h, w), farthest depth / depth; target 0 where unknown. most: the
    largest target, SSIM's range. Unknown pixels take no part: what is compared there is made equal.
    """
    import torch

    known = target > 0
    predicted = output.float()
    truth = torch.where(known, target, predicted.detach())
    predicted = torch.where(known, predicted, predicted.detach())
    share = known.float().mean().clamp(min=1e-6)
    l1 = (predicted - truth).abs().mean() / share
    gradients = sum(
        (_difference(predicted, axis) - _difference(truth, axis)).abs().mean() for axis in (2, 3)
    )
    unlike = ((1 - ssim(predicted, truth, most)) / 2).clamp(0, 1).mean()
    return {
        "loss": unlike + gradients + L1_WEIGHT * l1,
        "ssim": unlike,
        "gradient": gradients,
        "l1": l1,
    }


def _difference(image: Any, axis: int) -> Any:
    """Forward differences along an axis, zero at its end, so that the shape stays."""
    import torch

    last = image.select(axis, -1).unsqueeze(axis)
    return torch.diff(image, dim=axis, append=last)


def ssim(a: Any, b: Any, most: float) -> Any:
    """(B,) structural similarity of (B, 1, h, w) maps (Wang et al. 2004): 11x11 Gaussian
    windows of sigma 1.5 that lie wholly inside; smaller ones where the map is smaller."""
    import torch

    size = min(_WINDOW, *a.shape[-2:])
    at = torch.arange(size, dtype=a.dtype, device=a.device) - (size - 1) / 2
    bell = torch.softmax(-(at**2) / (2 * _SIGMA**2), dim=0)
    window = (bell[:, None] * bell[None, :])[None, None]

    def mean(x: Any) -> Any:
        return torch.nn.functional.conv2d(x, window)

    c1, c2 = (_K1 * most) ** 2, (_K2 * most) ** 2
    mean_a, mean_b = mean(a), mean(b)
    var_a, var_b = mean(a * a) - mean_a**2, mean(b * b) - mean_b**2
    covariance = mean(a * b) - mean_a * mean_b
    light = (2 * mean_a * mean_b + c1) / (mean_a**2 + mean_b**2 + c1)
    form = (2 * covariance + c2) / (var_a + var_b + c2)
    return (light * form).mean(dim=(1, 2, 3))
