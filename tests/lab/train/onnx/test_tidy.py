"""Rewritten graphs give the same numbers from fewer nodes; what is not proven stays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")
import onnxruntime  # noqa: E402
from onnx import TensorProto, helper, numpy_helper  # noqa: E402

from doorway3ds.lab.train.onnx.tidy import tidy  # noqa: E402

RNG = np.random.default_rng(4)
SIZES = ((6, 8), (5, 4))
Weights = Mapping[str, Any]


def normal(*shape: int) -> np.ndarray:
    return RNG.normal(0, 1, shape).astype(np.float32)


def node(kind: str, inputs: str, outputs: str, **options: Any) -> Any:
    """Names are separated by spaces, "-" is one left out."""
    names = [["" if name == "-" else name for name in text.split()] for text in (inputs, outputs)]
    return helper.make_node(kind, *names, **options)


def model(nodes: Sequence[Any], weights: Weights, outputs: str = "y", opset: int = 17) -> Any:
    """Of a picture "x" with 3 channels and open height and width."""
    graph = helper.make_graph(
        nodes,
        "tiny",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 3, "h", "w"])],
        [helper.make_tensor_value_info(o, TensorProto.FLOAT, [None] * 4) for o in outputs.split()],
        [numpy_helper.from_array(np.asarray(value), name) for name, value in weights.items()],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    helper.set_model_props(made, {"doorway3ds": "{}"})
    return made


def answers(made: Any, size: tuple[int, int]) -> list[np.ndarray]:
    session = onnxruntime.InferenceSession(
        made.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    image = np.random.default_rng(1).random((1, 3, *size), np.float32)
    return list(session.run(None, {"x": image}))


def kinds(made: Any) -> list[str]:
    return [node.op_type for node in made.graph.node]


def tidied(before: Any) -> Any:
    """`tidy`, with everything checked that holds for any graph."""
    given = before.SerializeToString()
    after = tidy(before)
    assert before.SerializeToString() == given
    onnx.checker.check_model(after, full_check=True)
    for size in SIZES:
        for want, got in zip(answers(before, size), answers(after, size), strict=True):
            assert got.shape == want.shape
            assert np.abs(got - want).max() <= 1e-5 * np.abs(want).max()
    assert tidy(after).SerializeToString() == after.SerializeToString()
    assert after.metadata_props == before.metadata_props
    assert after.opset_import == before.opset_import
    assert (after.graph.input, after.graph.output) == (before.graph.input, before.graph.output)
    return after


NORM = {"w": normal(4, 3, 3, 3), "m": normal(1, 4, 1, 1), "f": normal(4, 1, 1), "o": normal(1)}


def norm(kernel: str = "x w") -> list[Any]:
    return [
        node("Conv", kernel, "c"),
        node("Sub", "c m", "s"),
        node("Mul", "f s", "t"),
        node("Add", "t o", "u"),
    ]


@pytest.mark.parametrize("weights", ["x w", "x w b"])
def test_batch_norm_becomes_weights(weights: str) -> None:
    after = tidied(model([*norm(weights), node("Relu", "u", "y")], {**NORM, "b": normal(4)}))
    assert kinds(after) == ["Conv", "Relu"]
    assert [list(i.dims) for i in after.graph.initializer] == [[4, 3, 3, 3], [4]]


def test_batch_norm_of_channels_on_their_own() -> None:
    chain = norm()
    chain[0].attribute.append(helper.make_attribute("group", 3))
    weights = {"w": normal(3, 1, 3, 3), "m": normal(3, 1, 1), "f": normal(1, 3, 1, 1)}
    after = tidied(model([*chain, node("Relu", "u", "y")], {**weights, "o": normal(3, 1, 1)}))
    assert kinds(after) == ["Conv", "Relu"]


@pytest.mark.parametrize(
    ("nodes", "outputs"),
    [
        # the convolution's own result is taken twice
        ([node("Conv", "x w", "c"), node("Add", "c m", "s"), node("Mul", "c s", "y")], "y"),
        # it is an output itself
        ([node("Conv", "x w", "c"), node("Add", "c m", "y")], "c y"),
        # turned round
        ([node("Conv", "x w", "c"), node("Sub", "m c", "y")], "y"),
        # not by channel, but by row
        ([node("Conv", "x w", "c"), node("Add", "c rows", "y")], "y"),
        # makes four pictures of one
        ([node("Conv", "x w", "c"), node("Add", "c four", "y")], "y"),
    ],
)
def test_what_is_no_batch_norm_stays(nodes: Sequence[Any], outputs: str) -> None:
    weights = {"w": normal(4, 3, 2, 1), "m": normal(4, 1, 1)}
    weights |= {"rows": normal(1, 1, 1, 1), "four": normal(4, 1, 1, 1)}
    before = model(nodes, weights, outputs)
    if "rows" in nodes[-1].input:
        # only of use for pictures of one height: compared by its nodes alone
        before.graph.initializer[2].CopyFrom(numpy_helper.from_array(normal(5, 1), "rows"))
        assert kinds(tidy(before)) == kinds(before)
    else:
        assert kinds(tidied(before)) == kinds(before)


def padded(pads: Sequence[int], *more: Any, **options: Any) -> Any:
    nodes = [node("Pad", "x p v", "z", **options), node("Conv", "z w", "y", pads=[1, 0, 0, 1])]
    weights = {"p": np.array(pads), "v": np.float32(0), "w": normal(2, 3, 3, 3), "one": [1.0]}
    return model([*nodes, *more], weights, "y y2" if more else "y")


def test_zeros_around_a_picture_become_pads() -> None:
    after = tidied(padded([0, 0, 0, 1, 0, 0, 2, 3]))
    assert kinds(after) == ["Conv"]
    (pads,) = [list(a.ints) for a in after.graph.node[0].attribute if a.name == "pads"]
    assert pads == [1, 1, 2, 4]


def test_other_padding_stays() -> None:
    ones = padded([0, 0, 1, 1, 0, 0, 1, 1])
    ones.graph.initializer[1].CopyFrom(numpy_helper.from_array(np.float32(1), "v"))
    channels = padded([0, 1, 0, 0, 0, 0, 0, 0])
    channels.graph.initializer[2].CopyFrom(numpy_helper.from_array(normal(2, 4, 3, 3), "w"))
    cut = padded([0, 0, -1, 1, 0, 0, 1, 1])
    mirrored = padded([0, 0, 1, 1, 0, 0, 1, 1], mode="reflect")
    for before in (ones, channels, cut, mirrored):
        assert kinds(tidied(before)) == ["Pad", "Conv"]
    twice = padded([0, 0, 1, 1, 0, 0, 1, 1], node("Relu", "z", "y2"))
    assert kinds(tidied(twice)) == ["Pad", "Conv", "Relu"]


def repeat(source: str, target: str, axis: int, times: int, new: int | None = None) -> list[Any]:
    """As Keras repeats an axis of rank 4; new: where the axis of one goes, default behind."""
    t, new = target, axis + 1 if new is None else new
    nodes = [node("Shape", source, f"{t}_s")]
    for index in range(4):
        nodes.append(node("Gather", f"{t}_s i{index}", f"{t}_g{index}", axis=0))
        name = f"{t}_g{index}"
        if index == axis:
            nodes.append(node("Mul", f"{name} i{times}", f"{t}_m"))
            name = f"{t}_m"
        nodes.append(node("Unsqueeze", f"{name} first", f"{t}_u{index}"))
    counts = [times if index == new else 1 for index in range(5)]
    constants = {"at": [new], "counts": counts}
    for name, value in constants.items():
        tensor = numpy_helper.from_array(np.array(value, np.int64))
        nodes.append(node("Constant", "", f"{t}_{name}", value=tensor))
    return [
        *nodes,
        node("Concat", " ".join(f"{t}_u{index}" for index in range(4)), f"{t}_target", axis=0),
        node("Unsqueeze", f"{source} {t}_at", f"{t}_long"),
        node("Expand", f"{t}_long {t}_counts", f"{t}_more"),
        node("Reshape", f"{t}_more {t}_target", target),
    ]


INDICES = {f"i{index}": np.int64(index) for index in range(4)} | {"first": np.array([0])}
LAST, FIRST = [0, 2, 3, 1], [0, 3, 1, 2]


def test_repeated_rows_and_columns_become_one_resize() -> None:
    nodes = [
        node("Transpose", "x", "t", perm=LAST),
        *repeat("t", "rows", 1, 2),
        *repeat("rows", "both", 2, 3),
        node("Transpose", "both", "y", perm=FIRST),
    ]
    after = tidied(model(nodes, INDICES))
    assert kinds(after) == ["Resize"]
    assert numpy_helper.to_array(after.graph.initializer[0]).tolist() == [1, 1, 2, 3]


@pytest.mark.parametrize("new", [1, 3])
def test_rows_in_another_order_are_no_upsampling(new: int) -> None:
    # the picture twice, one below the other, or each row's columns mixed
    nodes = [
        node("Transpose", "x", "t", perm=LAST),
        *repeat("t", "rows", 1, 2, new),
        node("Transpose", "rows", "y", perm=FIRST),
    ]
    found = kinds(tidied(model(nodes, INDICES)))
    assert "Resize" not in found
    assert "Reshape" in found


def resize(*target: Any, **options: Any) -> Any:
    """Of "x" to (its first two sizes, "hw")."""
    nodes = [
        node("Shape", "x", "s"),
        node("Slice", "s zero two", "nc"),
        node("Slice", "s two four", "old"),
        *target,
        node("Concat", "nc hw", "all", axis=0),
        node("Resize", "x - - all", "y", mode="linear", **options),
    ]
    numbers = {"zero": [0], "two": [2], "four": [4], "one": [1], "both": [2, 3], "fixed": [12, 16]}
    return model(nodes, {name: np.array(value) for name, value in numbers.items()})


def test_twice_the_size_becomes_a_scale() -> None:
    after = tidied(resize(node("Mul", "old two", "hw")))
    assert kinds(after) == ["Resize"]
    assert list(after.graph.node[0].input) == ["x", "", "y_scales"]
    assert numpy_helper.to_array(after.graph.initializer[0]).tolist() == [1, 1, 2, 2]


@pytest.mark.parametrize(
    "target",
    [
        [node("Add", "old one", "hw")],
        [node("Identity", "fixed", "hw")],  # twice the size of one picture only
        [node("Mul", "old four", "o"), node("Div", "o both", "hw")],
        [node("Mul", "old old", "hw")],
        # height and width change places
        [
            node("Slice", "old zero one", "h"),
            node("Slice", "old one two", "w"),
            node("Concat", "w h", "hw", axis=0),
        ],
    ],
)
def test_other_sizes_stay_computed(target: Sequence[Any]) -> None:
    after = tidied(resize(*target))
    (found,) = [n for n in after.graph.node if n.op_type == "Resize"]
    assert len(found.input) == 4


def test_dead_and_idle_nodes_go() -> None:
    nodes = [
        node("Identity", "x", "a"),
        node("Cast", "a", "b", to=TensorProto.FLOAT),
        node("Transpose", "b", "c", perm=LAST),
        node("Transpose", "c", "d", perm=FIRST),
        node("Relu", "d", "y"),
        node("Conv", "d w", "nobody"),
    ]
    after = tidied(model(nodes, {"w": normal(4, 3, 1, 1), "left": normal(9)}))
    assert kinds(after) == ["Relu"]
    assert not after.graph.initializer


def test_transposes_that_do_not_cancel_stay() -> None:
    nodes = [node("Transpose", "x", "a", perm=LAST), node("Transpose", "a", "y", perm=LAST)]
    assert kinds(tidied(model(nodes, {}))) == ["Transpose", "Transpose"]


def test_control_flow_and_old_opsets_are_left_alone() -> None:
    old = model([*norm(), node("Relu", "u", "y")], NORM, opset=12)
    assert tidy(old) == old
    some = numpy_helper.from_array(normal(1, 1, 1, 1))
    out = helper.make_tensor_value_info("v", TensorProto.FLOAT, None)
    branch = helper.make_graph([node("Constant", "", "v", value=some)], "b", [], [out])
    choice = node("If", "yes", "chosen", then_branch=branch, else_branch=branch)
    nodes = [*norm(), choice, node("Add", "u chosen", "y")]
    chosen = model(nodes, {**NORM, "yes": np.array(True)})
    assert tidy(chosen) == chosen


@pytest.mark.train
def test_a_keras_network_is_left_with_what_it_computes(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    from doorway3ds.lab.train.engine import backend as engine
    from doorway3ds.lab.train.onnx.file import BOUND, export

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
    norm.set_weights([RNG.uniform(0.5, 2, 8).astype(np.float32) for _ in norm.weights])
    path = tmp_path / "n.onnx"
    axes = {"image": {2: "h", 3: "w"}, "map": {2: "map_h", 3: "map_w"}}
    shapes = ((3, 8, 12), (3, 12, 8))
    assert export(network, path, shapes, ["map"], lambda x: x, {}, axes=axes) < BOUND / 10
    graph = onnx.load(str(path))
    assert kinds(graph) == ["Conv", "Relu", "Resize", "Conv", "Resize", "Conv"]
    assert {entry.domain for entry in graph.opset_import} == {""}
