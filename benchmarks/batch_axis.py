"""Does the network take less time an image if it takes several at once?

    python benchmarks/batch_axis.py

Opens the batch axis of a doornet's file and runs eight images of noise singly, by two, four and
eight, in turns, on one thread. Milliseconds are of the processor, the median over the rounds; the
answers must be those of the file as it is, to the last bit.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import onnx
import onnxruntime

from doorway3ds.networks import registry

IMAGES, SIZES = 8, (1, 2, 4, 8)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--network", type=Path, default=registry.find("doornet").path)
    parser.add_argument("--rounds", type=int, default=20)
    given = parser.parse_args()
    model = onnx.load(given.network)
    closed = opened(model.SerializeToString())
    for value in (*model.graph.input, *model.graph.output):
        value.type.tensor_type.shape.dim[0].dim_param = "batch"
    del model.graph.value_info[:]  # which holds the closed axis, too
    many = opened(model.SerializeToString())
    images = np.random.default_rng(0).random((IMAGES, 3, 192, 256), np.float32) * 255
    together = many.run(None, {"image": images})
    for index in range(IMAGES):
        alone = closed.run(None, {"image": images[index : index + 1]})
        assert all(np.array_equal(a[0], b[index]) for a, b in zip(alone, together, strict=True))
    spent: dict[int, list[float]] = {size: [] for size in SIZES}
    for _ in range(given.rounds):
        for size, values in spent.items():
            start = time.process_time()
            for first in range(0, IMAGES, size):
                many.run(None, {"image": images[first : first + size]})
            values.append((time.process_time() - start) / IMAGES * 1e3)
    for size, values in spent.items():
        print(f"{size} at once: {np.median(values):.1f} ms an image")


def opened(model: bytes) -> onnxruntime.InferenceSession:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


if __name__ == "__main__":
    main()
