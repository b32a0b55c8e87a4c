"""A doornet that can be trained further, from its ONNX file alone.

The file holds the weights but neither Keras' names nor its order. Both graphs are therefore
walked along the way of the data, from the same outputs back to the image: the order in which
weights are met then depends on the network only, and each is checked for its kind and shape.
What the restored network gives is compared with what the file gives, so that nothing but
rounding may differ.

Batch norm comes back as the mean, factor and offset that it amounts to in use: right for a
network that keeps them, which one that learns from few images does anyway. The head
of `segments` serves training alone, is not in the file, and comes back untrained.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import UserError
from doorway3ds.lab.train.doornet.backbones import FoldedConv
from doorway3ds.lab.train.doornet.export import OUTPUTS, SHAPES, Calibration
from doorway3ds.lab.train.doornet.model import DoorNet, DoorNetConfig, build_doornet, is_batch_norm
from doorway3ds.lab.train.onnx import file as onnxfile

Array = NDArray[np.float32]
Key = TypeVar("Key", str, int)

# By the kind of an ONNX node: what a weight there is called in messages.
_KINDS = {"Conv": "kernel", "MatMul": "kernel", "Sub": "mean", "Mul": "factor", "Add": "offset"}
_DECODER = {"Conv2D", "DepthwiseConv2D", "Dense"}  # and batch norm
_ENCODER_CONVS = 51  # of MobileNetV2 to its 320 channels


class _Misfit(Exception):
    """The file is of another network; says how."""


@dataclass(frozen=True)
class Restored:
    """The network, how its file's outputs are calibrated, and what its metadata say."""

    net: DoorNet
    calibration: Calibration
    metadata: Mapping[str, Any]


@dataclass(frozen=True)
class _Step:
    """One node with a weight."""

    kind: str
    values: Array
    groups: int = 1


def restore(path: Path) -> Restored:
    """The network of a file that `export_onnx` wrote.

    Raises UserError, naming the first mismatch, where the file is damaged or of another
    architecture, or where the restored network gives something else than the file.
    """
    import onnx

    try:
        graph = onnx.load(str(path))
    except Exception as error:
        # protobuf and onnx raise many kinds of error on a damaged file
        raise UserError(f"cannot read the network file {path}: {error}") from error
    try:
        walk = _Walk(graph.graph)
        steps = walk.steps()
        calibration = walk.calibration()
        net = _build(steps)
        metadata = _metadata(graph)
    except _Misfit as error:
        raise UserError(
            f"{path} cannot be trained further: {error}; expected a doornet that "
            f"`3ds train doornet` of this version wrote"
        ) from error
    difference = _difference(net, calibration, path)
    if not difference <= onnxfile.BOUND:
        raise UserError(
            f"{path} cannot be trained further: restored, its answers differ (up to "
            f"{difference:.1e} of the largest output, at most {onnxfile.BOUND:g} is accepted)"
        )
    return Restored(net, calibration, metadata)


class _Walk:
    """An ONNX graph, walked from its outputs back to the image."""

    def __init__(self, graph: Any) -> None:
        from onnx import numpy_helper

        self._nodes = {name: node for node in graph.node for name in node.output}
        self._constants: dict[str, NDArray[Any]] = {
            i.name: numpy_helper.to_array(i) for i in graph.initializer
        }
        names = {output.name for output in graph.output}
        missing = [name for name in OUTPUTS if name not in names]
        if missing:
            raise _Misfit(f"it has no output {missing[0]!r}")

    def steps(self) -> list[_Step]:
        """Every node with a weight in the order of the data, outputs in the order of OUTPUTS."""
        nodes = [self._nodes.get(name) for name in _in_turn(OUTPUTS, self._inputs)]
        return [step for node in nodes if node is not None for step in self._weights(node)]

    def _inputs(self, name: str) -> list[str]:
        node = self._nodes.get(name)
        return [] if node is None else [i for i in node.input if i]

    def _weights(self, node: Any) -> Iterator[_Step]:
        if node.op_type not in _KINDS:
            return
        weights = [self._constant(name) for name in node.input]
        groups = next((a.i for a in node.attribute if a.name == "group"), 1)
        known = [w for w in weights if w is not None and w.ndim > 0 and w.dtype.kind == "f"]
        for number, values in enumerate(known):
            # a convolution's second weight is what a node of its own would add
            kind = node.op_type if number == 0 else "Add"
            yield _Step(kind, values.astype(np.float32), int(groups))

    def _constant(self, name: str) -> NDArray[Any] | None:
        """A constant, also behind a node that changes its type only."""
        while name not in self._constants:
            node = self._nodes.get(name)
            if node is None or node.op_type != "Cast":
                return None
            name = node.input[0]
        return self._constants[name]

    def calibration(self) -> Calibration:
        """The maps that `Calibration` has put behind the logits."""
        score, score_shift = self._peel("score", "Add")
        _, score_scale = self._peel(score, "Mul")
        both, shift = self._peel("p_open", "Add")
        total = self._nodes.get(both)
        if total is None or total.op_type != "Add":
            raise _Misfit("p_open is not the sum of its own and the best strip's logit")
        own, best = (self._peel(name, "Mul")[1] for name in total.input)
        return Calibration(own, best, shift, score_scale, score_shift)

    def _peel(self, name: str, kind: str) -> tuple[str, float]:
        """(value, number) of a node that adds to or multiplies a value by one number.

        A map that changes nothing leaves no node in a tidied graph: the value itself then.
        """
        node = self._nodes.get(name)
        if node is not None and node.op_type == kind:
            constants = [self._constant(i) for i in node.input]
            for other, value in zip(node.input, reversed(constants), strict=True):
                if value is not None and value.size == 1:
                    return str(other), float(value.reshape(()))
        return name, {"Add": 0.0, "Mul": 1.0}[kind]


