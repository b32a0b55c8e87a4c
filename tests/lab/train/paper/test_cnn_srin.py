from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
import torch

from doorway3ds.errors import UserError
from doorway3ds.lab.datasets.samples import Sample
from doorway3ds.lab.train.engine import backend as engine
from doorway3ds.lab.train.paper import cnn_srin
from doorway3ds.lab.train.paper.cnn_srin import FeatureCache, Wanted
from tests.factories import room, save
from tests.lab.train import keras1

pytestmark = pytest.mark.train

SIDE = 48


@pytest.fixture(scope="module")
def base() -> object:
    engine.start(1)
    return cnn_srin.build_base("none", SIDE)


def test_the_head_is_the_paper_s() -> None:
    head = cnn_srin.build_head()
    shapes = [tuple(w.shape) for w in head.weights]
    assert shapes == [(512, 1024), (1024,), (1024, 1), (1,)]
    assert [layer.activation.__name__ for layer in head.layers] == ["relu", "linear"]
    assert head.count_params() == 512 * 1024 + 1024 + 1024 + 1


def test_vgg16_has_its_published_size_and_keras_preprocessing(base) -> None:  # type: ignore[no-untyped-def]
    keras = engine.start()
    assert base.count_params() == 14_714_688
    image = np.random.default_rng(0).uniform(0, 255, (2, 3, SIDE, SIDE)).astype(np.float32)
    prepared = keras.applications.vgg16.preprocess_input(image.copy(), data_format="channels_first")
    first = base.get_layer("block1_conv1")
    kernel, bias = (torch.from_numpy(w) for w in first.get_weights())
    by_hand = torch.nn.functional.conv2d(
        torch.from_numpy(prepared.copy()), kernel.permute(3, 2, 0, 1), bias, padding=1
    ).relu()
    probe = keras.Model(base.input, first.output)
    with torch.no_grad():
        found = probe(torch.from_numpy(image))
    assert torch.allclose(found, by_hand, atol=1e-3)


def test_losses_by_hand() -> None:
    logits = torch.tensor([[0.0], [2.0], [-1.0]])
    target = torch.tensor([[0.0], [1.0], [1.0]])
    found = cnn_srin.losses(logits, target)
    expected = (math.log(2) + math.log(1 + math.exp(-2)) + math.log(1 + math.exp(1))) / 3
    assert float(found["loss"]) == pytest.approx(expected, rel=1e-6)
    assert float(found["accuracy"]) == pytest.approx(1 / 3)  # a logit of 0 says open


