"""A Keras model as the runtime's ONNX file, and proof that both give the same."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from doorway3ds.errors import UserError

BOUND = 1e-3  # largest difference allowed, relative to the largest output


def export(
    model: Any,
    path: Path,
    shape: tuple[int, int, int],
    output: str,
    finish: Callable[[Any], Any],
    metadata: Mapping[str, Any],
    *,
    scale: float = 1.0,
) -> float:
    """Writes `finish(model(image))` as output `output` of input "image", (1, *shape) float32.

    scale: the largest input value, for the check. Returns the largest difference between ONNX
    Runtime and Keras, relative to the largest output. The file appears only if that is at most
    BOUND; UserError otherwise.
    """
    import onnx
    import torch

    class Exported(torch.nn.Module):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.model = model

        def forward(self, image: Any) -> Any:
            return finish(self.model(image, training=False))

    wrapped = Exported().eval()
    device = model.weights[0].value.device
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.part")
    try:
        with torch.no_grad(), warnings.catch_warnings():
            # of sizes that tracing fixes, which are fixed here
            warnings.simplefilter("ignore")
            torch.onnx.export(
                wrapped,
                (torch.rand(1, *shape, device=device) * scale,),
                str(temporary),
                input_names=["image"],
                output_names=[output],
                opset_version=17,
                dynamo=False,
            )
        graph = onnx.load(str(temporary))
        entry = graph.metadata_props.add()
        entry.key, entry.value = "doorway3ds", json.dumps(metadata, sort_keys=True)
        onnx.checker.check_model(graph)
        onnx.save(graph, str(temporary))
        difference = parity(wrapped, temporary, shape, scale, device)
        if not difference <= BOUND:
            raise UserError(
                f"ONNX Runtime and Keras differ by {difference:.1e} of the largest output, "
                f"at most {BOUND:g} is accepted; nothing was written"
            )
        temporary.replace(path)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)
    return difference


def parity(
    wrapped: Any, path: Path, shape: tuple[int, int, int], scale: float, device: Any
) -> float:
    """Largest difference over a smooth and a noisy picture, relative to the largest output."""
    import onnxruntime
    import torch

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(0)
    ramp = np.linspace(0, scale, shape[2], dtype=np.float32)
    smooth = np.broadcast_to(ramp, (1, *shape)).copy()
    noise = rng.uniform(0, scale, (1, *shape)).astype(np.float32)
    worst = 0.0
    for image in (smooth, noise):
        with torch.no_grad():
            expected = wrapped(torch.from_numpy(image).to(device)).cpu().numpy()
        (got,) = session.run(None, {"image": image})
        largest = max(float(np.abs(expected).max()), 1e-6)
        worst = max(worst, float(np.abs(got.reshape(expected.shape) - expected).max()) / largest)
    return worst
