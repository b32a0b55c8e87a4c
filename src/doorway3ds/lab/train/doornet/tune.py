"""Operating points of the `opening` method for one network, chosen on held-out images.

Three are chosen by bounds on the two ways to go wrong, going where there is no doorway and going
when the way is blocked: as many goes on clear ways as they leave, over all sets together. What is
chosen here must not be reported on the same images: a training's half-1.onnx and half-2.onnx,
each for one half of the held-out places, take limits chosen on the other half.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from doorway3ds.decide.gates import Gates, decide
from doorway3ds.decide.opening import OpeningParams, select_opening
from doorway3ds.errors import UserError
from doorway3ds.files import digest, write_json
from doorway3ds.lab.datasets.samples import load_depth, load_frame
from doorway3ds.lab.datasets.truth import PictureTruth, picture_truth
from doorway3ds.lab.evaluate import direction
from doorway3ds.lab.evaluate.direction import DirectionMetrics, DirectionRecord
from doorway3ds.lab.evaluate.overview import HeldSet, held_sets, read_held
from doorway3ds.lab.evaluate.runners import answer_json
from doorway3ds.lab.evaluate.stored import Label
from doorway3ds.lab.train.doornet.export import set_metadata
from doorway3ds.lab.train.doornet.run import read_calibration
from doorway3ds.networks.base import Network
from doorway3ds.networks.doornet import DoorNet
from doorway3ds.networks.limits import override
from doorway3ds.types import Frame, Perception, Reason

_LABEL = Label("opening", "doornet")
MIN_SCORE = 0.02  # candidates are listed from here on; whether to go is told by the others

# Of `ClearanceParams`: the vote below which a way is blocked where the depth sees nothing in it,
# from bold to careful. One ladder, as blocked ways are few: limits that are free to vary one by one
# fit these images and no others.
LADDER = (0.3, 0.4, 0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9)
SURE_SCORE = 0.15
RATES = ("go_without_door", "go_when_blocked", "go_when_clear")


@dataclass(frozen=True)
class Goal:
    """Most goes on a clear way, within bounds on the two ways to go wrong.

    open_from: candidates of the p_open from which on a doorway is open.
    slack: what a bolder rung must be better by to be preferred. Blocked ways are few, and among
        rungs that they cannot tell apart the most careful is the safe one.
    """

    without_door: float
    when_blocked: float
    open_from: tuple[float, ...] = (0.5,)
    slack: float = 0.02

    def value(self, metrics: DirectionMetrics) -> float:
        """Larger is better; an excess over a bound costs four times its size."""
        rates = (metrics[name].value for name in RATES)
        none, blocked, clear = (0.0 if math.isnan(rate) else rate for rate in rates)
        excess = max(0.0, blocked - self.when_blocked) + max(0.0, none - self.without_door)
        # a little for staying below the bounds, so that ties go to the safer limits
        return clear - 4 * excess - 0.2 * (blocked + none)


# `balanced` is what the file does when nothing is chosen, so its gate is the default one
GOALS = {
    "cautious": Goal(0.015, 0.06, (0.6, 0.7, 0.8)),
    "balanced": Goal(0.04, 0.12),
    "eager": Goal(0.08, 0.22, (0.3, 0.4, 0.5), slack=0.0),
}


@dataclass
class Tuning:
    """Perceptions of held-out images, kept so that limits can be tried in milliseconds."""

    seen: list[tuple[Frame, Perception, PictureTruth]] = field(default_factory=list)
    # by limits and image: once the gate is open, the answer does not depend on it
    _opened: dict[str, dict[int, DirectionRecord]] = field(default_factory=dict)

    @classmethod
    def look(cls, network: Network, parts: Sequence[HeldSet]) -> Tuning:
        """Runs the network once on every image of these sets."""
        tuning = cls()
        for sample in (sample for part in parts for sample in part.samples):
            frame = load_frame(sample)
            truth = picture_truth(sample, frame, load_depth(sample))
            tuning.seen.append((frame, network(frame.image, frame.camera), truth))
        return tuning

    def bearing_error_deg(self, point: Mapping[str, Any]) -> float | None:
        """68th percentile of how far off the bearings are that are told at this point, on images
        of known cameras; None without any."""
        told = [
            abs(direction.judge(record).error_deg)
            for (frame, _, _), record in zip(self.seen, self.records(point), strict=True)
            if not frame.camera.assumed and record.reason != Reason.NO_DOOR
        ]
        known = [error for error in told if math.isfinite(error)]
        return round(float(np.quantile(known, 0.68)), 1) if known else None

    def records(self, point: Mapping[str, Any]) -> list[DirectionRecord]:
        """Whether to go at this point; what lies behind a closed gate is not looked at."""
        gates = Gates(open_from=point["open_from"])
        params = override(OpeningParams(), point["limits"])
        kept = self._opened.setdefault(json.dumps(point["limits"]), {})
        found = []
        for index, (frame, perception, truth) in enumerate(self.seen):
            if perception.p_open < gates.open_from:
                shut = Reason.NO_DOOR.value
                found.append(DirectionRecord(truth, (), shut, perception.p_open, None))
                continue
            if index not in kept:
                selection = select_opening(perception, frame, params)
                answer = decide(perception, selection, frame, "opening", gates)
                told = answer_json(truth.image, truth.place, _LABEL, answer)
                kept[index] = direction.record_from_json(truth, told)
            found.append(kept[index])
        return found


def preset(open_from: float, vote: float) -> dict[str, Any]:
    """An operating point as the file's metadata holds it.

    vote: a rung of the ladder. Alone, or against what the depth calls an obstacle, a vote may
        leave half as much doubt.
    """
    sure = (1 + vote) / 2
    votes = {"vote_blocks": vote, "vote_alone": sure, "vote_frees": sure}
    limits = {"min_score": MIN_SCORE, "sure_score": SURE_SCORE, "clearance": votes}
    return {"open_from": open_from, "limits": limits}


def tune(
    tuning: Tuning, goal: Goal, tell: Callable[[str], None] = lambda line: None
) -> dict[str, Any]:
    """The point of the goal's gates and the ladder at which the goal's value is highest.

    Of the rungs that come within the goal's slack of the best one, the most careful.
    """
    best, most = {}, -math.inf
    for open_from in goal.open_from:
        points = [preset(open_from, rung) for rung in LADDER]
        scores = [direction.score(tuning.records(point), repeats=0) for point in points]
        values = [goal.value(score) for score in scores]
        if max(values) > most:
            most = max(values)
            best = [p for p, v in zip(points, values, strict=True) if v >= most - goal.slack][-1]
        tell(f"p_open from {open_from:g} on: {most:.3f}")
    return best


def tune_run(
    folder: Path, datasets: Sequence[Path], tell: Callable[[str], None]
) -> dict[str, dict[str, Any]]:
    """Presets of folder/doornet.onnx by its held-out images, written into it and its card.

    Raises UserError if the training kept no places to itself.
    """
    network_file, card_file = folder / "doornet.onnx", folder / "doornet.json"
    read_calibration(card_file)  # refuses what is no card
    card = json.loads(card_file.read_text(encoding="utf-8"))
    if not card["held_out"]:
        raise UserError(
            f"{network_file} was trained with nothing held out; its limits must be chosen on "
            "images that it has not seen: train with --hold-out K/N"
        )
    parts = held_sets(datasets, read_held(folder / "held-out.csv"))
    parts = [part for part in parts if part.whole and not part.rough]
    told = _choose(network_file, parts, tell)
    card |= told | {"sha256": digest(network_file)}
    for half in (1, 2):
        other = [part.half(3 - half) for part in parts]
        _choose(folder / f"half-{half}.onnx", [part for part in other if part.samples], tell)
    write_json(card_file, card, 2)
    presets: dict[str, dict[str, Any]] = told["presets"]
    return presets


def _choose(
    network_file: Path, parts: Sequence[HeldSet], tell: Callable[[str], None]
) -> dict[str, Any]:
    """Presets chosen on these images, written into the file: its new metadata."""
    tuning = Tuning.look(DoorNet(network_file), parts)
    presets = {}
    for name, goal in GOALS.items():
        tell(f"{network_file.name}, {name}")
        presets[name] = tune(tuning, goal, tell)
    told = {
        "thresholds": presets["balanced"]["limits"],
        "presets": presets,
        "bearing_error_deg": tuning.bearing_error_deg(presets["balanced"]),
    }
    set_metadata(network_file, told)
    return told
