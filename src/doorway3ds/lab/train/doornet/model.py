"""doornet: one forward pass gives p_open, opening columns, depth and floor.

MobileNetV2 with scene-parsing weights sees the image, a decoder joins its strides 32, 16, 8 and
4. Rows are then pooled by learned attention, so that the columns of the image become a
sequence on which dilated convolutions find where an opening begins and ends (a one-dimensional
FCOS: every column inside an opening votes for its edges; Tian et al., ICCV 2019).

Depth rests on the same decoder; it is learned from measured and rendered depth, and from what
FastDepth says of photographs that have none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from doorway3ds.lab.train.doornet.backbones import Source, Tensor, mobilenet_v2

# focal length in pixels of the network's input for which `depth` is metric; other cameras
# scale it by their own (a lens that magnifies makes things look nearer)
CANONICAL_F_PX = 214.0

_TYPICAL_M = 2.5  # what depth starts from

SEGMENTS = ("other", "wall", "floor", "door", "window", "ceiling")


@dataclass(frozen=True)
class DoorNetConfig:
    """Widths of the decoder by stride, and of the column head."""

    width_16: int = 128
    width_8: int = 96
    width_4: int = 64
    width_columns: int = 96
    attention_heads: int = 4
    dropout: float = 0.3


@dataclass(frozen=True)
class DoorNet:
    """The network and its two halves, which share all weights with it.

    Training with frozen encoders runs the first half in ONNX Runtime, which is three times as
    fast on a CPU, and learns the second.
    """

    whole: Any  # image -> outputs
    encoder: Any  # image -> features, a list
    decoder: Any  # features -> outputs


def build_doornet(
    semantic_weights: Source,
    config: DoorNetConfig = DoorNetConfig(),
) -> DoorNet:
    """A Keras model from (B, 3, h, w) RGB 0..255, h and w multiples of 32.

    Outputs, as a dict: p_open (B,) logit; score (B, N) logits; left, right (B, N) distances
    from a strip's centre to the opening's edges as fractions of the width; clear (B, N) logits
    that the way to the opening in this strip is free; depth
    (B, h/2, w/2) canonical metres; floor (B, h/4, w/4) logits; and for training only segments
    (B, 6, h/4, w/4) logits. N = w / 4.
    """
    import keras
    from keras import layers

    image = keras.Input((3, None, None), name="image")
    semantic = mobilenet_v2(layers.Rescaling(1 / 127.5, -1.0)(image), semantic_weights)
    features = [semantic[key] for key in ("s32", "s16", "s8", "s4")]
    encoder = keras.Model(image, features, name="encoder")
    inputs = [keras.Input((f.shape[1], None, None)) for f in features]
    decoder = keras.Model(inputs, _decode(inputs, config), name="decoder")
    whole = keras.Model(image, decoder(encoder(image)), name="doornet")
    return DoorNet(whole, encoder, decoder)


def split_at(net: DoorNet, thaw: int) -> tuple[Any, Any]:
    """(front, rest): what stays as it is while the encoder learns from convolution `thaw` on.

    rest(front(image)) is the whole network, and layers are shared. A front may run in ONNX
    Runtime, which is three times as fast on a CPU. None where there is no such cut: it would lie
    before the first convolution or inside a residual block.
    """
    import keras

    names = {layer.name for layer in net.encoder.layers}
    if thaw == 0:
        return None, net.whole
    if f"sem_{thaw:02d}" not in names:
        return net.encoder, net.decoder
    cut = net.encoder.get_layer(f"sem_{thaw:02d}").input
    image, outputs = net.encoder.inputs[0], list(net.encoder.outputs)
    behind: list[int] = []
    for index, output in enumerate(outputs):
        try:
            keras.Model(cut, output)
            behind.append(index)
        except ValueError:
            continue  # made before the cut
    if not behind:
        return None, net.whole
    before = [index for index in range(len(outputs)) if index not in behind]
    front = keras.Model(image, [cut, *(outputs[index] for index in before)])
    tail = keras.Model(cut, [outputs[index] for index in behind])
    inputs = [keras.Input((f.shape[1], None, None)) for f in front.outputs]
    features: list[Any] = [None] * len(outputs)
    for index, tensor in zip(before, inputs[1:], strict=True):
        features[index] = tensor
    made = tail(inputs[0])
    for index, tensor in zip(behind, made, strict=True):
        features[index] = tensor
    return front, keras.Model(inputs, net.decoder(features))


def is_batch_norm(layer: Any) -> bool:
    """Whether a layer is batch normalisation, Keras' own or the fused one."""
    from keras import layers

    return isinstance(layer, layers.BatchNormalization)


