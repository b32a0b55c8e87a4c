from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
import torch

from doorway3ds.errors import UserError
from doorway3ds.lab.train.engine import backend as engine
from doorway3ds.lab.train.paper import densedepth
from doorway3ds.lab.train.paper.densedepth import build_densedepth, losses, ssim
from tests.lab.train import keras1

pytestmark = pytest.mark.train

SIZE = (64, 96)
TINY = (1, 1, 1, 1)


@pytest.fixture(scope="module")
def whole() -> object:
    engine.start(1)
    return build_densedepth("none", size=SIZE)


def test_as_many_parameters_as_published(whole) -> None:  # type: ignore[no-untyped-def]
    """The published NYU model has 42.8 million; here by the table of its layers."""
    decoder = {
        "conv2": (1, 1664, 1664),
        "up1_convA": (3, 1664 + 256, 832),
        "up1_convB": (3, 832, 832),
        "up2_convA": (3, 832 + 128, 416),
        "up2_convB": (3, 416, 416),
        "up3_convA": (3, 416 + 64, 208),
        "up3_convB": (3, 208, 208),
        "up4_convA": (3, 208 + 64, 104),
        "up4_convB": (3, 104, 104),
        "conv3": (3, 104, 1),
    }
    expected = {name: k * k * a * b + b for name, (k, a, b) in decoder.items()}
    counts = {layer.name: layer.count_params() for layer in whole.layers}
    assert {name: counts[name] for name in decoder} == expected
    encoder = sum(layer.count_params() for layer in densedepth.encoder_layers(whole))
    assert encoder == 12_642_880
    assert whole.count_params() == encoder + sum(expected.values()) == 42_816_089