def _build(steps: Sequence[_Step]) -> DoorNet:
    """The Keras network with the weights of `steps`."""
    encoder, decoder = _convolutions(steps, _ENCODER_CONVS)
    try:
        net = build_doornet(encoder, _config(decoder))
    except (StopIteration, ValueError, IndexError) as error:
        raise _Misfit(f"its encoder is not MobileNetV2 ({error})") from error
    _load(net, decoder)
    return net


def _convolutions(steps: Sequence[_Step], count: int) -> tuple[list[FoldedConv], list[_Step]]:
    """The first `count` convolutions with their offsets, or what there is, and what comes then."""
    found: list[FoldedConv] = []
    at = 0
    while at + 1 < len(steps) and len(found) < count:
        conv, offset = steps[at : at + 2]
        if (conv.kind, offset.kind) != ("Conv", "Add"):
            break
        found.append(FoldedConv(conv.values, offset.values.ravel(), conv.groups))
        at += 2
    return found, list(steps[at:])


def _config(decoder: Sequence[_Step]) -> DoorNetConfig:
    """Widths of the decoder, from the sizes of its first convolutions."""
    sizes = [step.values.shape[0] for step in decoder if step.kind == "Conv"]
    if len(sizes) < 14:
        raise _Misfit(f"its decoder has {len(sizes)} convolutions")
    # four a stride: two that are joined, depthwise, pointwise; then attention, then the columns
    return DoorNetConfig(sizes[0], sizes[4], sizes[8], sizes[13], sizes[12])


def _load(net: DoorNet, steps: Sequence[_Step]) -> None:
    """Gives the decoder its weights, checked one by one."""
    source = deque(steps)

    def take(kind: str, layer: Any, shape: tuple[int, ...]) -> Array:
        step = source.popleft() if source else None
        wanted = f"{layer.name} needs a {_KINDS[kind]} of {'x'.join(map(str, shape))}"
        if step is None:
            raise _Misfit(f"{wanted}, the file ends before")
        values = step.values if kind in ("Conv", "MatMul") else step.values.ravel()
        if step.kind != kind or values.shape != shape:
            raise _Misfit(
                f"{wanted}, the file has a {_KINDS[step.kind]} of "
                f"{'x'.join(map(str, values.shape))}"
            )
        return values

    for layer in _in_order(net.decoder):
        shapes = [tuple(weight.shape) for weight in layer.weights]
        if is_batch_norm(layer):
            mean, factor = np.zeros(shapes[0], np.float32), np.ones(shapes[0], np.float32)
            # after a convolution, its kernel may have the factor, and its offset the mean
            if not source or source[0].kind != "Add":
                mean, factor = (take(kind, layer, shapes[0]) for kind in ("Sub", "Mul"))
            offset = take("Add", layer, shapes[0])
            variance = np.full(shapes[0], 1 - layer.epsilon, np.float32)
            layer.set_weights([factor, offset, mean, variance])
            continue
        if type(layer).__name__ == "Dense":
            kernel = take("MatMul", layer, shapes[0])
        else:
            # Keras has (h, w, in, out), and (h, w, channels, 1) for what works channel by channel
            to_onnx = (3, 2, 0, 1) if type(layer).__name__ == "Conv2D" else (2, 3, 0, 1)
            shape = tuple(shapes[0][axis] for axis in to_onnx)
            kernel = take("Conv", layer, shape).transpose(np.argsort(to_onnx))
        layer.set_weights([kernel, *(take("Add", layer, shape) for shape in shapes[1:])])
    if source:
        left = source[0]
        raise _Misfit(f"it has a further {_KINDS[left.kind]} of {left.values.shape}")


def _in_order(model: Any) -> list[Any]:
    """The layers with weights in the order of `_Walk.steps`."""
    outputs = dict(zip(model.output_names, model.outputs, strict=True))
    if isinstance(model.output, Mapping):
        outputs = dict(model.output)
    tensors = {id(outputs[name]): outputs[name] for name in OUTPUTS}

    def inputs(key: int) -> list[int]:
        operation, index, _ = tensors[key]._keras_history
        before = operation._inbound_nodes[index].input_tensors
        tensors.update({id(tensor): tensor for tensor in before})
        return [id(tensor) for tensor in before]

    operations = [tensors[key]._keras_history[0] for key in _in_turn(list(tensors), inputs)]
    return [o for o in operations if is_batch_norm(o) or type(o).__name__ in _DECODER]


def _in_turn(ends: Sequence[Key], inputs: Callable[[Key], Sequence[Key]]) -> list[Key]:
    """Whatever the ends are made of, each once and after what it is made of itself."""
    found: dict[Key, None] = {}

    def visit(key: Key) -> None:
        if key not in found:
            for made_of in inputs(key):
                visit(made_of)
            found[key] = None

    for end in ends:
        visit(end)
    return list(found)


def _metadata(graph: Any) -> Mapping[str, Any]:
    texts = [entry.value for entry in graph.metadata_props if entry.key == "doorway3ds"]
    try:
        return dict(json.loads(texts[0]))
    except (IndexError, ValueError, TypeError) as error:
        raise _Misfit("it carries no metadata of doornet") from error


def _difference(net: DoorNet, calibration: Calibration, path: Path) -> float:
    """Largest relative difference between the network and its file."""
    device = net.whole.weights[0].value.device

    def answer(image: Any) -> Any:
        return calibration(net.whole(image, training=False))

    return onnxfile.parity(answer, path, SHAPES, 255.0, device)
