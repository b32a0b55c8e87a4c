"""Pseudo-labels from teacher networks given as ONNX files, and descriptors to find places with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.train.doornet.data.samples import UNKNOWN, Sample

# FastDepth was trained at about this focal length (NYU, 640 px shrunk to 304 and cropped)
_FASTDEPTH_F_PX = 250.0
# ADE20K's 31-class list -> SEGMENTS
_ADE20K_31 = {1: 1, 4: 2, 15: 3, 9: 4, 6: 5}


def _session(path: Path, outputs: list[str] | None = None) -> Any:
    import onnx
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    if outputs is None:
        return onnxruntime.InferenceSession(str(path), options)
    model = onnx.load(str(path))
    for name in outputs:
        model.graph.output.append(onnx.helper.make_tensor_value_info(name, 1, None))
    return onnxruntime.InferenceSession(model.SerializeToString(), options)


def add_depth(samples: list[Sample], fastdepth: Path, weight: float) -> list[Sample]:
    """Samples with pseudo-depth where they had none, in metres by their own focal length."""
    session = _session(fastdepth)
    name = session.get_inputs()[0].name
    size = 224

    def labelled(sample: Sample) -> Sample:
        if sample.depth_m is not None:
            return sample
        rows, columns = sample.image.shape[:2]
        # the teacher sees squares: the two halves of the image that overlap in the middle
        side = min(rows, columns)
        total = np.zeros((rows, columns), np.float32)
        count = np.zeros((rows, columns), np.float32)
        for share in (0.0, 0.5, 1.0):
            y, x = round((rows - side) * share), round((columns - side) * share)
            window = sample.image[y : y + side, x : x + side]
            small = cv2.resize(window, (size, size), interpolation=cv2.INTER_AREA)
            tensor = small.transpose(2, 0, 1)[None].astype(np.float32) / 255
            depth = session.run(None, {name: tensor})[0][0, 0]
            depth *= sample.camera[0] * size / side / _FASTDEPTH_F_PX
            total[y : y + side, x : x + side] += cv2.resize(depth, (side, side))
            count[y : y + side, x : x + side] += 1
        return replace(sample, depth_m=total / count, depth_weight=weight)

    return [labelled(sample) for sample in samples]


def add_segments(
    samples: list[Sample], deeplab: Path, weight: float, sure: float = 0.7
) -> list[Sample]:
    """Samples with pseudo-segments where they had none; unsure pixels stay unknown."""
    session = _session(deeplab)
    name = session.get_inputs()[0].name
    table = np.zeros(64, np.uint8)
    for source, target in _ADE20K_31.items():
        table[source] = target

    def labelled(sample: Sample) -> Sample:
        if sample.segments is not None:
            return sample
        rows, columns = sample.image.shape[:2]
        # letterboxed to the teacher's square, so that shapes keep their aspect
        side = max(rows, columns)
        scale = 512 / side
        size = (round(columns * scale), round(rows * scale))
        canvas = np.full((512, 512, 3), 127, np.uint8)
        canvas[: size[1], : size[0]] = cv2.resize(sample.image, size)
        tensor = canvas.transpose(2, 0, 1)[None].astype(np.float32) / 127.5 - 1
        logits = session.run(None, {name: tensor})[0][0, :, : size[1] : 2, : size[0] : 2]
        odds = np.exp(logits - logits.max(axis=0))
        odds /= odds.sum(axis=0)
        labels = np.where(odds.max(axis=0) > sure, table[odds.argmax(axis=0)], UNKNOWN)
        labels = cv2.resize(
            labels.astype(np.uint8), (columns, rows), interpolation=cv2.INTER_NEAREST
        )
        return replace(sample, segments=labels, segment_weight=weight)

    return [labelled(sample) for sample in samples]


def describe(samples: list[Sample], mobilenet: Path) -> NDArray[np.float32]:
    """(N, 2, D) ImageNet features of each image and of its mirror image, grey."""
    session = _session(mobilenet, outputs=["t172"])
    name = session.get_inputs()[0].name

    def features(image: NDArray[np.uint8]) -> NDArray[np.float32]:
        grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
        small = cv2.resize(grey, (224, 224), interpolation=cv2.INTER_AREA)
        tensor = small.transpose(2, 0, 1)[None].astype(np.float32) / 127.5 - 1
        return np.asarray(session.run(["t172"], {name: tensor})[0]).ravel()

    views: list[Callable[[Any], Any]] = [lambda x: x, lambda x: np.ascontiguousarray(x[:, ::-1])]
    return np.stack([[features(look(s.image)) for look in views] for s in samples])
