"""Limits of the `opening` method for one network, chosen on held-out photographs.

Both errors count at once: going when blocked or where there is no doorway, and not going when
the way is clear. What is chosen here must not be reported on the same pictures.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from doorway3ds.decide.gates import decide
from doorway3ds.decide.opening import OpeningParams, select_opening
from doorway3ds.errors import UserError
from doorway3ds.files import write_bytes
from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.datasets.samples import (
    Sample,
    held_out,
    load_depth,
    load_frame,
    parse_split,
)
from doorway3ds.lab.datasets.truth import PictureTruth, picture_truth
from doorway3ds.lab.evaluate import direction
from doorway3ds.lab.evaluate.direction import DirectionMetrics, DirectionRecord
from doorway3ds.lab.train.doornet.export import set_metadata
from doorway3ds.lab.train.doornet.run import read_calibration
from doorway3ds.networks.base import Network
from doorway3ds.networks.doornet import DoorNet
from doorway3ds.networks.limits import override
from doorway3ds.networks.session import digest
from doorway3ds.types import Frame, Perception

# Each limit's candidates; a dotted name lies in a nested group.
GRID: dict[str, tuple[float, ...]] = {
    "sure_score": (0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6),
    "clearance.vote_alone": (0.0, 0.5, 0.6, 0.7, 0.8),
    "clearance.vote_blocks": (0.0, 0.2, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65),
    # never below 0.5: what the depth shows in the way is not argued away by less than a chance
    "clearance.vote_frees": (0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9, 1.1),
    "clearance.height_gain": (0.15, 0.3, 0.5, 0.8),
    "clearance.group_gain": (0.01, 0.02, 0.05, 0.1),
}


@dataclass(frozen=True)
class Goal:
    """Most goes on a clear way, within bounds on the two ways to go wrong."""

    without_door: float = 0.03
    when_blocked: float = 0.15

    def value(self, metrics: DirectionMetrics) -> float:
        """Larger is better; an excess over a bound costs four times its size."""
        clear, blocked, none = (
            metrics[name].value or 0.0
            for name in ("go_when_clear", "go_when_blocked", "go_without_door")
        )
        excess = max(0.0, blocked - self.when_blocked) + max(0.0, none - self.without_door)
        # a little for staying below the bounds, so that ties go to the safer limits
        return clear - 4 * excess - 0.2 * (blocked + none)


@dataclass
class Tuning:
    """Perceptions of held-out pictures, kept so that limits can be tried in milliseconds."""

    seen: list[tuple[Frame, Perception, PictureTruth]] = field(default_factory=list)

    @classmethod
    def look(cls, network: Network, samples: Sequence[Sample]) -> Tuning:
        """Runs the network once on every picture."""
        tuning = cls()
        for sample in samples:
            frame = load_frame(sample)
            truth = picture_truth(sample, frame, load_depth(sample))
            tuning.seen.append((frame, network(frame.image, frame.camera), truth))
        return tuning

    def records(self, params: OpeningParams) -> list[DirectionRecord]:
        """The answers under these limits."""
        found = []
        for frame, perception, truth in self.seen:
            selection = select_opening(perception, frame, params)
            answer = decide(perception, selection, frame, "opening")
            found.append(direction.record_from_decision(truth, answer))
        return found

    def score(self, params: OpeningParams) -> DirectionMetrics:
        """The metrics under these limits, without intervals."""
        return direction.score(self.records(params), repeats=0)


def nested(limits: dict[str, float]) -> dict[str, Any]:
    """Dotted names to nested mappings, as `params.override` and a network's metadata take them."""
    found: dict[str, Any] = {}
    for name, value in limits.items():
        *groups, last = name.split(".")
        place = found
        for group in groups:
            place = place.setdefault(group, {})
        place[last] = value
    return found


def tune(
    tuning: Tuning,
    goal: Goal | None = None,
    grid: dict[str, tuple[float, ...]] | None = None,
    rounds: int = 2,
    tell: Callable[[str], None] = lambda line: None,
) -> dict[str, float]:
    """Coordinate search over the grid from the defaults: limits by dotted name."""
    goal, grid = goal or Goal(), grid or GRID
    best: dict[str, float] = {}
    value = goal.value(tuning.score(OpeningParams()))
    for _ in range(rounds):
        before = value
        for name, candidates in grid.items():
            for candidate in candidates:
                trial = {**best, name: candidate}
                reached = goal.value(tuning.score(override(OpeningParams(), nested(trial))))
                if reached > value + 1e-9:
                    best, value = trial, reached
            tell(f"{name}: {best.get(name, 'default')} -> {value:.3f}")
        if value <= before + 1e-9:
            break
    return best


def tune_run(
    folder: Path, dataset: Path, split: str, tell: Callable[[str], None]
) -> dict[str, Any]:
    """Limits for folder/doornet.onnx on one fold of a data set, written into it and its card.

    Raises UserError where the fold holds places that the network was trained on.
    """
    network_file, card_file = folder / "doornet.onnx", folder / "doornet.json"
    read_calibration(card_file)  # refuses what is no card
    card = json.loads(card_file.read_text(encoding="utf-8"))
    samples = held_out(read_dataset(dataset), *parse_split(split)).samples
    if card["held_out"] != split:
        raise UserError(
            f"{network_file} was trained with {card['held_out'] or 'nothing'} held out; "
            f"its limits must be chosen on that fold, not on {split}"
        )
    found = nested(tune(Tuning.look(DoorNet(network_file), samples), tell=tell))
    set_metadata(network_file, {"thresholds": found})
    card |= {"thresholds": found, "sha256": digest(network_file)}
    write_bytes(card_file, (json.dumps(card, indent=2) + "\n").encode())
    return found
