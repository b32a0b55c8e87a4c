"""An exported ONNX graph without the detours that tracing Keras leaves in it.

What stands between convolutions costs a small network a good part of its time: batch norm and
offsets as nodes of their own, padding as a copy, enlarging through transposes and computed
shapes, all of which also keep ONNX Runtime out of its blocked layouts. Only what is proven from
the graph is rewritten; any other pattern stays as it is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from doorway3ds.lab.train.onnx.graph import Array, Dim, Graph, Size, attribute, opset

# Computed while the graph is written where all inputs are known. None is random.
_FOLDED = {
    "Add", "Cast", "Concat", "ConstantOfShape", "Equal", "Expand", "Gather", "Identity", "Mul",
    "Reshape", "Slice", "Squeeze", "Sub", "Transpose", "Unsqueeze", "Where",
}  # fmt: skip
_GROWTH = 4096  # bytes that a computed constant may have over what it is computed from
_OPSET = 13  # since which axes are inputs
_CHANNELS_LAST, _CHANNELS_FIRST = [0, 2, 3, 1], [0, 3, 1, 2]


def tidy(model: Any) -> Any:
    """The same network as a new ModelProto; inputs, outputs, opsets and metadata are kept.

    Batch norm and offsets after a convolution become its weights, zero padding before one its
    `pads`, Keras' nearest upsampling one Resize, and sizes that are whole multiples constant
    scales. Graphs with control flow, or of an opset before 13, come back as they are.
    """
    import onnx

    if opset(model) < _OPSET or any(
        a.type in (a.GRAPH, a.GRAPHS) for node in model.graph.node for a in node.attribute
    ):
        return model
    before = None
    while (data := model.SerializeToString(deterministic=True)) != before:
        before = data
        graph = Graph(onnx.ModelProto.FromString(data))
        for step in (_no_ops, _constants, _nearest, _scales, _transposes, _pads, _convolutions):
            step(graph)
        model = graph.model()
    return model


def _no_ops(graph: Graph) -> None:
    """Takes out Identity, and Cast to what a value is already."""
    names = {}
    for node in graph.nodes("Identity", "Cast"):
        kind = graph.types.get(node.input[0])
        same = kind is not None and kind.elem_type == attribute(node, "to", 0)
        if node.output[0] not in graph.outputs and (same or node.op_type == "Identity"):
            names[node.output[0]] = node.input[0]
    graph.rename(names)


def _constants(graph: Graph) -> None:
    """Computes whatever depends on constants and known sizes alone."""
    for node in graph.nodes():
        value = None if node.output[0] in graph.outputs else _value(graph, node)
        if value is not None:
            graph.replace(node, None)
            graph.constants[node.output[0]] = value


def _value(graph: Graph, node: Any) -> Array | None:
    from onnx import numpy_helper
    from onnx.reference import ReferenceEvaluator

    if node.op_type == "Constant":
        tensor = attribute(node, "value", None)
        return None if tensor is None else numpy_helper.to_array(tensor)
    sizes = graph.sizes(node.output[0])
    if sizes is not None and all(isinstance(size, int) for size in sizes.flat):
        return sizes.astype(np.int64)
    inputs = {name: graph.constants.get(name) for name in node.input}
    if node.op_type not in _FOLDED or any(value is None for value in inputs.values()):
        return None
    found = np.asarray(ReferenceEvaluator(node, {"": graph.opset}).run(None, inputs)[0])
    room = _GROWTH + sum(value.nbytes for value in inputs.values() if value is not None)
    return found if found.nbytes <= room else None


def _nearest(graph: Graph) -> None:
    """Repeating rows and columns of transposed pictures becomes one Resize."""
    from onnx import helper

    for node in graph.nodes("Transpose"):
        if attribute(node, "perm", None) != _CHANNELS_LAST:
            continue
        factors, at = np.ones(4, np.float32), node.output[0]
        while (repeated := _repeat(graph, at)) is not None:
            axis, times, at = repeated
            factors[_CHANNELS_LAST[axis]] *= times
        last = graph.alone(at, "Transpose")
        if last is None or at == node.output[0]:
            continue
        if attribute(last, "perm", None) != _CHANNELS_FIRST:
            continue
        scales = graph.constant(last.output[0] + "_scales", factors)
        resize = helper.make_node(
            "Resize", [node.input[0], "", scales], list(last.output), last.name, mode="nearest",
            coordinate_transformation_mode="asymmetric", nearest_mode="floor",
        )  # fmt: skip
        graph.replace(last, resize)


def _repeat(graph: Graph, name: str) -> tuple[int, int, str] | None:
    """(axis, times, result) where all that is made of a value of rank 4 is it repeated.

    That is a new axis of one, made longer, and joined with the one before it. Others may ask
    for the value's shape.
    """
    users = [n for n in graph.takers(name) if n.op_type != "Shape"]
    if name in graph.outputs or len(users) != 1 or users[0].op_type != "Unsqueeze":
        return None
    axes = graph.constants.get(users[0].input[1]) if len(users[0].input) == 2 else None
    expand = graph.alone(users[0].output[0], "Expand")
    if axes is None or axes.size != 1 or expand is None:
        return None
    axis = int(axes.item()) - 1
    reshape = graph.alone(expand.output[0], "Reshape")
    counts = graph.sizes(expand.input[1])
    if reshape is None or counts is None or not 0 <= axis < 4 or counts.shape != (5,):
        return None
    target = graph.sizes(reshape.input[1])
    times = counts[axis + 1]
    if isinstance(times, Dim) or [*counts[: axis + 1], *counts[axis + 2 :]] != [1] * 4:
        return None
    wanted = [graph.size(name, a) * (times if a == axis else 1) for a in range(4)]
    if target is None or times < 1 or target.tolist() != wanted:
        return None
    return axis, times, reshape.output[0]


def _scales(graph: Graph) -> None:
    """Resize to a computed size that is a whole multiple becomes Resize by that number."""
    for node in graph.nodes("Resize"):
        if len(node.input) != 4 or not node.input[3]:
            continue
        target = graph.sizes(node.input[3])
        if target is None or attribute(node, "axes", None) is not None:
            continue
        factors = [_times(graph.size(node.input[0], a), t) for a, t in enumerate(target)]
        known = [factor for factor in factors if factor is not None]
        if len(known) < len(factors) or attribute(node, "antialias", 0):
            continue
        name = graph.constant(node.output[0] + "_scales", np.array(known, np.float32))
        new = type(node).FromString(node.SerializeToString())
        new.input[2:] = [name]
        graph.replace(node, new)


def _times(size: Size, target: Size) -> int | None:
    """The whole number by which `size` becomes `target`."""
    if isinstance(size, int) and isinstance(target, int):
        return target // size if size > 0 and target > 0 and target % size == 0 else None
    if isinstance(size, int) or isinstance(target, int):
        return None
    whole = (size.tensor, size.axis) == (target.tensor, target.axis) and size.times > 0
    return _times(size.times, target.times) if whole else None


def _transposes(graph: Graph) -> None:
    """Takes out two transposes of which the second undoes the first."""
    before = {node.output[0]: node for node in graph.nodes("Transpose")}
    names = {}
    for node in before.values():
        first = before.get(node.input[0])
        if first is None or node.output[0] in graph.outputs:
            continue
        orders = attribute(first, "perm", None), attribute(node, "perm", None)
        if None not in orders and [orders[0][axis] for axis in orders[1]] == sorted(orders[0]):
            names[node.output[0]] = first.input[0]
    graph.rename(names)


def _pads(graph: Graph) -> None:
    """Zeros around a picture become the `pads` of the convolution that takes it."""
    from onnx import helper

    for node in graph.nodes("Pad"):
        conv = graph.alone(node.output[0], "Conv")
        around = graph.constants.get(node.input[1]) if len(node.input) in (2, 3) else None
        if conv is None or around is None or conv.input[0] != node.output[0]:
            continue
        if attribute(node, "mode", "constant") != "constant":
            continue
        if len(node.input) == 3 and node.input[2]:
            filling = graph.constants.get(node.input[2])
            if filling is None or filling.any():
                continue
        both = around.reshape(2, -1)
        rank = both.shape[1]
        if both[:, :2].any() or (both < 0).any() or rank < 3:
            continue
        if attribute(conv, "auto_pad", "NOTSET") != "NOTSET":
            continue
        pads = attribute(conv, "pads", [0] * (2 * rank - 4)) + both[:, 2:].ravel()
        new = type(conv).FromString(conv.SerializeToString())
        kept = [a for a in new.attribute if a.name != "pads"]
        del new.attribute[:]
        new.attribute.extend(kept)
        new.attribute.append(helper.make_attribute("pads", [int(p) for p in pads]))
        new.input[0] = node.input[0]
        graph.replace(conv, new)


def _convolutions(graph: Graph) -> None:
    """What is subtracted, multiplied and added by channel becomes a convolution's weights."""
    for node in graph.nodes("Conv"):
        if any(name not in graph.constants for name in node.input[1:] if name):
            continue
        kernel = graph.constants[node.input[1]]
        bias = np.zeros(len(kernel), kernel.dtype)
        if len(node.input) > 2 and node.input[2]:
            bias = graph.constants[node.input[2]]
        if kernel.dtype != np.float32 or bias.dtype != np.float32:
            continue
        wide, shift = kernel.astype(np.float64), bias.astype(np.float64)
        last = node
        while (follower := _by_channel(graph, last.output[0], kernel)) is not None:
            last, values = follower
            if last.op_type == "Mul":
                wide = wide * values.reshape(-1, *[1] * (kernel.ndim - 1))
                shift = shift * values
            else:
                shift = shift + (-values if last.op_type == "Sub" else values)
        if last is node:
            continue
        new = type(node).FromString(node.SerializeToString())
        name = node.output[0]
        weights = [
            graph.constant(f"{name}_kernel", wide.astype(np.float32)),
            graph.constant(f"{name}_bias", shift.astype(np.float32)),
        ]
        new.input[1:] = weights
        new.output[0] = last.output[0]
        graph.replace(last, new)


def _by_channel(graph: Graph, name: str, kernel: Array) -> tuple[Any, Array] | None:
    """(node, one float64 a channel) of what alone takes a convolution's result."""
    node = graph.alone(name, "Sub", "Mul", "Add")
    if node is None or (node.op_type == "Sub" and node.input[0] != name):
        return None
    other = graph.constants.get(next((i for i in node.input if i != name), ""))
    if other is None or other.dtype != np.float32 or other.ndim > kernel.ndim:
        return None
    shape = (1,) * (kernel.ndim - other.ndim) + other.shape
    if shape[1] not in (1, len(kernel)) or any(n != 1 for n in (shape[0], *shape[2:])):
        return None
    return node, np.broadcast_to(other.astype(np.float64).ravel(), (len(kernel),))
