"""Operating points of the `opening` method for one network, chosen on held-out pictures.

Three are chosen by bounds on the two ways to go wrong, going where there is no doorway and going
when the way is blocked: as many goes on clear ways as they leave. Every set of pictures counts
alike. What is chosen here must not be reported on the same pictures: a training's half-1.onnx and
half-2.onnx, each for one half of the held-out places, take limits chosen on the other half.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from doorway3ds.decide.gates import Gates, decide
from doorway3ds.decide.opening import OpeningParams, select_opening
from doorway3ds.errors import UserError
from doorway3ds.files import write_bytes
from doorway3ds.lab.datasets.samples import load_depth, load_frame
from doorway3ds.lab.datasets.truth import PictureTruth, picture_truth
from doorway3ds.lab.evaluate import direction
from doorway3ds.lab.evaluate.direction import DirectionMetrics, DirectionRecord
from doorway3ds.lab.evaluate.overview import HeldSet, held_sets, read_held
from doorway3ds.lab.train.doornet.export import set_metadata
from doorway3ds.lab.train.doornet.run import read_calibration
from doorway3ds.networks.base import Network
from doorway3ds.networks.doornet import DoorNet
from doorway3ds.networks.limits import override
from doorway3ds.networks.session import digest
from doorway3ds.types import Frame, Perception, Reason

OPEN_FROM = "open_from"  # of the gates; the others are limits of the opening method
MIN_SCORE = 0.02  # candidates are listed from here on; whether to go is told by the others

# Each limit's candidates; a dotted name lies in a nested group.
GRID: dict[str, tuple[float, ...]] = {
    "sure_score": (0.1, 0.15, 0.2, 0.25, 0.3, 0.4),
    "clearance.vote_alone": (0.4, 0.5, 0.6, 0.7),
    "clearance.vote_blocks": (0.0, 0.3, 0.4, 0.5, 0.6),
    # never below 0.5: what the depth shows in the way is not argued away by less than a chance
    "clearance.vote_frees": (0.5, 0.6, 0.7, 0.85, 1.1),
}
RATES = ("go_without_door", "go_when_blocked", "go_when_clear")


@dataclass(frozen=True)
class Goal:
    """Most goes on a clear way, within bounds on the two ways to go wrong.

    open_from: candidates of the p_open from which on a doorway is open.
    """

    without_door: float
    when_blocked: float
    open_from: tuple[float, ...] = (0.5,)

    def value(self, metrics: DirectionMetrics) -> float:
        """Larger is better; an excess over a bound costs four times its size."""
        none, blocked, clear = (_known(metrics[name].value) for name in RATES)
        excess = max(0.0, blocked - self.when_blocked) + max(0.0, none - self.without_door)
        # a little for staying below the bounds, so that ties go to the safer limits
        return clear - 4 * excess - 0.2 * (blocked + none)


# `balanced` is what the file does when nothing is chosen, so its gate is the default one
GOALS = {
    "cautious": Goal(0.01, 0.05, (0.5, 0.55, 0.6, 0.65, 0.7, 0.8)),
    "balanced": Goal(0.03, 0.12),
    "eager": Goal(0.08, 0.25, (0.3, 0.35, 0.4, 0.45, 0.5)),
}


def _known(value: float) -> float:
    return 0.0 if value != value else value


@dataclass
class Tuning:
    """Perceptions of held-out pictures, kept so that limits can be tried in milliseconds."""

    seen: list[tuple[Frame, Perception, PictureTruth]] = field(default_factory=list)

    @classmethod
    def look(cls, network: Network, part: HeldSet) -> Tuning:
        """Runs the network once on every picture."""
        tuning = cls()
        for sample in part.samples:
            frame = load_frame(sample)
            truth = picture_truth(sample, frame, load_depth(sample))
            tuning.seen.append((frame, network(frame.image, frame.camera), truth))
        return tuning

    def records(self, limits: Mapping[str, float]) -> list[DirectionRecord]:
        """Whether to go under these limits; what lies behind a closed gate is not looked at."""
        params, gates = at(limits)
        found = []
        for frame, perception, truth in self.seen:
            if perception.p_open < gates.open_from:
                shut = Reason.NO_DOOR.value
                found.append(DirectionRecord(truth, (), shut, perception.p_open, None))
                continue
            selection = select_opening(perception, frame, params)
            answer = decide(perception, selection, frame, "opening", gates)
            found.append(direction.record_from_decision(truth, answer))
        return found


def at(limits: Mapping[str, float]) -> tuple[OpeningParams, Gates]:
    """Limits by dotted name as the runtime takes them."""
    rest = {name: value for name, value in limits.items() if name != OPEN_FROM}
    params = override(OpeningParams(min_score=MIN_SCORE), nested(rest))
    return params, Gates(open_from=limits.get(OPEN_FROM, Gates.open_from))


def nested(limits: Mapping[str, float]) -> dict[str, Any]:
    """Dotted names to nested mappings, as `limits.override` and a network's metadata take them."""
    found: dict[str, Any] = {}
    for name, value in limits.items():
        *groups, last = name.split(".")
        place = found
        for group in groups:
            place = place.setdefault(group, {})
        place[last] = value
    return found


