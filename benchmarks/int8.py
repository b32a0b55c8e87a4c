"""What do 8-bit integers save doornet, and what do they cost?

    python benchmarks/int8.py runs/held/doornet.onnx nyu --folds 5 --held 2 3 --out int8.onnx

Quantises a network's convolutions statically (ONNX Runtime, QDQ, a scale for each output channel),
with the ranges of --count images of DATASET that lie in none of the held folds, and times it and
the network as it is by turns in one process: the median of each, the median of the ratios, and the
sizes. Needs the extra `train`. What it costs in accuracy tells `3ds eval` of both files, on the
held folds.

--keep leaves parts as they are: names of nodes that contain it.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from datetime import datetime
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import onnxslim
from numpy.typing import NDArray
from onnxruntime.quantization import (
    CalibrationDataReader,
    CalibrationMethod,
    QuantFormat,
    QuantType,
    quantize_static,
)

from doorway3ds.files import digest
from doorway3ds.lab.benchmark import machine
from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.datasets.samples import load_frame, place_folds
from doorway3ds.networks.doornet import place, prepare

METHODS = {
    "minmax": CalibrationMethod.MinMax,
    "entropy": CalibrationMethod.Entropy,
    "percentile": CalibrationMethod.Percentile,
}


class Pictures(CalibrationDataReader):  # type: ignore[misc]
    """Prepared images, one after the other."""

    def __init__(self, pictures: list[NDArray[np.float32]]) -> None:
        self._left = iter(pictures)

    def get_next(self) -> dict[str, NDArray[np.float32]] | None:
        picture = next(self._left, None)
        return None if picture is None else {"image": picture}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("network", type=Path)
    parser.add_argument("dataset", type=Path, help="as `3ds eval direction` takes it")
    parser.add_argument("--folds", type=int, default=5)
    parser.add_argument("--held", type=int, nargs="*", default=[], help="folds, from 1 on")
    parser.add_argument("--count", type=int, default=120, help="images that ranges come from")
    parser.add_argument("--ranges", choices=sorted(METHODS), default="minmax")
    parser.add_argument("--keep", nargs="*", default=[], help="parts that stay floats")
    parser.add_argument("--repeat", type=int, default=200)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True, help="the int8 network")
    given = parser.parse_args()
    pictures = training_pictures(given.dataset, given.folds, given.held, given.count)
    quantise(given.network, given.out, pictures, METHODS[given.ranges], given.keep)
    times = side_by_side(
        [given.network, given.out], pictures[0], given.threads, max(given.repeat, 10)
    )
    print(
        json.dumps(
            {
                "date": datetime.now().astimezone().isoformat(timespec="seconds"),
                "machine": machine(given.threads),
                "as_it_is_ms": round(float(np.median(times[:, 0])), 2),
                "int8_ms": round(float(np.median(times[:, 1])), 2),
                "ratio": round(float(np.median(times[:, 0] / times[:, 1])), 3),
                "bytes": [path.stat().st_size for path in (given.network, given.out)],
            },
            indent=1,
        )
    )


def training_pictures(
    folder: Path, folds: int, held: list[int], count: int
) -> list[NDArray[np.float32]]:
    """Inputs of the network from places that are not held out, spread over the data set."""
    samples = read_dataset(folder).samples
    fold = place_folds((sample.place for sample in samples), folds)
    own = [sample for sample in samples if fold[sample.place] + 1 not in held]
    frames = [load_frame(sample).image for sample in own[:: max(1, len(own) // count)][:count]]
    return [prepare(image, place(image.shape[1], image.shape[0])) for image in frames]


def quantise(
    network: Path,
    out: Path,
    pictures: list[NDArray[np.float32]],
    method: CalibrationMethod,
    keep: list[str],
) -> None:
    """Writes the network with 8-bit convolutions, and a card beside it if there was one."""
    graph = onnxslim.slim(in_floats(onnx.load(network)))
    for index, node in enumerate(graph.graph.node):
        node.name = f"{node.output[0]}#{index}"
    left = [node.name for node in graph.graph.node if any(part in node.name for part in keep)]
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / "plain.onnx"
        onnx.save(graph, plain)
        quantize_static(
            plain,
            out,
            Pictures(pictures),
            quant_format=QuantFormat.QDQ,
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            op_types_to_quantize=["Conv"],
            nodes_to_exclude=left,
            calibrate_method=method,
        )
    made = onnx.load(out)
    del made.metadata_props[:]
    made.metadata_props.extend(graph.metadata_props)
    onnx.save(made, out)
    card = network.with_suffix(".json")
    if card.is_file():
        told = json.loads(card.read_text(encoding="utf-8")) | {"sha256": digest(out)}
        out.with_suffix(".json").write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


def in_floats(model: onnx.ModelProto) -> onnx.ModelProto:
    """The network with its weights as 32-bit constants, which quantising looks for."""
    weights = {item.name: item for item in model.graph.initializer}
    for node in list(model.graph.node):
        if node.op_type == "Cast" and node.input[0] in weights:
            item = weights[node.input[0]]
            wide = onnx.numpy_helper.to_array(item).astype(np.float32)
            item.CopyFrom(onnx.numpy_helper.from_array(wide, node.output[0]))
            model.graph.node.remove(node)
    return model


def side_by_side(
    paths: list[Path], picture: NDArray[np.float32], threads: int, repeat: int
) -> NDArray[np.float64]:
    """(repeat, 2) milliseconds of processor time, turns taken."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    sessions = [
        onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        for path in paths
    ]
    times = np.zeros((repeat, len(sessions)))
    for row in times:
        for column, session in enumerate(sessions):
            begin = time.process_time()
            session.run(None, {"image": picture})
            row[column] = (time.process_time() - begin) * 1e3
    return times


if __name__ == "__main__":
    main()
