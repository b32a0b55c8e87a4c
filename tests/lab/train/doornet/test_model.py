"""doornet's graph: its outputs, what its openings rest on, and its cut for training."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")
os.environ["KERAS_BACKEND"] = "torch"  # before Keras is first imported
keras = pytest.importorskip("keras")

from doorway3ds.lab.train.doornet.model import DoorNet, DoorNetConfig, build_doornet, split_at  # noqa: E402

pytestmark = pytest.mark.train

SMALL = DoorNetConfig(8, 8, 8, 8, 2, 0.1)


@pytest.fixture
def net(teachers: Path) -> DoorNet:
    keras.config.set_image_data_format("channels_first")
    keras.utils.set_random_seed(4)
    return build_doornet(teachers / "deeplabv3_mnv2_ade20k_512.onnx", SMALL)


def picture(seed: int = 0) -> Any:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.uniform(0, 255, (2, 3, 64, 96)).astype(np.float32))


def outputs(model: Any, inputs: Any) -> dict[str, Any]:
    with torch.no_grad():
        return dict(model(inputs, training=False))


def test_fused_batch_norm_is_keras_own() -> None:
    from doorway3ds.lab.train.doornet.model import fused_batch_norm

    keras.config.set_image_data_format("channels_first")
    x = torch.randn(8, 3, 16, 16, generator=torch.Generator().manual_seed(1)) * 2 + 1
    layers = [kind(axis=1, momentum=0.9) for kind in (keras.layers.BatchNormalization,)]
    layers.append(fused_batch_norm()(axis=1, momentum=0.9))
    grads = []
    for layer in layers:
        y = layer(x, training=True)
        (y**3).mean().backward()
        grads.append(layer.gamma.value.grad)
    own, fused = ([w.value.detach() for w in layer.weights] for layer in layers)
    torch.testing.assert_close(grads[0], grads[1], rtol=1e-4, atol=1e-5)
    for a, b in zip(own, fused, strict=True):  # running variances: biased and unbiased
        torch.testing.assert_close(a, b, rtol=1e-3, atol=1e-4)
    seen = [layer(x, training=False).detach() for layer in layers]
    torch.testing.assert_close(*seen, rtol=1e-3, atol=1e-3)


def test_outputs_have_their_shapes(net: DoorNet) -> None:
    seen = outputs(net.whole, picture())
    assert {name: tuple(value.shape) for name, value in seen.items()} == {
        "p_open": (2,),
        **dict.fromkeys(("score", "left", "right", "clear"), (2, 24)),
        "depth": (2, 32, 48),
        "floor": (2, 16, 24),
        "segments": (2, 6, 16, 24),
    }


def test_the_strided_encoder_gives_every_fourth_of_the_dilated_ones_answers(
    teachers: Path,
) -> None:
    from torch.nn import functional

    from doorway3ds.lab.train.doornet.backbones import mobilenet_v2, read_convolutions

    keras.config.set_image_data_format("channels_first")
    convolutions = read_convolutions(teachers / "deeplabv3_mnv2_ade20k_512.onnx")
    image = keras.Input((3, None, None))
    features = mobilenet_v2(image, convolutions)
    net = keras.Model(image, [features["s16"], features["s32"]])
    with torch.no_grad():
        s16, strided = net(picture() / 127.5 - 1)

    # DeepLab's last two stages: stride 1, and 2 apart what MobileNetV2 has side by side
    x, at = s16, 1 + 2 + 3 * sum(repeats for repeats, _ in ((2, 2), (3, 2), (4, 2), (3, 1)))
    for block in range(4):
        entry = x
        for step in range(3):
            conv = convolutions[at]
            at += 1
            gap = 2 if step == 1 and block > 0 else 1
            kernel, bias = torch.from_numpy(conv.kernel), torch.from_numpy(conv.bias)
            padding = gap * (conv.kernel.shape[-1] // 2)
            x = functional.conv2d(x, kernel, bias, 1, padding, gap, conv.groups)
            x = x.clamp(0, 6) if step < 2 else x
        x = x + entry if 0 < block < 3 else x
    torch.testing.assert_close(strided, x[:, :, 1::2, 1::2], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("thaw", [6, 18, 99])
def test_front_and_rest_are_the_whole(net: DoorNet, thaw: int) -> None:
    front, rest = split_at(net, thaw)
    image = picture(1)
    whole, parts = outputs(net.whole, image), None
    with torch.no_grad():
        parts = rest(front(image, training=False), training=False)
    for name, value in whole.items():
        torch.testing.assert_close(parts[name], value, rtol=1e-5, atol=1e-5)
    # everything from the cut on learns with the rest, nothing before it
    learns = {variable.path for variable in rest.trainable_weights}
    for layer in net.encoder.layers:
        prefix, _, number = layer.name.partition("_")
        if number[:2].isdigit() and layer.weights:
            expected = prefix == "sem" and int(number[:2]) >= thaw
            assert all((w.path in learns) is expected for w in layer.weights), layer.name


@pytest.mark.parametrize("thaw", [0, 7])
def test_no_cut_where_there_is_none(net: DoorNet, thaw: int) -> None:
    front, rest = split_at(net, thaw)
    assert front is None
    assert rest is net.whole
