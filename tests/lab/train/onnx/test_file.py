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
