"""Ask methods and networks for their answers to the samples of a data set."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.decide.gates import Gates, decide
from doorway3ds.decide.opening import OpeningParams, select_opening
from doorway3ds.decide.paper import select_paper
from doorway3ds.decide.scene.metres import in_metres
from doorway3ds.errors import CallError, UserError
from doorway3ds.lab.datasets.samples import (
    Sample,
    kinds_shown,
    load_depth,
    load_frame,
    load_labels,
)
from doorway3ds.lab.datasets.truth import PictureTruth, picture_truth
from doorway3ds.lab.evaluate import depth as depth_scores
from doorway3ds.lab.evaluate import kinds as kind_scores
from doorway3ds.lab.evaluate.classifier import ClassifierRecord
from doorway3ds.lab.evaluate.depth import DepthRecord
from doorway3ds.lab.evaluate.direction import DirectionRecord, record_from_json
from doorway3ds.lab.evaluate.stored import Label, by_name_end
from doorway3ds.networks.base import Network as BaseNetwork
from doorway3ds.networks.base import thresholds_of
from doorway3ds.networks.limits import override
from doorway3ds.types import Decision, Frame, Perception, Selection

Read = TypeVar("Read")
Column = TypeVar("Column")
Record = TypeVar("Record")
DepthCase = tuple[Sample, NDArray[np.float32], DepthRecord]
# `networks.Network`, or any function of an image and its camera
Network = Callable[[NDArray[np.uint8], Camera], Perception]


# from a frame and its true depth (None where there is none) to a decision per column of the table
Answer = Callable[[Frame, NDArray[np.float32] | None], Mapping[Label, Decision]]


@dataclass
class Runs(Generic[Column, Record]):
    """Records of several columns of a table over the same images.

    answers: the JSON objects that go with the records of directions. worst: by network, the
    images of lowest delta1 with their maps. left_out: why an image is missing, by name.
    """

    records: dict[Column, list[Record]] = field(default_factory=dict)
    answers: dict[Column, list[dict[str, Any]]] = field(default_factory=dict)
    worst: dict[str, list[DepthCase]] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)

    def put(self, column: Column, record: Record, answer: dict[str, Any] | None = None) -> None:
        self.records.setdefault(column, []).append(record)
        if answer is not None:
            self.answers.setdefault(column, []).append(answer)

    def add(self, more: Runs[Column, Record]) -> None:
        """Further images, or further columns, of the same data set."""
        for column, records in more.records.items():
            self.records.setdefault(column, []).extend(records)
        for column, answers in more.answers.items():
            self.answers.setdefault(column, []).extend(answers)
        for name, cases in more.worst.items():
            self.worst[name] = sorted([*self.worst.get(name, ()), *cases], key=_delta1)
        self.left_out |= more.left_out

    def some(self) -> Runs[Column, Record]:
        """The same; UserError if no image is left."""
        if not self.records:
            why = next(iter(self.left_out.values()), "the selection holds none")
            raise UserError(f"no image is left to score: {why}")
        return self


DirectionRuns = Runs[Label, DirectionRecord]


def run_direction(
    samples: Iterable[Sample],
    answer: Answer,
    p_open_known: bool = True,
) -> DirectionRuns:
    """Answers to every sample; an image that cannot be read is left out, and named.

    p_open_known False (the gate was held open) keeps p_open out of the score. Raises UserError
    where no image could be read.
    """

    def answers(sample: Sample, known: _Known) -> dict[Label, dict[str, Any]]:
        found = answer(known.frame, known.depth_m)
        return {
            label: answer_json(sample.name, sample.place, label, decision)
            for label, decision in found.items()
        }

    runs = _direction_runs(samples, _known, answers)
    if not p_open_known:
        for label, records in runs.records.items():
            runs.records[label] = [replace(record, p_open=math.nan) for record in records]
    return runs


def answer_json(name: str, place: str, label: Label, decision: Decision) -> dict[str, Any]:
    """`Decision.to_dict` with what evaluation needs beside it; `record_from_json` reads it."""
    selection = decision.selection
    return {
        **decision.to_dict(name),
        "place": place,
        "method": label.method,
        "network": label.network,
        "selection": {
            "bearing_deg": selection.bearing_deg,
            "range_m": selection.range_m,
            "clear": selection.clear,
        },
    }


def methods_on(
    network: BaseNetwork | None,
    name: str,
    methods: Sequence[str],
    truth_depth: bool = False,
    open_gate: bool = False,
    params: OpeningParams | None = None,
    gates: Gates | None = None,
) -> Answer:
    """An `answer` for run_direction: several methods on one pass of one network.

    network None: nothing but true depth is known, and the gate is open. truth_depth: depth is
    the true one; columns, floor and p_open stay the network's. open_gate: every image counts
    as holding a doorway (p_open 1), which shows the selection without the classifier. params,
    gates: limits; default: as `pipeline.Pipeline` has them.
    """
    if params is None:
        limits = {} if network is None else thresholds_of(network)
        params = override(OpeningParams(), limits)
    select: dict[str, Callable[[Perception, Frame], Selection]] = {
        "opening": lambda seen, frame: select_opening(seen, frame, params),
        "paper": select_paper,
    }
    for method in methods:
        if method not in select:
            raise CallError(f"expected methods of {', '.join(select)}, got '{method}'")
    if network is None and "opening" in methods:
        raise CallError(
            "the opening method needs a network's opening columns; give --network, or only "
            "--method paper"
        )
    label = name + (" + true depth" if truth_depth and network is not None else "")

    def answer(frame: Frame, depth_m: NDArray[np.float32] | None) -> dict[Label, Decision]:
        seen = Perception(p_open=1.0) if network is None else network(frame.image, frame.camera)
        if truth_depth or network is None:
            if depth_m is None:
                raise UserError("true depth is asked for and an image has none")
            seen = replace(seen, depth_m=depth_m, depth_error=0.0, relative=None)
        seen = in_metres(seen, frame)
        if open_gate:
            seen = replace(seen, p_open=1.0)
        return {
            Label(method, label): decide(seen, select[method](seen, frame), frame, method, gates)
            for method in methods
        }

    return answer


def match_answers(
    samples: Iterable[Sample], stored: Mapping[Label, Mapping[str, dict[str, Any]]]
) -> DirectionRuns:
    """Records of stored answers, of the images that every column answers."""
    by_end = {label: by_name_end(answers) for label, answers in stored.items()}

    def read(sample: Sample) -> _Known:
        if not all(sample.name in ends for ends in by_end.values()):
            raise UserError("a column of the table has no stored answer for it")
        return _known(sample)

    def answers(sample: Sample, _: _Known) -> dict[Label, dict[str, Any]]:
        return {label: ends[sample.name] for label, ends in by_end.items()}

    return _direction_runs(samples, read, answers)


def _direction_runs(
    samples: Iterable[Sample],
    read: Callable[[Sample], _Known],
    answers: Callable[[Sample, _Known], Mapping[Label, dict[str, Any]]],
) -> DirectionRuns:
    runs: DirectionRuns = Runs()
    for sample, known in _readable(samples, read, runs.left_out):
        for label, answer in answers(sample, known).items():
            try:
                record = record_from_json(known.truth, answer)
                record = replace(record, lies_on=_lies_on(known, answer))
            except (KeyError, TypeError, ValueError) as error:
                raise UserError(
                    f"the stored answer of {label} to {sample.name} lacks or spoils {error}"
                ) from error
            runs.put(label, record, answer)
    return runs.some()


def run_classifier(
    samples: Iterable[Sample], networks: Mapping[str, Network]
) -> Runs[str, ClassifierRecord]:
    """Each network's records; half-open images are left out."""
    runs: Runs[str, ClassifierRecord] = Runs()

    def read(sample: Sample) -> tuple[bool, Frame, tuple[str, ...]]:
        if sample.is_open is None:
            raise UserError("half open: neither class")
        kinds = () if sample.is_open else kinds_shown(sample, load_labels(sample))
        return sample.is_open, load_frame(sample), kinds

    for sample, (is_open, frame, kinds) in _readable(samples, read, runs.left_out):
        for name, network in networks.items():
            p_open = float(network(frame.image, frame.camera).p_open)
            runs.put(name, ClassifierRecord(sample.name, sample.place, is_open, p_open, kinds))
    return runs.some()


