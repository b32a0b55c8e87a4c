"""Weights as published: HDF5 files of Keras 1 and 2, read by layer name and shape.

Such a file holds one group per layer (attribute `layer_names`), each with its arrays in order
(attribute `weight_names`), at its root or, where the whole model was saved, under
`model_weights`. A nested model is one group whose arrays have several name scopes, those of its
inner layers. Elsewhere the scope says nothing: TensorFlow numbered it anew for every further
model of a process.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import UserError

Layers = dict[str, list[NDArray[np.float32]]]
"""Arrays by layer name, in the file's order; layers without weights are left out."""


def read_layers(path: Path) -> Layers:
    """The layers of a Keras 1 or 2 HDF5 file; slashes in names become underscores.

    Raises UserError where the file is missing, damaged or of another layout.
    """
    import h5py

    if not path.is_file():
        raise UserError(f"no weights file {path}; expected an HDF5 file of Keras 1 or 2")
    try:
        with h5py.File(path, "r") as file:
            root = file.get("model_weights", file)
            if "layer_names" not in root.attrs:
                raise UserError(
                    f"{path} is not a weights file of Keras 1 or 2: it has no attribute layer_names"
                )
            found: Layers = {}
            for layer in map(_text, _attribute(root, "layer_names")):
                if layer not in root:
                    raise UserError(f"{path} is damaged: layer {layer} is listed but missing")
                names = [_text(name) for name in _attribute(root[layer], "weight_names")]
                scopes = [name.rpartition("/")[0] for name in names]
                nested = len(set(scopes)) > 1
                for name, scope in zip(names, scopes, strict=True):
                    owner = _inner(layer, scope) if nested else layer.replace("/", "_")
                    array = np.asarray(root[layer][name], np.float32)
                    found.setdefault(owner, []).append(array)
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        reason = str(error).splitlines()[0][:100]
        raise UserError(f"{path} cannot be read as an HDF5 weights file: {reason}") from error
    if not found:
        raise UserError(f"{path} holds no weights")
    return found


def _attribute(group: Any, name: str) -> Iterable[Any]:
    """An attribute; Keras splits one that is too long for HDF5 into name0, name1, ..."""
    if name in group.attrs:
        return list(group.attrs[name])
    parts: list[Any] = []
    while f"{name}{len(parts)}" in group.attrs:
        parts.append(group.attrs[f"{name}{len(parts)}"])
    return [item for part in parts for item in part]


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _inner(layer: str, scope: str) -> str:
    """The inner layer of nested model `layer` whose arrays have the name scope `scope`."""
    return scope.removeprefix(f"{layer}/").replace("/", "_")


def assign(model: Any, layers: Mapping[str, list[NDArray[np.float32]]], path: Path) -> None:
    """Gives each layer of a Keras model that has weights those of its name.

    Raises UserError naming the first layer that is missing or of another shape.
    """
    fitting = []
    for layer in model.layers:
        if not layer.weights:
            continue
        expected = [tuple(w.shape) for w in layer.weights]
        if layer.name not in layers:
            raise UserError(
                f"{path} does not fit: layer {layer.name} with arrays {_shapes(expected)} is "
                f"missing; the file begins with {', '.join(list(layers)[:3])}"
            )
        got = [a.shape for a in layers[layer.name]]
        if got != expected:
            raise UserError(
                f"{path} does not fit: layer {layer.name} must have arrays {_shapes(expected)}, "
                f"it has {_shapes(got)}"
            )
        if not all(np.isfinite(a).all() for a in layers[layer.name]):
            raise UserError(f"{path} is damaged: layer {layer.name} has values not finite")
        fitting.append((layer, layers[layer.name]))
    for layer, arrays in fitting:
        layer.set_weights(arrays)


def _shapes(shapes: Iterable[tuple[int, ...]]) -> str:
    return ", ".join("x".join(map(str, shape)) or "scalar" for shape in shapes)