def test_layer_shapes(whole) -> None:  # type: ignore[no-untyped-def]
    height, width = SIZE
    expected = {
        "conv1_relu": (64, 2),
        "pool1": (64, 4),
        "pool2_pool": (128, 8),
        "pool3_pool": (256, 16),
        "pool4_pool": (640, 32),
        "relu": (1664, 32),
        "conv2": (1664, 32),
        "up1_concat": (1664 + 256, 16),
        "up2_concat": (832 + 128, 8),
        "up3_concat": (416 + 64, 4),
        "up4_concat": (208 + 64, 2),
        "conv3": (1, 2),
    }
    for name, (channels, step) in expected.items():
        shape = whole.get_layer(name).output.shape
        assert shape == (None, channels, height // step, width // step), name


def test_the_encoder_is_keras_own_densenet_169(whole) -> None:  # type: ignore[no-untyped-def]
    keras = engine.start()
    keras.config.set_image_data_format("channels_last")
    try:
        theirs = keras.applications.DenseNet169(
            include_top=False, weights=None, input_shape=(*SIZE, 3)
        )
    finally:
        keras.config.set_image_data_format("channels_first")
    rng = np.random.default_rng(0)
    for layer in theirs.layers:
        if layer.weights:
            fan = {w.path: max(1, int(np.prod(w.shape[:-1]))) for w in layer.weights}
            values = [
                rng.normal(0, (2 / fan[w.path]) ** 0.5, w.shape)
                if len(w.shape) == 4
                else rng.uniform(0.5, 1.5, w.shape)
                for w in layer.weights
            ]
            layer.set_weights(values)
            whole.get_layer(layer.name).set_weights(values)
    image = torch.rand(1, *SIZE, 3)
    with torch.no_grad():
        names = ("pool1", "pool2_pool", "relu")
        expected = keras.Model(theirs.input, [theirs.get_layer(n).output for n in names])(image)
        probe = keras.Model(whole.input, [whole.get_layer(n).output for n in names])
        found = probe(image.permute(0, 3, 1, 2))
    for ours, their in zip(found, expected, strict=True):
        limit = 1e-3 * float(their.abs().max())
        assert torch.allclose(ours.permute(0, 2, 3, 1), their, rtol=1e-3, atol=limit)


def test_upsampling_keeps_the_corners() -> None:
    engine.start(1)
    layer = densedepth._upsampling()()
    row = torch.tensor([0.0, 3.0]).reshape(1, 1, 1, 2)
    found = layer(torch.cat([row, row + 3], dim=2))[0, 0]
    assert torch.allclose(found[0], torch.tensor([0.0, 1.0, 2.0, 3.0]))
    assert torch.allclose(found[:, 0], torch.tensor([0.0, 1.0, 2.0, 3.0]))


def test_losses_by_hand() -> None:
    """A step of 3 in a map of 5, on 4x4 pixels: by arithmetic, with windows of 4x4."""
    target = torch.full((1, 1, 4, 4), 5.0)
    output = target.clone()
    output[..., 2:] += 3.0
    found = losses(output, target, most=100.0)
    assert float(found["l1"]) == pytest.approx(1.5)
    assert float(found["gradient"]) == pytest.approx(3 * 4 / 16)  # one column of steps
    # Half of a symmetric window is raised by 3: mean 6.5, variance 9 / 4, no covariance.
    c1, c2 = 1.0, 9.0
    alike = (2 * 6.5 * 5 + c1) / (6.5**2 + 5**2 + c1) * c2 / (9 / 4 + c2)
    assert float(found["ssim"]) == pytest.approx((1 - alike) / 2, rel=1e-4)
    expected = (1 - alike) / 2 + 0.75 + 0.1 * 1.5
    assert float(found["loss"]) == pytest.approx(expected, rel=1e-5)


def test_ssim_of_equal_and_of_constant_maps() -> None:
    a = torch.rand(2, 1, 20, 24) * 50
    assert torch.allclose(ssim(a, a, 100.0), torch.ones(2), atol=1e-5)
    flat = ssim(torch.full((1, 1, 12, 12), 10.0), torch.full((1, 1, 12, 12), 20.0), 100.0)
    assert float(flat) == pytest.approx((2 * 200 + 1) / (100 + 400 + 1), rel=1e-3)


def test_unknown_depth_costs_nothing_and_teaches_nothing() -> None:
    target = torch.full((1, 1, 16, 16), 4.0)
    target[..., 8:, :] = 0.0
    output = torch.full((1, 1, 16, 16), 4.0)
    output[..., 8:, :] = 90.0
    output.requires_grad_()
    found = losses(output, target)
    assert float(found["l1"]) == 0.0
    assert float(found["loss"]) == pytest.approx(0.0, abs=1e-5)
    (output * 1.5).sum().backward(retain_graph=True)
    output.grad = None
    found = losses(output + torch.linspace(0, 1, 16), target)
    found["loss"].backward()
    assert output.grad is not None
    assert float(output.grad[..., 8:, :].abs().max()) == 0.0
    assert float(output.grad[..., :8, :].abs().max()) > 0.0
    nothing = losses(output, torch.zeros(1, 1, 16, 16))
    assert math.isfinite(float(nothing["loss"])) and float(nothing["l1"]) == 0.0


def old_name(name: str) -> str:
    """Keras 2 wrote the first block's names with slashes."""
    return {f"conv1_{kind}": f"conv1/{kind}" for kind in ("conv", "bn", "relu")}.get(name, name)


def test_published_weights_layer_by_layer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keras = engine.start(1)
    monkeypatch.setattr(densedepth, "DENSENET_169", TINY)
    rng = np.random.default_rng(3)
    for filters in (None, 34):  # the published models, and the code's half decoder
        model = build_densedepth("none", size=SIZE, filters=filters)
        layers = keras1.of_model(model, rng, old_name)
        path = keras1.write(tmp_path / "nyu.h5", layers, whole_model=True)
        for layer in model.layers:
            if layer.weights:
                layer.set_weights([a for _, a in layers[old_name(layer.name)]])
        imported = densedepth.import_weights(path, SIZE)
        image = torch.rand(1, 3, *SIZE)
        with torch.no_grad():
            outputs = [
                keras.Model(m.input, [m.get_layer(layer.name).output for layer in model.layers])(
                    image, training=False
                )
                for m in (model, imported)
            ]
        for layer, expected, found in zip(model.layers, *outputs, strict=True):
            assert torch.equal(found, expected), layer.name


def test_the_first_mismatch_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    engine.start(1)
    monkeypatch.setattr(densedepth, "DENSENET_169", TINY)
    layers = keras1.of_model(
        build_densedepth("none", size=SIZE), np.random.default_rng(0), old_name
    )

    def refused(changed: dict[str, list[tuple[str, np.ndarray]]], message: str) -> None:
        path = keras1.write(tmp_path / "w.h5", changed)
        with pytest.raises(UserError, match=message):
            densedepth.import_weights(path, SIZE)

    wide = [(n, np.concatenate([a, a])) for n, a in layers["up2_convB"]]
    refused(layers | {"up2_convB": wide}, r"layer up2_convB must have arrays 3x3x17x17, 17")
    without = {name: arrays for name, arrays in layers.items() if name != "conv1/bn"}
    refused(without, "layer conv1_bn with arrays 64, 64, 64, 64 is missing")
    refused({"vgg": layers["conv3"]}, "the decoder's layer conv2 is missing")
