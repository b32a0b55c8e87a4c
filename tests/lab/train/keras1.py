"""Weights files as Keras 1 and 2 wrote them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np

# layer name -> arrays by name within the file
Groups = Mapping[str, Sequence[tuple[str, np.ndarray]]]


def write(path: Path, layers: Groups, *, whole_model: bool = False) -> Path:
    """The layout of `save_weights`, or of `save` with the model_weights group."""
    with h5py.File(path, "w") as file:
        root = file.create_group("model_weights") if whole_model else file
        root.attrs["layer_names"] = [name.encode() for name in layers]
        root.attrs["backend"] = b"tensorflow"
        root.attrs["keras_version"] = b"2.1.6"
        for name, arrays in layers.items():
            group = root.create_group(name)
            group.attrs["weight_names"] = [array.encode() for array, _ in arrays]
            for array, value in arrays:
                group[array] = value
    return path


def of_model(
    model: object, rng: np.random.Generator, old_name: Callable[[str], str] = lambda name: name
) -> dict[str, list[tuple[str, np.ndarray]]]:
    """Random weights for every layer of a Keras model, under its old names."""
    layers: dict[str, list[tuple[str, np.ndarray]]] = {}
    for layer in model.layers:  # type: ignore[attr-defined]
        name = old_name(layer.name)
        layers[name] = []
        for weight in layer.weights:
            kind = weight.path.rpartition("/")[2]
            shape = tuple(weight.shape)
            fan = max(1, int(np.prod(shape[:-1])))
            value = rng.normal(0, (2 / fan) ** 0.5, shape)
            if kind in ("gamma", "moving_variance"):
                value = rng.uniform(0.5, 1.5, shape)
            elif len(shape) == 1:
                value = rng.normal(0, 0.1, shape)
            layers[name].append((f"{name}/{kind}:0", value.astype(np.float32)))
    return layers
