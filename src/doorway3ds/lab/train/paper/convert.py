"""Published Keras weights, and untrained ones, to the runtime's ONNX files."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from doorway3ds.errors import CallError, UserError
from doorway3ds.lab.train.paper import cnn_srin, densedepth
from doorway3ds.networks.registry import find, install

NETWORKS: dict[str, Any] = {"cnn-srin": cnn_srin, "densedepth": densedepth}


def import_published(name: str, file: Path, licence: str | None = None) -> tuple[Path, float]:
    """Installs an HDF5 file of Keras 1 or 2 as network `name`.

    Returns where it lies, and the largest difference between ONNX Runtime and Keras.

    Raises CallError for another network, UserError naming the first layer that misfits.
    """
    find(name)
    if name not in NETWORKS:
        raise CallError(f"Keras files are read for {' and '.join(NETWORKS)}, not for {name}")
    if file.suffix.lower() == ".keras":
        raise UserError(f"{file} is of Keras 3; expected a weights file of Keras 1 or 2 (.h5)")
    model = NETWORKS[name].import_weights(file)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"{name}.onnx")
        told = {"name": name, "source": file.name}
        difference = NETWORKS[name].export(model, path, told)
        return install(name, path, source=str(file), licence=licence), difference


def write_untrained(name: str, path: Path) -> None:
    """The network's ONNX file with random weights, marked so: for measuring time only."""
    network = NETWORKS[name]
    network.export(network.untrained(), path, {"name": name, "weights": "random"})
