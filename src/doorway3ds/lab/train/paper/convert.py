"""Published Keras weights, and untrained ones, to the runtime's ONNX files."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
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
        difference = _write(name, model, path, {"name": name, "source": file.name})
        return install(name, path, source=str(file), licence=licence), difference


def write_untrained(name: str, path: Path) -> None:
    """The network's ONNX file with random weights, marked so: for measuring time only."""
    model = (
        cnn_srin.join(cnn_srin.build_base("none"), cnn_srin.build_head())
        if name == "cnn-srin"
        else densedepth.build_densedepth("none")
    )
    _write(name, model, path, {"name": name, "weights": "random"})


def _write(name: str, model: Any, path: Path, metadata: Mapping[str, Any]) -> float:
    write = export_cnn_srin if name == "cnn-srin" else export_densedepth
    return write(model, path, metadata)


def export_cnn_srin(model: Any, path: Path, metadata: Mapping[str, Any], side: int = SIDE) -> float:
    """Writes the classifier's logits as "p_open"; the largest difference to Keras."""
    shape = (3, side, side)
    return export(
        model, path, [shape], ["p_open"], lambda x: x.sigmoid().reshape(-1), metadata, scale=255.0
    )


def export_densedepth(
    model: Any,
    path: Path,
    metadata: Mapping[str, Any],
    setting: densedepth.Setting = densedepth.NYU,
) -> float:
    """Writes the depth network; the largest difference to Keras."""
    shape = (3, setting.height, setting.width)
    return export(model, path, [shape], ["depth"], lambda raw: raw, metadata)