@dataclass(frozen=True)
class Protocol:
    """How a depth map is compared: which pixels, and whether two mirrorings are averaged."""

    network: str
    crop: str  # "eigen" or "whole"
    mirrored: bool

    def __str__(self) -> str:
        return f"{self.network}, {self.crop}, {'mirrored average' if self.mirrored else 'one pass'}"


def run_depth(
    samples: Iterable[Sample], networks: Mapping[str, Network], mirror: bool, worst: int = 0
) -> Runs[Protocol, DepthRecord]:
    """Each network's records under each protocol that the samples allow.

    worst: how many images of lowest delta1, whole and in one pass, are kept with their maps.
    """
    runs: Runs[Protocol, DepthRecord] = Runs()

    def read(sample: Sample) -> tuple[Frame, NDArray[np.float32]]:
        truth = load_depth(sample)
        if truth is None:
            raise UserError("no true depth")
        return load_frame(sample), truth

    for sample, (frame, truth) in _readable(samples, read, runs.left_out):
        boxes: dict[str, tuple[int, int, int, int] | None] = {"whole": None}
        if sample.eigen_box is not None:
            boxes["eigen"] = sample.eigen_box
        for name, network in networks.items():
            for mirrored, depth_m in predicted_depth(name, network, frame, mirror):
                for crop, box in boxes.items():
                    record = depth_scores.compare(sample.name, sample.place, depth_m, truth, box)
                    runs.put(Protocol(name, crop, mirrored), record)
                    if crop == "whole" and not mirrored and record.errors.pixels:
                        cases = [*runs.worst.get(name, ()), (sample, depth_m, record)]
                        runs.worst[name] = sorted(cases, key=_delta1)[:worst]
    return runs.some()


