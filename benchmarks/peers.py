"""How long does a decision take beside what one would otherwise use today?

    python benchmarks/peers.py --network doornet --repeat 20

A small detector and a depth network, one after the other on the same image, as they are, with
weights and activations of 8 bits, and by OpenVINO if it is installed, by turns with a network's
decision in one process: medians, and ratios with their 95 % intervals. Needs the extra `train`.

Both are built from published architecture figures, with random weights: only their timing means
anything. The detector is of YOLOv8n's shape (https://docs.ultralytics.com/models/yolov8: 3.2
million parameters, 640x640), the depth network of Depth Anything V2 small's (arXiv 2406.09414:
ViT-S/14 and a DPT head, 24.8 million parameters, 518x518).
"""

from __future__ import annotations

import argparse
import json
import logging
import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from datetime import datetime
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.images.codec import read_image
from doorway3ds.lab import benchmark
from doorway3ds.networks.adapter import squeeze
from doorway3ds.networks.session import Session, available_threads

DETECTOR_SIDE, DEPTH_SIDE = 640, 518
_STRIDES = ("stride8", "stride16", "stride32")
_PATCH, _WIDTH, _HEADS, _BLOCKS, _TAPS = 14, 384, 6, 12, (2, 5, 8, 11)


Run = Callable[[NDArray[np.float32]], object]


