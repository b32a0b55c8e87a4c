"""An ONNX graph that can be rewritten, and what is known of the sizes of its values.

Sizes are followed as far as they can be told from the graph alone: "twice the height of x" where
x has no fixed height. A rewrite that changes how a size comes about rests on that.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_SAME_SHAPE = {"Cast", "Clip", "Exp", "Identity", "Relu", "Sigmoid", "Softplus", "Tanh"}


@dataclass(frozen=True)
class Dim:
    """A size that is known only as `times` that of a tensor's axis."""

    tensor: str
    axis: int
    times: int = 1

    def __mul__(self, factor: int) -> Dim:
        return Dim(self.tensor, self.axis, self.times * factor)

    __rmul__ = __mul__


Size = int | Dim


def opset(model: Any) -> int:
    return max((o.version for o in model.opset_import if o.domain in ("", "ai.onnx")), default=0)


def attribute(node: Any, name: str, default: Any) -> Any:
    """A node's attribute; lists as lists, texts as str."""
    from onnx import helper

    for found in node.attribute:
        if found.name == name:
            value = helper.get_attribute_value(found)
            return value.decode() if isinstance(value, bytes) else value
    return default


class Graph:
    """Nodes and constants of one model, and what is known of the sizes of values."""

    def __init__(self, model: Any) -> None:
        from onnx import numpy_helper, shape_inference

        self._model, self.opset = model, opset(model)
        del model.graph.value_info[:]  # claims of the exporter: inferred anew
        self.inputs = {value.name for value in model.graph.input}
        self.outputs = {value.name for value in model.graph.output}
        self.constants: dict[str, Array] = {
            item.name: numpy_helper.to_array(item)
            for item in model.graph.initializer
            if item.name not in self.inputs  # a caller may replace those
        }
        # by the first of a node's outputs that is not left out
        self._nodes = {next(filter(None, node.output)): node for node in model.graph.node}
        self._names = {*self.constants, *self.inputs}
        self._names.update(name for node in model.graph.node for name in node.output)
        self.types: dict[str, Any] = {}
        inferred = shape_inference.infer_shapes(model, data_prop=True).graph
        for value in (*inferred.value_info, *inferred.input, *inferred.output):
            self.types[value.name] = value.type.tensor_type
        self._takers: dict[str, set[str]] = defaultdict(set)
        for key, node in self._nodes.items():
            for name in node.input:
                self._takers[name].add(key)

    def model(self) -> Any:
        """Without what no output needs."""
        from onnx import numpy_helper

        needed, kept = set(self.outputs), []
        for node in reversed(self._nodes.values()):
            if needed & set(node.output):
                kept.append(node)
                needed.update(filter(None, node.input))
        graph = self._model.graph
        fixed = [item for item in graph.initializer if item.name in self.inputs]
        values = [(name, value) for name, value in self.constants.items() if name in needed]
        del graph.node[:], graph.initializer[:]
        graph.node.extend(reversed(kept))
        graph.initializer.extend(fixed)
        graph.initializer.extend(
            numpy_helper.from_array(np.ascontiguousarray(value).reshape(value.shape), name)
            for name, value in values
        )
        return self._model

    def nodes(self, *kinds: str) -> list[Any]:
        """Those of these kinds in the order of the data, all without a kind; standard ones."""
        return [
            node
            for node in self._nodes.values()
            if (not kinds or node.op_type in kinds) and node.domain in ("", "ai.onnx")
        ]

    def takers(self, name: str) -> list[Any]:
        return [self._nodes[key] for key in sorted(self._takers[name])]

    def alone(self, name: str, *kinds: str) -> Any | None:
        """The node of these kinds that takes a value and is all that does."""
        takers = [] if name in self.outputs else self.takers(name)
        return takers[0] if len(takers) == 1 and takers[0].op_type in kinds else None

    def rename(self, names: Mapping[str, str]) -> None:
        """Whatever takes a value of `names` takes the other; the nodes that gave it go."""
        for name, to in names.items():
            while to in names:
                to = names[to]
            for node in self.takers(name):
                for index, taken in enumerate(node.input):
                    if taken == name:
                        node.input[index] = to
            self._takers[to] |= self._takers[name]
            self._takers[name].clear()
        for name in names:
            self.replace(self._nodes[name], None)

    def replace(self, old: Any, new: Any | None) -> None:
        """Puts a node of the same output, or none, in a node's place."""
        key = old.output[0]
        for name in old.input:
            self._takers[name].discard(key)
        if new is None:
            del self._nodes[key]
            return
        self._nodes[key] = new
        for name in new.input:
            self._takers[name].add(key)

    def constant(self, name: str, value: Array) -> str:
        """Adds a constant; returns its name, which is made unique."""
        unique, number = name, 1
        while unique in self._names:
            unique, number = f"{name}_{number}", number + 1
        self._names.add(unique)
        self.constants[unique] = value
        return unique

    def rank(self, name: str) -> int | None:
        if name in self.constants:
            return int(self.constants[name].ndim)
        kind = self.types.get(name)
        return len(kind.shape.dim) if kind is not None and kind.HasField("shape") else None

    def size(self, name: str, axis: int) -> Size:
        """Of one axis of a value, traced back as far as it goes."""
        if name in self.constants:
            return int(self.constants[name].shape[axis])
        kind = self.types.get(name)
        dims = [] if kind is None else kind.shape.dim
        if axis < len(dims) and dims[axis].HasField("dim_value"):
            return int(dims[axis].dim_value)
        node = self._nodes.get(name)
        if node is not None and node.op_type in _SAME_SHAPE:
            return self.size(node.input[0], axis)
        if node is not None and node.op_type == "Transpose" and attribute(node, "perm", None):
            return self.size(node.input[0], attribute(node, "perm", None)[axis])
        if node is not None and node.op_type == "Reshape":
            target = self.sizes(node.input[1])
            # 0 and -1 have a meaning of their own
            if target is not None and all(isinstance(s, Dim) or s > 0 for s in target):
                found: Size = target[axis]
                return found
        return Dim(name, axis)

    def sizes(self, name: str) -> Array | None:
        """A value made of sizes, as an array of `Size`; None: it is made of something else."""
        value = self.constants.get(name)
        if value is not None:
            small = value.dtype == np.int64 and value.ndim < 2 and value.size < 9
            return value.astype(object) if small else None
        node = self._nodes.get(name)
        if node is None:
            return None
        kind, inputs = node.op_type, node.input
        if kind == "Shape":
            rank = self.rank(inputs[0])
            if rank is None or node.attribute:
                return None
            found = np.empty(rank, object)
            found[:] = [self.size(inputs[0], axis) for axis in range(rank)]
            return found
        if kind == "Cast" and attribute(node, "to", 0) != 7:  # INT64
            return None
        if kind not in ("Cast", "Concat", "Gather", "Mul", "Slice", "Unsqueeze"):
            return None
        parts = [self.sizes(i) for i in inputs]
        known = [part for part in parts if part is not None]
        if len(known) < len(parts):
            return None
        return _combine(kind, known)


def _combine(kind: str, parts: Sequence[Array]) -> Array | None:
    """What a node gives for sizes; along the only axis there is."""
    if kind == "Cast":
        return parts[0]
    if kind == "Concat":
        return np.concatenate(parts) if all(p.ndim == 1 for p in parts) else None
    if kind == "Mul":
        symbolic = [any(isinstance(s, Dim) for s in part.flat) for part in parts]
        return None if all(symbolic) else np.asarray(parts[0] * parts[1], object)
    if any(isinstance(s, Dim) for part in parts[1:] for s in part.flat):
        return None
    if kind == "Gather":
        index = parts[1].astype(np.int64)
        inside = parts[0].ndim == 1 and (np.abs(index + 0.5) < len(parts[0])).all()
        return np.asarray(parts[0][index], object) if inside else None
    if kind == "Unsqueeze":
        one = parts[0].ndim == 0 and parts[1].tolist() in ([0], [-1])
        return parts[0].reshape(1) if one else None
    start, end, *rest = (int(part.item()) if part.size == 1 else None for part in parts[1:])
    if parts[0].ndim != 1 or None in (start, end) or rest not in ([], [0], [0, 1]):
        return None
    return parts[0][start:end]