def test_features_are_computed_once(base, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(0)
    samples = [
        Sample(f"{i}", f"{i}", save(tmp_path / f"{i}.png", room(rng, is_open=True)), True)
        for i in range(3)
    ]
    wanted = [Wanted(s, f"{n:064x}", copy) for n, s in enumerate(samples) for copy in (0, 1)]
    cache = FeatureCache(tmp_path / "f.npz", base, seed=1)
    found = cache.features(wanted, batch=2)
    assert found.shape == (6, 512)
    assert not np.allclose(found[0], found[1])  # a copy is not the picture

    seen: list[int] = []
    again = FeatureCache(tmp_path / "f.npz", base, seed=1)
    assert np.array_equal(again.features(wanted, seen=lambda *_: seen.append(1)), found)
    assert not seen
    other = FeatureCache(tmp_path / "f.npz", base, seed=2)
    changed = other.features(wanted, seen=lambda *_: seen.append(1))
    assert seen
    assert np.array_equal(changed[::2], found[::2])
    assert not np.allclose(changed[1], found[1])
    (tmp_path / "f.npz").write_bytes(b"damaged")
    assert np.allclose(FeatureCache(tmp_path / "f.npz", base, 1).features(wanted), found)


def test_copies_stay_pictures() -> None:
    rng = np.random.default_rng(0)
    image = rng.uniform(0, 255, (3, SIDE, SIDE)).astype(np.float32)
    for seed in range(20):
        copy = cnn_srin.augmented(image, np.random.default_rng(seed))
        assert copy.shape == image.shape and copy.dtype == np.float32
        assert copy.min() >= 0 and copy.max() <= 255
        assert not np.array_equal(copy, image)


@pytest.fixture(scope="module")
def published() -> dict[str, list[tuple[str, np.ndarray]]]:
    engine.start(1)
    rng = np.random.default_rng(7)
    layers = keras1.of_model(cnn_srin.build_base("none", SIDE), rng)
    head = keras1.of_model(cnn_srin.build_head(), rng)
    renamed = {"dense": "dense_1", "p_open": "dense_2"}
    return layers | {renamed[name]: arrays for name, arrays in head.items()}


def test_published_weights_flat_and_nested_give_the_same_network(
    published: dict[str, list[tuple[str, np.ndarray]]], tmp_path: Path
) -> None:
    flat = keras1.write(tmp_path / "flat.h5", published, whole_model=True)
    inner = [pair for name, arrays in published.items() if "block" in name for pair in arrays]
    outer = {"vgg16": inner, "global_average_pooling2d_1": []}
    outer |= {name: published[name] for name in ("dense_1", "dense_2")}
    nested = keras1.write(tmp_path / "nested.h5", outer)
    image = torch.rand(1, 3, 224, 224) * 255
    answers = []
    for path in (flat, nested):
        model = cnn_srin.import_weights(path)
        for name in ("block1_conv1", "block5_conv3"):
            for (_, expected), got in zip(
                published[name], model.get_layer(name).get_weights(), strict=True
            ):
                assert np.array_equal(got, expected)
        with torch.no_grad():
            features = engine.start().Model(model.input, model.get_layer("pool").output)(image)
            answers.append(float(model(image)))
        w1, b1, w2, b2 = (a for name in ("dense_1", "dense_2") for _, a in published[name])
        by_hand = np.maximum(features.numpy() @ w1 + b1, 0) @ w2 + b2
        assert answers[-1] == pytest.approx(by_hand.item(), rel=1e-4)
    assert answers[0] == answers[1]


def test_the_first_mismatch_is_named(
    published: dict[str, list[tuple[str, np.ndarray]]], tmp_path: Path
) -> None:
    def refused(layers: dict[str, list[tuple[str, np.ndarray]]], message: str) -> None:
        path = keras1.write(tmp_path / "w.h5", layers)
        with pytest.raises(UserError, match=message) as caught:
            cnn_srin.import_weights(path)
        assert "\n" not in str(caught.value)

    softmax = [("k", np.zeros((1024, 2), np.float32)), ("b", np.zeros(2, np.float32))]
    refused(
        published | {"dense_2": softmax},
        r"layer p_open must have arrays 1024x1, 1, it has 1024x2, 2",
    )
    theano = [(n, a.transpose() if a.ndim == 4 else a) for n, a in published["block2_conv1"]]
    refused(published | {"block2_conv1": theano}, "layer block2_conv1 must have arrays 3x3x64x128")
    refused(
        {n: a for n, a in published.items() if n != "block3_conv2"}, r"block3_conv2.*is missing"
    )
    refused({n: a for n, a in published.items() if n != "dense_2"}, "expected two dense layers")
    nan = [(n, a * np.nan) for n, a in published["dense_1"]]
    refused(published | {"dense_1": nan}, "layer dense has values not finite")


def test_what_is_no_weights_file_is_refused(tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "w.h5"
    with pytest.raises(UserError, match="no weights file"):
        cnn_srin.import_weights(path)
    path.write_bytes(b"no HDF5")
    with pytest.raises(UserError, match="cannot be read as an HDF5 weights file"):
        cnn_srin.import_weights(path)
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with pytest.raises(UserError, match="has no attribute layer_names"):
        cnn_srin.import_weights(path)


def test_first_weights_from_a_file(
    published: dict[str, list[tuple[str, np.ndarray]]], tmp_path: Path
) -> None:
    layers = {name: arrays for name, arrays in published.items() if "dense" not in name}
    base = cnn_srin.build_base(keras1.write(tmp_path / "notop.h5", layers), SIDE)
    (_, kernel), _ = published["block4_conv1"]
    assert np.array_equal(base.get_layer("block4_conv1").get_weights()[0], kernel)


def test_without_internet_it_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def offline(**options: object) -> object:
        raise Exception("URL fetch failure on https://...: None -- unreachable")

    with pytest.raises(UserError, match="--weights none to begin with random ones"):
        cnn_srin.application(offline, "imagenet")