def _delta1(case: DepthCase) -> float:
    return case[2].errors.delta1


def predicted_depth(
    name: str, network: Network, frame: Frame, mirror: bool
) -> Iterator[tuple[bool, NDArray[np.float32]]]:
    """(False, map) and, with `mirror`, (True, average of both mirrorings)."""

    def depth_of(frame: Frame) -> NDArray[np.float32]:
        depth_m = in_metres(network(frame.image, frame.camera), frame).depth_m
        if depth_m is None:
            raise UserError(f"network '{name}' returns no depth")
        return depth_m

    plain = depth_of(frame)
    yield False, plain
    if mirror:
        image = np.ascontiguousarray(frame.image[:, ::-1])
        flipped = replace(
            frame, image=image, camera=frame.camera.mirrored(), pose=frame.pose.mirrored()
        )
        yield True, depth_scores.average_with_mirrored(plain, depth_of(flipped))


def _readable(
    samples: Iterable[Sample], read: Callable[[Sample], Read], left_out: dict[str, str]
) -> Iterator[tuple[Sample, Read]]:
    """Each sample with what is read of it; what cannot be read is named in `left_out`."""
    for sample in samples:
        try:
            found = read(sample)
        except UserError as error:
            left_out[sample.name] = str(error)
        else:
            yield sample, found


@dataclass(frozen=True)
class _Known:
    """A sample's files, read. labels: only where there is no doorway."""

    frame: Frame
    depth_m: NDArray[np.float32] | None
    truth: PictureTruth
    labels: NDArray[np.uint8] | None


def _known(sample: Sample) -> _Known:
    frame, depth_m = load_frame(sample), load_depth(sample)
    truth = picture_truth(sample, frame, depth_m)
    if sample.is_open is not False:
        return _Known(frame, depth_m, truth, None)
    labels = load_labels(sample)
    return _Known(frame, depth_m, replace(truth, kinds=kinds_shown(sample, labels)), labels)


def _lies_on(known: _Known, answer: Mapping[str, Any]) -> str | None:
    """The kind under the best candidate of an answer as `answer_json` gives it."""
    if known.labels is None:
        return None
    span = kind_scores.candidate_deg(answer)
    return "" if span is None else kind_scores.kind_under(known.labels, known.frame, *span)
