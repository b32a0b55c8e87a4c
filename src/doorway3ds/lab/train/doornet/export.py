"""doornet's file: which outputs it has, how they are calibrated, and its frozen encoder alone."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from doorway3ds.files import write_bytes
from doorway3ds.lab.train.doornet.model import CANONICAL_F_PX
from doorway3ds.lab.train.onnx import file as onnxfile

OUTPUTS = ("p_open", "score", "left", "right", "clear", "depth", "floor")
SHAPES = ((3, 192, 256), (3, 256, 192), (3, 160, 288))
_AXES = {
    "image": {0: "batch", 2: "height", 3: "width"},
    "p_open": {0: "batch"},
    **{name: {0: "batch", 1: "strips"} for name in ("score", "left", "right", "clear")},
    **{name: {0: "batch", 1: f"{name}_height", 2: f"{name}_width"} for name in ("depth", "floor")},
}


@dataclass(frozen=True)
class Calibration:
    """Affine maps of logits, fitted on validation places, so that sigmoids are probabilities.

    p_open is weighed with the best strip's score: what has no opening anywhere is not open.
    """

    p_open_scale: float = 1.0
    p_open_score_scale: float = 0.0
    p_open_shift: float = 0.0
    score_scale: float = 1.0
    score_shift: float = 0.0

    def __call__(self, outputs: Mapping[str, Any]) -> tuple[Any, ...]:
        """The network's outputs as the file gives them, in the order of OUTPUTS."""
        found = dict(outputs)
        best = found["score"].amax(dim=1) * self.p_open_score_scale
        found["p_open"] = found["p_open"] * self.p_open_scale + best + self.p_open_shift
        found["score"] = found["score"] * self.score_scale + self.score_shift
        return tuple(found[name] for name in OUTPUTS)


def export_onnx(
    model: Any,
    path: Path,
    *,
    calibration: Calibration = Calibration(),
    metadata: Mapping[str, Any],
    half: bool = True,
) -> float:
    """Writes the file whole or not at all; returns the largest difference to the Keras model.

    half: 16-bit weights, see `onnx.file.export`, which also bounds the difference.
    """
    told = {"canonical_f_px": CANONICAL_F_PX, "pixels": 192 * 256, "multiple": 32, **metadata}
    return onnxfile.export(
        model, path, SHAPES, OUTPUTS, calibration, told, scale=255.0, axes=_AXES, half=half
    )


def set_metadata(path: Path, told: Mapping[str, Any]) -> None:
    """Writes into an exported file's metadata, over what it says of the same keys."""
    import onnx

    graph = onnx.load(str(path))
    for entry in graph.metadata_props:
        if entry.key == "doorway3ds":
            values = {**json.loads(entry.value), **told}
            entry.value = json.dumps(values, sort_keys=True)
    write_bytes(path, graph.SerializeToString())


class OnnxEncoder:
    """A Keras encoder as it is now, run by ONNX Runtime: (B, 3, h, w) to a list of features."""

    def __init__(self, encoder: Any) -> None:
        import keras
        import onnxruntime
        import torch

        class Listed(torch.nn.Module):  # type: ignore[misc]
            def __init__(self) -> None:
                super().__init__()
                self.encoder = encoder

            def forward(self, image: Any) -> tuple[Any, ...]:
                return tuple(keras.tree.flatten(self.encoder(image, training=False)))

        stream = io.BytesIO()
        names = [f"feature_{index}" for index in range(len(encoder.outputs))]
        # each output has axes of its own: one name for two sizes would be taken for one size
        axes = {n: {0: "batch", 2: f"{n}_height", 3: f"{n}_width"} for n in ["image", *names]}
        example = torch.rand(2, *SHAPES[0]) * 255
        onnxfile.trace(Listed().eval(), example, stream, names, axes)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = torch.get_num_threads()
        self._session = onnxruntime.InferenceSession(
            stream.getvalue(), options, providers=["CPUExecutionProvider"]
        )

    def __call__(self, image: Any) -> list[Any]:
        return list(self._session.run(None, {"image": image}))