def tune(
    parts: Sequence[Tuning],
    goal: Goal,
    grid: Mapping[str, tuple[float, ...]] = GRID,
    rounds: int = 2,
    tell: Callable[[str], None] = lambda line: None,
) -> dict[str, float]:
    """Coordinate search over the grid from the defaults: limits by dotted name."""
    grid = {OPEN_FROM: goal.open_from, **grid}

    def reached(limits: Mapping[str, float]) -> float:
        scores = (direction.score(part.records(limits), repeats=0) for part in parts)
        return sum(goal.value(score) for score in scores) / len(parts)

    best: dict[str, float] = {OPEN_FROM: goal.open_from[0]}
    value = reached(best)
    for _ in range(rounds):
        before = value
        for name, candidates in grid.items():
            for candidate in candidates:
                trial = {**best, name: candidate}
                if trial != best and (tried := reached(trial)) > value + 1e-9:
                    best, value = trial, tried
            tell(f"{name}: {best.get(name, 'default')} -> {value:.3f}")
        if value <= before + 1e-9:
            break
    return best


def preset(limits: Mapping[str, float]) -> dict[str, Any]:
    """An operating point as the file's metadata holds it."""
    rest = {"min_score": MIN_SCORE, **{k: v for k, v in limits.items() if k != OPEN_FROM}}
    return {OPEN_FROM: limits[OPEN_FROM], "limits": nested(rest)}


def tune_run(
    folder: Path, datasets: Sequence[Path], tell: Callable[[str], None]
) -> dict[str, dict[str, Any]]:
    """Presets of folder/doornet.onnx by its held-out pictures, written into it and its card.

    Raises UserError if the training kept no places to itself.
    """
    network_file, card_file = folder / "doornet.onnx", folder / "doornet.json"
    read_calibration(card_file)  # refuses what is no card
    card = json.loads(card_file.read_text(encoding="utf-8"))
    if not card["held_out"]:
        raise UserError(
            f"{network_file} was trained with nothing held out; its limits must be chosen on "
            "pictures that it has not seen: train with --hold-out K/N"
        )
    parts = held_sets(datasets, read_held(folder / "held-out.csv"))
    parts = [part for part in parts if part.whole and not part.rough]
    told = _choose(network_file, parts, tell)
    card |= told | {"sha256": digest(network_file)}
    for half in (1, 2):
        other = [part.half(3 - half) for part in parts]
        _choose(folder / f"half-{half}.onnx", [part for part in other if part.samples], tell)
    write_bytes(card_file, (json.dumps(card, indent=2) + "\n").encode())
    return told["presets"]


def _choose(
    network_file: Path, parts: Sequence[HeldSet], tell: Callable[[str], None]
) -> dict[str, dict[str, Any]]:
    """Presets chosen on these pictures, written into the file: its new metadata."""
    network = DoorNet(network_file)
    seen = [Tuning.look(network, part) for part in parts]
    presets = {}
    for name, goal in GOALS.items():
        tell(f"{network_file.name}, {name}")
        presets[name] = preset(tune(seen, goal, tell=tell))
    told = {"thresholds": presets["balanced"]["limits"], "presets": presets}
    set_metadata(network_file, told)
    return told