def fused_batch_norm() -> Any:
    """Keras' batch normalisation of (B, C, h, w), computed in training by one kernel of PyTorch.

    Keras' own makes eight passes over memory; together with its backward they are a third of the
    time of a training step on a CPU. Running variances are unbiased.
    """
    from keras import layers
    from torch.nn import functional

    class FusedBatchNorm(layers.BatchNormalization):  # type: ignore[misc]
        def call(self, inputs: Any, training: bool | None = None, mask: Any = None) -> Any:
            if not training or not self.trainable:
                return super().call(inputs, training=training, mask=mask)
            return functional.batch_norm(
                inputs.float(),
                self.moving_mean.value,
                self.moving_variance.value,
                self.gamma.value,
                self.beta.value,
                training=True,
                momentum=1 - self.momentum,
                eps=self.epsilon,
            )

    return FusedBatchNorm


def _decode(features: list[Tensor], config: DoorNetConfig) -> dict[str, Tensor]:
    import keras
    from keras import layers, ops

    top, semantic_16, semantic_8, semantic_4 = features

    batch_norm = fused_batch_norm()

    def linear(x: Tensor, filters: int, size: int | tuple[int, int] = 1, **options: Any) -> Tensor:
        x = layers.Conv2D(filters, size, padding="same", use_bias=False, **options)(x)
        return batch_norm(axis=1, momentum=0.9)(x)

    def conv(x: Tensor, filters: int, size: int | tuple[int, int] = 1, **options: Any) -> Tensor:
        return layers.Activation("relu")(linear(x, filters, size, **options))

    def separable(x: Tensor, filters: int) -> Tensor:
        x = layers.DepthwiseConv2D(5, padding="same", use_bias=False)(x)
        x = batch_norm(axis=1, momentum=0.9)(x)
        return conv(x, filters)

    def up(x: Tensor) -> Tensor:
        return layers.UpSampling2D(2, interpolation="bilinear")(x)

    def merged(coarse: Tensor, fine: Tensor, filters: int) -> Tensor:
        # the convolution comes before the enlargement: the same answer, a quarter of the work
        x = layers.Add()([up(linear(coarse, filters)), linear(fine, filters)])
        return separable(layers.Activation("relu")(x), filters)

    join = layers.Concatenate(axis=1)
    deep = merged(top, semantic_16, config.width_16)
    middle = merged(deep, semantic_8, config.width_8)
    fine = merged(middle, semantic_4, config.width_4)

    segments = layers.Conv2D(len(SEGMENTS), 1, name="segments")(fine)
    floor = layers.Conv2D(1, 1, name="floor_head")(fine)
    # how far away everything is shows in the whole image, what is nearer than what in its parts
    scale = layers.Dense(1, use_bias=False, name="scale_head")(ops.mean(deep, axis=(2, 3)))
    start = keras.initializers.Constant(math.log(_TYPICAL_M))
    near = separable(separable(fine, config.width_4), config.width_4)
    shape = layers.Conv2D(1, 1, bias_initializer=start, name="depth_head")(near)
    depth = ops.exp(up(shape) + scale[:, :, None, None])

    # columns: rows pooled by attention, one softmax a head, and by maximum
    heads = config.attention_heads
    logits = layers.Conv2D(heads, 1, name="row_attention")(fine)
    weights = layers.Softmax(axis=2)(logits)
    pooled = [
        ops.sum(fine * weights[:, head : head + 1], axis=2, keepdims=True) for head in range(heads)
    ]
    pooled.append(ops.max(fine, axis=2, keepdims=True))
    context = ops.mean(deep, axis=2, keepdims=True)
    context = layers.UpSampling2D((1, 4), interpolation="nearest")(context)
    columns = conv(join([*pooled, context]), config.width_columns)
    columns = layers.SpatialDropout2D(config.dropout)(columns)
    for dilation in (1, 2, 4, 8):
        step = conv(columns, config.width_columns, (1, 5), dilation_rate=(1, dilation))
        columns = layers.Add()([columns, step])

    def column_output(name: str) -> Tensor:
        return layers.Conv2D(1, (1, 3), padding="same", name=name)(columns)[:, 0, 0, :]

    score = column_output("score_head")
    clear = column_output("clear_head")
    left = ops.softplus(column_output("left_head"))
    right = ops.softplus(column_output("right_head"))

    # what the encoder already knew of scenes, beside what the columns show
    pooled = [ops.max(columns, axis=(2, 3)), ops.mean(columns, axis=(2, 3))]
    pooled += [f(x, axis=(2, 3)) for x in (top, semantic_16) for f in (ops.mean, ops.max)]
    whole = layers.BatchNormalization(momentum=0.9)(join([*pooled, ops.mean(deep, axis=(2, 3))]))
    whole = layers.Dropout(config.dropout)(whole)
    whole = layers.Dense(64, activation="relu")(whole)
    p_open = layers.Dense(1, name="p_open_head")(whole)

    return {
        "p_open": p_open[:, 0],
        "score": score,
        "left": left,
        "right": right,
        "clear": clear,
        "depth": depth[:, 0],
        "floor": floor[:, 0],
        "segments": segments,
    }
