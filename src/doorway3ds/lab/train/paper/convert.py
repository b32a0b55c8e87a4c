"""Published Keras weights, and untrained ones, to the runtime's ONNX files."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from doorway3ds.errors import CallError, UserError
from doorway3ds.lab.train.onnx.file import export
from doorway3ds.lab.train.paper import cnn_srin, densedepth
from doorway3ds.networks.cnn_srin import SIDE
from doorway3ds.networks.registry import find, install

NAMES = ("cnn-srin", "densedepth")


def import_published(name: str, file: Path, licence: str | None = None) -> tuple[Path, float]:
    """Installs an HDF5 file of Keras 1 or 2 as network `name`.

    Returns where it lies, and the largest difference between ONNX Runtime and Keras.

    Raises CallError for another network, UserError naming the first layer that misfits.
    """
    find(name)
    if name not in NAMES:
        raise CallError(f"Keras files are read for {' and '.join(NAMES)}, not for {name}")
    if file.suffix.lower() == ".keras":
        raise UserError(f"{file} is of Keras 3; expected a weights file of Keras 1 or 2 (.h5)")
    module: Any = cnn_srin if name == "cnn-srin" else densedepth
    model = module.import_weights(file)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"{name}.onnx")
        difference = write_onnx(name, model, path, {"name": name, "source": file.name})
        return install(name, path, source=str(file), licence=licence), difference


def write_untrained(name: str, path: Path) -> None:
    """The network's ONNX file with random weights, marked so: for measuring time only."""
    model = (
        cnn_srin.join(cnn_srin.build_base("none"), cnn_srin.build_head())
        if name == "cnn-srin"
        else densedepth.build_densedepth("none")
    )
    write_onnx(name, model, path, {"name": name, "weights": "random"})


def write_onnx(name: str, model: Any, path: Path, metadata: dict[str, Any]) -> float:
    """Writes `model` with the signature of network `name`; the largest difference to Keras."""
    if name == "cnn-srin":
        return export(
            model,
            path,
            [(3, SIDE, SIDE)],
            ["p_open"],
            lambda logits: logits.sigmoid().reshape(-1),
            metadata,
            scale=255.0,
        )
    size = (3, densedepth.NYU.height, densedepth.NYU.width)
    return export(model, path, [size], ["depth"], lambda raw: raw, metadata)