class Peers:
    """Both networks on one image, without the detector's suppression of doubles or a decision.

    name: of what they are run by. parts: what runs each, and the side of its input.
    """

    def __init__(self, name: str, parts: Sequence[tuple[Run, int]]) -> None:
        self.name, self._parts = name, parts

    def __call__(self, data: bytes) -> dict[str, float]:
        """Milliseconds by stage for an image file's bytes."""
        times = [time.perf_counter()]
        image = read_image(data).image
        times.append(time.perf_counter())
        inputs = [squeeze(image, side, side, channels_last=False) for _, side in self._parts]
        for value in inputs:
            value /= np.float32(255)
        times.append(time.perf_counter())
        for (run, _), value in zip(self._parts, inputs, strict=True):
            run(value)
        times.append(time.perf_counter())
        spent = np.diff(times) * 1e3
        return dict(zip(("decode", "prepare", "network"), spent.tolist(), strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--network", default="doornet")
    parser.add_argument("--image", type=Path, help="default: a made-up 640x480 JPEG")
    parser.add_argument("--repeat", type=int, default=20)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results"))
    given = parser.parse_args()
    data = benchmark.made_up_jpeg() if given.image is None else given.image.read_bytes()
    with tempfile.TemporaryDirectory() as folder:
        peers = make_peers(Path(folder), given.threads)
        own = benchmark.timed(benchmark.open_pipeline(given.network, given.threads))
        times = benchmark.by_turns([*peers, own], data, given.repeat)
    names = [*(one.name for one in peers), given.network]
    results = [{"name": name, **found} for name, found in zip(names, times, strict=True)]
    report = {
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "machine": benchmark.machine(given.threads),
        "repeat": given.repeat,
        "networks": results,
        "ratios": [benchmark.ratio(other, results[-1]) for other in results[:-1]],
    }
    for result in results:
        print(f"{result['name']}: {result['stages_ms']['total']['median']:.1f} ms")
    for found in report["ratios"]:
        low, high = found["interval"]
        print(f"{found['of'][0]} takes {found['total']:.1f} times as long ({low:.1f}..{high:.1f})")
    path = given.out / f"peers-{datetime.now():%Y-%m-%d-%H%M%S}.json"
    path.write_text(json.dumps(report, indent=2) + "\n")
    print(f"written to {path}")


def make_peers(folder: Path, threads: int | None = None) -> list[Peers]:
    """Both networks by ONNX Runtime, as they are and in 8 bits; by OpenVINO, too, if installed.

    folder: where their ONNX files are written. threads: as `Session` takes them.
    """
    ways: dict[str, list[tuple[Run, int]]] = {"": [], ", 8 bits": [], ", OpenVINO": []}
    for build, side, outputs in (
        (detector, DETECTOR_SIDE, _STRIDES),
        (partial(depth_network, DEPTH_SIDE), DEPTH_SIDE, ("depth",)),
    ):
        path = folder / f"{outputs[-1]}.onnx"
        write(build, side, outputs, path)
        for way, file in (("", path), (", 8 bits", _in_eight_bits(path, side))):
            session = Session(file, [(1, 3, side, side)], outputs, threads=threads)
            ways[way].append((session.run, side))
        if find_spec("openvino") is not None:
            ways[", OpenVINO"].append((_by_openvino(path, threads), side))
    return [Peers(f"detector+depth{way}", parts) for way, parts in ways.items() if parts]


def _in_eight_bits(path: Path, side: int) -> Path:
    """The network with weights and activations of 8 bits, their ranges from two images of noise."""
    from onnxruntime.quantization import CalibrationDataReader, quantize_static

    class Noise(CalibrationDataReader):  # type: ignore[misc]
        def __init__(self) -> None:
            rng = np.random.default_rng(0)
            images = rng.random((2, 1, 3, side, side), np.float32)
            self._left = iter([{"image": image} for image in images])

        def get_next(self) -> dict[str, NDArray[np.float32]] | None:
            return next(self._left, None)

    small = path.with_suffix(".int8.onnx")
    quiet = logging.getLogger().level
    logging.getLogger().setLevel(logging.ERROR)  # it advises to prepare the file first
    try:
        kinds = ["Conv", "MatMul"]
        quantize_static(path, small, Noise(), op_types_to_quantize=kinds, per_channel=True)
    finally:
        logging.getLogger().setLevel(quiet)
    return small


def _by_openvino(path: Path, threads: int | None) -> Run:
    import openvino

    settings = {
        "PERFORMANCE_HINT": "LATENCY",
        "INFERENCE_NUM_THREADS": threads or available_threads(),
        "INFERENCE_PRECISION_HINT": "f32",
    }
    run: Run = openvino.compile_model(path, "CPU", settings)
    return run


def write(build: Callable[[], Any], side: int, outputs: Sequence[str], path: Path) -> None:
    """A network with random weights, always the same; input "image" (1, 3, side, side)."""
    import torch

    with torch.random.fork_rng(devices=[]), torch.no_grad(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of sizes that tracing fixes: there is only this one
        torch.manual_seed(0)
        torch.onnx.export(
            build().eval(),
            (torch.rand(1, 3, side, side),),
            str(path),
            input_names=["image"],
            output_names=list(outputs),
            opset_version=17,
            dynamo=False,
        )


def detector(classes: int = 80, bins: int = 16) -> Any:
    """A torch module of YOLOv8n's shape: image to three maps (1, 4 * bins + classes, h, w).

    Batch norms count as taken into the convolutions before them, as exporters do.
    """
    import torch
    from torch import nn

    def conv(inside: int, outside: int, kernel: int = 3, stride: int = 1) -> Any:
        return nn.Sequential(nn.Conv2d(inside, outside, kernel, stride, kernel // 2), nn.SiLU())

    class Split(nn.Module):  # type: ignore[misc]
        """C2f: half of the channels pass `depth` bottlenecks, and every step is kept."""

        def __init__(self, inside: int, outside: int, depth: int, skip: bool) -> None:
            super().__init__()
            half = outside // 2
            self.first, self.skip = conv(inside, outside, 1), skip
            self.steps = nn.ModuleList(
                nn.Sequential(conv(half, half), conv(half, half)) for _ in range(depth)
            )
            self.last = conv(half * (2 + depth), outside, 1)

        def forward(self, x: Any) -> Any:
            kept = list(self.first(x).chunk(2, 1))
            for step in self.steps:
                kept.append(kept[-1] + step(kept[-1]) if self.skip else step(kept[-1]))
            return self.last(torch.cat(kept, 1))

    class Detector(nn.Module):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.p3 = nn.Sequential(
                *(conv(3, 16, 3, 2), conv(16, 32, 3, 2), Split(32, 32, 1, True)),
                *(conv(32, 64, 3, 2), Split(64, 64, 2, True)),
            )
            self.p4 = nn.Sequential(conv(64, 128, 3, 2), Split(128, 128, 2, True))
            self.p5 = nn.Sequential(conv(128, 256, 3, 2), Split(256, 256, 1, True))
            self.narrow, self.widen = conv(256, 128, 1), conv(512, 256, 1)
            self.pool, self.up = nn.MaxPool2d(5, 1, 2), nn.Upsample(scale_factor=2)
            self.up4, self.up3 = Split(384, 128, 1, False), Split(192, 64, 1, False)
            self.down4, self.down5 = conv(64, 64, 3, 2), conv(128, 128, 3, 2)
            self.out4, self.out5 = Split(192, 128, 1, False), Split(384, 256, 1, False)
            self.heads = nn.ModuleList(
                nn.Sequential(conv(inside, mid), conv(mid, mid), nn.Conv2d(mid, mid, 1))
                for inside in (64, 128, 256)
                for mid in (4 * bins, classes)
            )

        def forward(self, image: Any) -> Any:
            p3 = self.p3(image)
            p4 = self.p4(p3)
            pooled = [self.narrow(self.p5(p4))]
            for _ in range(3):
                pooled.append(self.pool(pooled[-1]))
            p5 = self.widen(torch.cat(pooled, 1))
            p4 = self.up4(torch.cat([self.up(p5), p4], 1))
            p3 = self.up3(torch.cat([self.up(p4), p3], 1))
            p4 = self.out4(torch.cat([self.down4(p3), p4], 1))
            p5 = self.out5(torch.cat([self.down5(p4), p5], 1))
            return tuple(
                torch.cat([self.heads[2 * i](x), self.heads[2 * i + 1](x)], 1)
                for i, x in enumerate((p3, p4, p5))
            )

    return Detector()


def depth_network(side: int, width: int = 64) -> Any:
    """A torch module of Depth Anything V2 small's shape: image to depth (1, side, side).

    side: of the image, a multiple of 14. width: channels of the DPT head.
    """
    import torch
    from torch import nn
    from torch.nn import functional

    cells = side // _PATCH
    levels = (48, 96, 192, 384)

    class Block(nn.Module):  # type: ignore[misc]
        """Attention and multilayer perceptron, as in every vision transformer."""

        def __init__(self) -> None:
            super().__init__()
            self.before, self.between = nn.LayerNorm(_WIDTH), nn.LayerNorm(_WIDTH)
            self.qkv, self.out = nn.Linear(_WIDTH, 3 * _WIDTH), nn.Linear(_WIDTH, _WIDTH)
            self.perceptron = nn.Sequential(
                nn.Linear(_WIDTH, 4 * _WIDTH), nn.GELU(), nn.Linear(4 * _WIDTH, _WIDTH)
            )

        def forward(self, x: Any) -> Any:
            size = (1, cells * cells + 1, 3, _HEADS, _WIDTH // _HEADS)
            q, k, v = self.qkv(self.before(x)).reshape(size).permute(2, 0, 3, 1, 4).unbind(0)
            seen = (q * (_WIDTH // _HEADS) ** -0.5 @ k.transpose(-2, -1)).softmax(-1) @ v
            x = x + self.out(seen.transpose(1, 2).reshape(1, -1, _WIDTH))
            return x + self.perceptron(self.between(x))

    def refine() -> Any:
        layers = [nn.ReLU(), nn.Conv2d(width, width, 3, 1, 1)]
        return nn.Sequential(*layers, nn.ReLU(), nn.Conv2d(width, width, 3, 1, 1))

    def grow(x: Any, size: Any) -> Any:
        return functional.interpolate(x, size, mode="bilinear", align_corners=True)

    class Depth(nn.Module):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.patches = nn.Conv2d(3, _WIDTH, _PATCH, _PATCH)
            self.own = nn.Parameter(torch.zeros(1, 1, _WIDTH))
            self.place = nn.Parameter(torch.zeros(1, cells * cells + 1, _WIDTH))
            self.blocks = nn.ModuleList(Block() for _ in range(_BLOCKS))
            self.norm = nn.LayerNorm(_WIDTH)
            self.project = nn.ModuleList(nn.Conv2d(_WIDTH, n, 1) for n in levels)
            self.scale = nn.ModuleList(
                [
                    nn.ConvTranspose2d(levels[0], levels[0], 4, 4),
                    nn.ConvTranspose2d(levels[1], levels[1], 2, 2),
                    nn.Identity(),
                    nn.Conv2d(levels[3], levels[3], 3, 2, 1),
                ]
            )
            self.same = nn.ModuleList(nn.Conv2d(n, width, 3, 1, 1, bias=False) for n in levels)
            self.join = nn.ModuleList(refine() for _ in levels[:-1])
            self.fuse = nn.ModuleList(refine() for _ in levels)
            self.mix = nn.ModuleList(nn.Conv2d(width, width, 1) for _ in levels)
            self.first = nn.Conv2d(width, width // 2, 3, 1, 1)
            self.last = nn.Sequential(
                *(nn.Conv2d(width // 2, 32, 3, 1, 1), nn.ReLU(), nn.Conv2d(32, 1, 1), nn.ReLU())
            )

        def forward(self, image: Any) -> Any:
            patches = self.patches(image).flatten(2).transpose(1, 2)
            x = torch.cat([self.own, patches], 1) + self.place
            maps: list[Any] = []
            for index, block in enumerate(self.blocks):
                x = block(x)
                if index in _TAPS:
                    level = len(maps)
                    cell = self.norm(x)[:, 1:].transpose(1, 2).reshape(1, _WIDTH, cells, cells)
                    maps.append(self.same[level](self.scale[level](self.project[level](cell))))
            y = maps[-1]
            for level in (3, 2, 1, 0):
                if level < 3:
                    y = y + maps[level] + self.join[level](maps[level])
                y = y + self.fuse[level](y)
                size = maps[level - 1].shape[2:] if level else (8 * cells, 8 * cells)
                y = self.mix[level](grow(y, size))
            return self.last(grow(self.first(y), (side, side)))[:, 0]

    return Depth()


if __name__ == "__main__":
    main()
