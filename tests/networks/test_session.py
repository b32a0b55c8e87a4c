"""An ONNX file that cannot be opened is called damaged only if it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from doorway3ds.errors import UserError
from doorway3ds.networks.session import signature

onnx = pytest.importorskip("onnx")


def model() -> Any:
    from onnx import TensorProto, helper, numpy_helper

    sides = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 3, 4, 4])
        for name in ("image", "sum")
    ]
    weights = numpy_helper.from_array(np.ones((1, 3, 4, 4), np.float32), "weights")
    node = helper.make_node("Add", ["image", "weights"], ["sum"])
    graph = helper.make_graph([node], "add", sides[:1], sides[1:], [weights])
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    made.ir_version = 9
    return made


def refusal(path: Path) -> str:
    with pytest.raises(UserError) as caught:
        signature(path)
    message = str(caught.value)
    assert "\n" not in message and "onnxruntime_src" not in message
    return message


def test_what_the_runtime_lacks_is_said_whole(tmp_path: Path) -> None:
    path = tmp_path / "network.onnx"
    newer, later, foreign = model(), model(), model()
    newer.ir_version = 99
    later.opset_import[0].version = 99
    foreign.graph.node[0].op_type = "Frobnicate"
    for made, says, hint in (
        (newer, "Unsupported model IR version: 99, max supported IR version", "update onnxruntime"),
        (later, "Opset 99 is under development", "update onnxruntime"),
        (foreign, "No Op registered for Frobnicate", "operators that this ONNX Runtime lacks"),
    ):
        onnx.save(made, path)
        message = refusal(path)
        assert says in message and hint in message and "damaged" not in message


def test_a_file_whose_data_lie_elsewhere_names_them(tmp_path: Path) -> None:
    path = tmp_path / "network.onnx"
    onnx.save(model(), path, save_as_external_data=True, location="weights.data", size_threshold=0)
    assert signature(path).outputs == ("sum",)
    (tmp_path / "weights.data").unlink()
    message = refusal(path)
    assert "weights.data" in message and "put its data file beside it" in message
    assert "damaged" not in message


@pytest.mark.parametrize("data", [b"", b"hello", None])
def test_a_damaged_file_is_called_so(tmp_path: Path, data: bytes | None) -> None:
    path = tmp_path / "network.onnx"
    onnx.save(model(), path)
    path.write_bytes(path.read_bytes()[:60] if data is None else data)
    assert "it is damaged or not an ONNX file" in refusal(path)
