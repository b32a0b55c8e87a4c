"""From a trained Keras doornet to the runtime's ONNX file, and proof that both agree."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from doorway3ds.errors import UserError
from doorway3ds.files import write_bytes
from doorway3ds.train.doornet import CANONICAL_F_PX

FULL_BOUND, HALF_BOUND = 1e-3, 0.05  # largest difference accepted; 16-bit weights are rounded
OUTPUTS = ("p_open", "score", "left", "right", "clear", "depth", "floor")


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


def _wrapped(model: Any, calibration: Calibration) -> Any:
    import torch

    class Exported(torch.nn.Module):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.model = model

        def forward(self, image: Any) -> tuple[Any, ...]:
            found = dict(self.model(image, training=False))
            c = calibration
            best = found["score"].amax(dim=1) * c.p_open_score_scale
            found["p_open"] = found["p_open"] * c.p_open_scale + best + c.p_open_shift
            found["score"] = found["score"] * c.score_scale + c.score_shift
            return tuple(found[name] for name in OUTPUTS)

    return Exported().eval()


def _trace(
    module: Any, example: Any, target: Any, outputs: list[str], axes: dict[str, dict[int, str]]
) -> None:
    """Exports a module by running it once; target: a path or a stream of bytes."""
    import torch

    with torch.no_grad(), warnings.catch_warnings():
        # of sizes that tracing fixes: they are the layers' own, not the picture's
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module,
            (example,),
            target,
            input_names=["image"],
            output_names=outputs,
            dynamic_axes=axes,
            opset_version=17,
            dynamo=False,
        )


def export_onnx(
    model: Any,
    path: Path,
    *,
    calibration: Calibration = Calibration(),
    metadata: Mapping[str, Any],
    half: bool = True,
) -> float:
    """Writes the file whole or not at all; returns the largest difference to the Keras model.

    half: weights are stored as 16-bit floats and widened when the file is loaded; arithmetic
    stays 32-bit. The difference is relative to each output's largest magnitude.
    """
    import onnx
    import torch

    wrapped = _wrapped(model, calibration)
    example = torch.rand(1, 3, 192, 256) * 255
    temporary = path.with_name(path.name + ".part")
    axes = {"image": {2: "height", 3: "width"}}
    axes |= {name: {1: "strips"} for name in ("score", "left", "right", "clear")}
    axes |= {name: {1: f"{name}_height", 2: f"{name}_width"} for name in ("depth", "floor")}
    _trace(wrapped, example, str(temporary), list(OUTPUTS), axes)
    graph = onnx.load(str(temporary))
    if half:
        _store_half(graph)
    entry = graph.metadata_props.add()
    entry.key = "doorway3ds"
    entry.value = json.dumps(
        {"canonical_f_px": CANONICAL_F_PX, "pixels": 192 * 256, "multiple": 32, **metadata},
        sort_keys=True,
    )
    onnx.checker.check_model(graph)
    onnx.save(graph, str(temporary))
    difference = parity(wrapped, temporary)
    bound = HALF_BOUND if half else FULL_BOUND
    if not difference <= bound:
        temporary.unlink()
        raise UserError(
            f"ONNX Runtime and Keras differ by {difference:.1e} of the largest output, at most "
            f"{bound:g} is accepted; nothing was written"
        )
    temporary.replace(path)
    return difference


def set_thresholds(path: Path, thresholds: Mapping[str, Any]) -> None:
    """Writes limits of the `opening` method into an exported file's metadata."""
    import onnx

    graph = onnx.load(str(path))
    for entry in graph.metadata_props:
        if entry.key == "doorway3ds":
            values = {**json.loads(entry.value), "thresholds": thresholds}
            entry.value = json.dumps(values, sort_keys=True)
    write_bytes(path, graph.SerializeToString())


class OnnxEncoder:
    """A Keras encoder as it is now, run by ONNX Runtime: (B, 3, h, w) to a list of features."""

    def __init__(self, encoder: Any) -> None:
        import io

        import onnxruntime
        import torch

        class Listed(torch.nn.Module):  # type: ignore[misc]
            def __init__(self) -> None:
                super().__init__()
                self.encoder = encoder

            def forward(self, image: Any) -> tuple[Any, ...]:
                return tuple(self.encoder(image, training=False))

        stream = io.BytesIO()
        names = [f"feature_{index}" for index in range(len(encoder.outputs))]
        # each output has axes of its own: one name for two sizes would be taken for one size
        axes = {n: {0: "batch", 2: f"{n}_height", 3: f"{n}_width"} for n in ["image", *names]}
        example = torch.rand(2, 3, 192, 256) * 255
        _trace(Listed().eval(), example, stream, names, axes)
        self._session = onnxruntime.InferenceSession(
            stream.getvalue(), providers=["CPUExecutionProvider"]
        )

    def __call__(self, image: Any) -> list[Any]:
        return list(self._session.run(None, {"image": image}))


def _store_half(model: Any, smallest: int = 256) -> None:
    """Large float weights become float16 constants behind a Cast that loading folds away."""
    import onnx
    from onnx import numpy_helper

    casts = []
    for item in list(model.graph.initializer):
        values = numpy_helper.to_array(item)
        if values.dtype != np.float32 or values.size < smallest:
            continue
        name = item.name
        item.CopyFrom(numpy_helper.from_array(values.astype(np.float16), name + "_half"))
        casts.append(
            onnx.helper.make_node("Cast", [name + "_half"], [name], to=onnx.TensorProto.FLOAT)
        )
    nodes = list(model.graph.node)
    del model.graph.node[:]
    model.graph.node.extend(casts + nodes)


def parity(wrapped: Any, path: Path) -> float:
    """Largest difference between ONNX Runtime and PyTorch over random and smooth pictures."""
    import onnxruntime
    import torch

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(0)
    worst = 0.0
    for height, width in ((192, 256), (256, 192), (160, 288)):
        ramp = np.linspace(0, 255, width, dtype=np.float32)
        smooth = np.broadcast_to(ramp, (1, 3, height, width)).astype(np.float32)
        noise = rng.uniform(0, 255, (1, 3, height, width)).astype(np.float32)
        for image in (smooth, noise):
            with torch.no_grad():
                expected = wrapped(torch.from_numpy(image.copy()))
            for got, want in zip(session.run(None, {"image": image}), expected, strict=True):
                reference = want.numpy()
                scale = max(float(np.abs(reference).max()), 1e-3)
                worst = max(worst, float(np.abs(got - reference).max()) / scale)
    return worst
