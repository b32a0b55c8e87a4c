from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("onnx")
from doorway3ds.errors import UserError
from doorway3ds.lab.train.engine import backend as engine
from doorway3ds.lab.train.onnx.file import BOUND, HALF_BOUND, export

pytestmark = pytest.mark.train

SHAPES = ((3, 8, 12), (3, 12, 8))
AXES = {"image": {2: "h", 3: "w"}, "map": {2: "map_h", 3: "map_w"}}


def network() -> Any:
    keras = engine.start(1)
    keras.utils.set_random_seed(2)
    image = keras.Input((3, None, None))
    found = keras.layers.Conv2D(32, 3, padding="same")(image)
    return keras.Model(image, keras.layers.Conv2D(1, 1)(found))


def both(found: Any) -> tuple[Any, Any]:
    return found, found.mean(dim=(1, 2, 3))


def test_several_outputs_and_open_sizes(tmp_path: Path) -> None:
    import onnx
    import onnxruntime

    path, half = tmp_path / "new" / "n.onnx", tmp_path / "half.onnx"
    model, told = network(), {"name": "n"}
    found = export(model, path, SHAPES, ["map", "mean"], both, told, axes=AXES)
    assert found <= BOUND / 10
    rounded = export(model, half, SHAPES, ["map", "mean"], both, told, axes=AXES, half=True)
    assert found < rounded <= HALF_BOUND
    kinds = {i.data_type for i in onnx.load(str(half)).graph.initializer if i.dims[:1] == [32]}
    assert onnx.TensorProto.FLOAT16 in kinds
    session = onnxruntime.InferenceSession(str(half))
    image = np.random.default_rng(0).random((1, 3, 20, 28), np.float32)
    outputs = session.run(None, {"image": image})
    assert [o.shape for o in outputs] == [(1, 1, 20, 28), (1,)]
    (entry,) = onnx.load(str(path)).metadata_props
    assert json.loads(entry.value) == told


@pytest.mark.parametrize("later", [1.01, float("nan")])
def test_a_file_that_answers_otherwise_never_appears(tmp_path: Path, later: float) -> None:
    path = tmp_path / "n.onnx"
    path.write_bytes(b"the one before")
    factors = iter([1.0] + [later] * 9)  # first the export, then the checks
    with pytest.raises(UserError, match=r"ONNX Runtime and Keras differ by .* nothing was written"):
        export(network(), path, SHAPES[:1], ["map"], lambda found: found * next(factors), {})
    assert [file.name for file in tmp_path.iterdir()] == ["n.onnx"]
    assert path.read_bytes() == b"the one before"


def test_a_keras_network_is_left_with_what_it_computes(tmp_path: Path) -> None:
    import onnx

    keras = engine.start(1)
    keras.utils.set_random_seed(3)
    layers = keras.layers
    image = found = keras.Input((3, None, None))
    found = layers.ZeroPadding2D(((0, 1), (0, 1)))(found)
    found = layers.Conv2D(8, 3, strides=2, use_bias=False)(found)
    found = layers.BatchNormalization(axis=1)(found)
    found = layers.Activation("relu")(found)
    found = layers.UpSampling2D(2, interpolation="nearest")(found)
    found = layers.DepthwiseConv2D(3, padding="same")(found)
    found = layers.UpSampling2D(2, interpolation="bilinear")(found)
    network = keras.Model(image, layers.Conv2D(1, 1)(found))
    norm = next(n for n in network.layers if isinstance(n, layers.BatchNormalization))
    rng = np.random.default_rng(4)
    norm.set_weights([rng.uniform(0.5, 2, 8).astype(np.float32) for _ in norm.weights])
    path = tmp_path / "n.onnx"
    assert export(network, path, SHAPES, ["map"], lambda x: x, {}, axes=AXES) < BOUND / 10
    graph = onnx.load(str(path))
    assert [node.op_type for node in graph.graph.node] == [
        "Conv",
        "Relu",
        "Resize",
        "Conv",
        "Resize",
        "Conv",
    ]
    assert {entry.domain for entry in graph.opset_import} == {""}
