"""A network read back from its ONNX file gives what it gave, and can be trained further."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")
os.environ["KERAS_BACKEND"] = "torch"  # before Keras is first imported
keras = pytest.importorskip("keras")

from doorway3ds.errors import UserError  # noqa: E402
from doorway3ds.lab.train.doornet.export import Calibration, export_onnx  # noqa: E402
from doorway3ds.lab.train.doornet.model import DoorNet, DoorNetConfig, build_doornet  # noqa: E402
from doorway3ds.lab.train.doornet.restore import restore  # noqa: E402
from doorway3ds.lab.train.engine import backend  # noqa: E402
from doorway3ds.networks.registry import MODELS  # noqa: E402

pytestmark = pytest.mark.train

CALIBRATION = Calibration(0.7, 0.2, -0.4, 0.6, -1.5)
METADATA = {"depth_error": 0.2, "thresholds": {"sure_score": 0.35}}


@pytest.fixture(scope="module")
def net(teachers: Path) -> DoorNet:
    """Different widths everywhere, and statistics as after a training."""
    keras.config.set_image_data_format("channels_first")
    keras.utils.set_random_seed(6)
    net = build_doornet(
        teachers / "deeplabv3_mnv2_ade20k_512.onnx",
        DoorNetConfig(10, 8, 6, 12, 3, 0.1),
    )
    rng = np.random.default_rng(1)
    for layer in net.decoder.layers:
        values = [w + rng.normal(0, 0.2, w.shape) for w in layer.get_weights()]
        if isinstance(layer, keras.layers.BatchNormalization):
            values[3] = np.abs(values[3]) + 0.1
        if layer.weights and type(layer).__name__ not in ("Dropout", "SpatialDropout2D"):
            layer.set_weights(values)
    return net


@pytest.fixture(scope="module")
def exported(net: DoorNet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("exported") / "tiny.onnx"
    export_onnx(net.whole, path, calibration=CALIBRATION, metadata=METADATA)
    return path


def outputs(net: DoorNet, image: Any) -> dict[str, Any]:
    with torch.no_grad():
        return dict(net.whole(image, training=False))


def test_what_is_read_back_gives_the_same(net: DoorNet, exported: Path) -> None:
    restored = restore(exported)
    assert vars(restored.calibration) == pytest.approx(vars(CALIBRATION))
    assert restored.metadata["thresholds"] == METADATA["thresholds"]
    image = torch.from_numpy(
        np.random.default_rng(2).uniform(0, 255, (2, 3, 64, 96)).astype(np.float32)
    )
    before, after = outputs(net, image), outputs(restored.net, image)
    for name, value in before.items():
        if name != "segments":  # serves training alone: not in the file
            scale = float(value.abs().max())
            # the file rounds weights to 16 bits; `restore` itself compares with the file
            assert float((after[name] - value).abs().max()) / scale < 0.02, name


def test_the_packaged_network_can_be_trained_further() -> None:
    backend.start(1)
    restored = restore(MODELS["doornet"].path)  # compares what both answer
    assert restored.metadata["depth_error"] > 0
    assert restored.net.whole.input_shape == (None, 3, None, None)


def test_another_architecture_is_refused_by_its_first_mismatch(
    exported: Path, tmp_path: Path
) -> None:
    import onnx

    graph = onnx.load(str(exported))
    shapes = [list(item.dims) for item in graph.graph.initializer]
    # the columns' first convolution loses a filter
    item = graph.graph.initializer[shapes.index([12, 12, 1, 5])]
    values = onnx.numpy_helper.to_array(item)[:11]
    item.CopyFrom(onnx.numpy_helper.from_array(values, item.name))
    path = tmp_path / "other.onnx"
    onnx.save(graph, str(path))
    with pytest.raises(UserError, match=r"needs a kernel of 12x12x1x5, the file has .* 11x12x1x5"):
        restore(path)


def test_what_is_no_doornet_is_refused_in_one_line(teachers: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot be trained further: it has no output 'p_open'"):
        restore(teachers / "fastdepth_nyu_224.onnx")
    damaged = tmp_path / "damaged.onnx"
    damaged.write_bytes(b"\x08no network")
    with pytest.raises(UserError, match="cannot read the network file"):
        restore(damaged)


def test_another_step_between_the_same_weights_is_noticed(exported: Path, tmp_path: Path) -> None:
    import onnx

    graph = onnx.load(str(exported))
    node = next(n for n in graph.graph.node if n.op_type == "Softplus")
    node.op_type = "Exp"
    path = tmp_path / "other.onnx"
    onnx.save(graph, str(path))
    with pytest.raises(UserError, match="its answers differ"):
        restore(path)
