"""A Keras model as the runtime's ONNX file, and proof that both give the same."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from doorway3ds.errors import UserError
from doorway3ds.files import whole

# largest difference allowed, relative to each output's largest value; 16-bit weights are rounded
BOUND, HALF_BOUND = 1e-3, 0.05
_SMALLEST = 1e-3  # an output that never exceeds this is compared as if it did

Shape = tuple[int, int, int]
Axes = Mapping[str, Mapping[int, str]]


def export(
    model: Any,
    path: Path,
    shapes: Sequence[Shape],
    outputs: Sequence[str],
    finish: Callable[[Any], Any],
    metadata: Mapping[str, Any],
    *,
    scale: float = 1.0,
    axes: Axes | None = None,
    half: bool = False,
) -> float:
    """Writes `finish(model(image))`, a tensor or a tuple of them, as `outputs` of input "image".

    shapes: (channels, height, width) of the float32 inputs that are compared, one image each;
    the first is traced. axes: sizes left open, by input or output name. scale: the largest input
    value. half: weights are stored as 16-bit floats and widened when the file is loaded;
    arithmetic stays 32-bit.

    Returns the largest difference between ONNX Runtime and Keras, relative to each output's
    largest value. The file appears only if that is within the bound; UserError otherwise.
    """
    import onnx
    import onnxslim
    import torch

    class Exported(torch.nn.Module):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.model = model

        def forward(self, image: Any) -> Any:
            return finish(self.model(image, training=False))

    wrapped = Exported().eval()
    device = model.weights[0].value.device
    bound = HALF_BOUND if half else BOUND
    with whole(path) as temporary:
        example = torch.rand(1, *shapes[0], device=device) * scale
        trace(wrapped, example, str(temporary), outputs, axes)
        # Gemm would hide which weights are a layer's: `doornet.restore` reads MatMul and Add
        graph = onnxslim.slim(onnx.load(str(temporary)), skip_fusion_patterns=["FusionGemm"])
        if half:
            _store_half(graph)
        entry = graph.metadata_props.add()
        entry.key, entry.value = "doorway3ds", json.dumps(metadata, sort_keys=True)
        onnx.checker.check_model(graph)
        onnx.save(graph, str(temporary))
        difference = parity(wrapped, temporary, shapes, scale, device)
        if not difference <= bound:
            raise UserError(
                f"ONNX Runtime and Keras differ by {difference:.1e} of the largest output, "
                f"at most {bound:g} is accepted; nothing was written"
            )
    return difference


def trace(
    module: Any, example: Any, target: Any, outputs: Sequence[str], axes: Axes | None = None
) -> None:
    """Exports a torch module by running it once; target: a path or a stream of bytes."""
    import torch

    with torch.no_grad(), _plain_layers(), warnings.catch_warnings():
        # of sizes that tracing fixes: they are the layers' own or the image's only one
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module,
            (example,),
            target,
            input_names=["image"],
            output_names=list(outputs),
            dynamic_axes=None if axes is None else {k: dict(v) for k, v in axes.items()},
            opset_version=17,
            dynamo=False,
        )


@contextmanager
def _plain_layers() -> Iterator[None]:
    """Layers that Keras makes of many small steps are traced as the one that PyTorch has.

    The exporter then takes batch norm into the convolution before it, and upsampling becomes one
    node whose scale does not have to be computed from the image's size.
    """
    import keras
    from torch.nn import functional

    norm, upsampling = keras.layers.BatchNormalization, keras.layers.UpSampling2D
    before = norm.call, upsampling.call

    def normalise(layer: Any, inputs: Any, training: Any = None, mask: Any = None) -> Any:
        if inputs.ndim != 4 or layer.axis != 1 or not (layer.scale and layer.center):
            return before[0](layer, inputs, training=training, mask=mask)
        statistics = (layer.moving_mean.value, layer.moving_variance.value)
        factor, offset = layer.gamma.value, layer.beta.value
        return functional.batch_norm(inputs, *statistics, factor, offset, eps=layer.epsilon)

    def enlarge(layer: Any, inputs: Any) -> Any:
        times = tuple(float(size) for size in layer.size)
        return functional.interpolate(inputs, scale_factor=times, mode=layer.interpolation)

    norm.call, upsampling.call = normalise, enlarge
    try:
        yield
    finally:
        norm.call, upsampling.call = before


def parity(wrapped: Any, path: Path, shapes: Sequence[Shape], scale: float, device: Any) -> float:
    """Largest relative difference over a smooth and a noisy image of each shape."""
    import onnxruntime
    import torch

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(0)
    worst = 0.0
    for shape in shapes:
        ramp = np.linspace(0, scale, shape[2], dtype=np.float32)
        smooth = np.broadcast_to(ramp, (1, *shape)).copy()
        noise = rng.uniform(0, scale, (1, *shape)).astype(np.float32)
        for image in (smooth, noise):
            with torch.no_grad():
                found = wrapped(torch.from_numpy(image).to(device))
            expected = found if isinstance(found, tuple) else (found,)
            for got, want in zip(session.run(None, {"image": image}), expected, strict=True):
                reference = want.cpu().numpy()
                largest = max(float(np.abs(reference).max()), _SMALLEST)
                difference = np.abs(got.reshape(reference.shape) - reference).max()
                # a nan must not pass for small
                worst = float(np.maximum(worst, difference / largest))
    return worst


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
