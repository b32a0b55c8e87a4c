"""The recipe: one readable file that says how a network is trained."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

from doorway3ds.errors import UserError
from doorway3ds.lab.train.doornet.data.augment import AugmentConfig
from doorway3ds.lab.train.doornet.data.compose import ComposeConfig
from doorway3ds.lab.train.doornet.fit import FitConfig, Stage
from doorway3ds.lab.train.doornet.losses import LossWeights
from doorway3ds.lab.train.doornet.model import DoorNetConfig
from doorway3ds.networks.costs import Costs

Config = TypeVar("Config")


@dataclass(frozen=True)
class Pseudo:
    """Weights of the teachers' labels."""

    depth: float = 0.25
    segments: float = 0.3


@dataclass(frozen=True)
class Recipe:
    """Everything that a training of doornet needs besides data and first weights.

    same_place: cosine of ImageNet features from which on two door photographs show one place.
    closed_weight: of a photograph that a closed door fills, among those of one.
    costs: of p_open's errors, told to the runtime by the network's file.
    init_share: of the weights that the training began with (`--init`) in those that it keeps.
    first_share: of the first stage's weights in those that a training of several stages keeps.
    """

    fit: FitConfig
    network: DoorNetConfig
    augment: AugmentConfig
    losses: LossWeights
    pseudo: Pseudo
    compose: ComposeConfig = field(default_factory=ComposeConfig)
    same_place: float = 0.55
    closed_weight: float = 1.0
    costs: Costs = field(default_factory=Costs)
    init_share: float = 0.0
    first_share: float = 0.0
    text: str = ""


def _build(kind: type[Config], values: Any, where: str) -> Config:
    """A config dataclass from a mapping; UserError for names or values that do not fit."""
    if not isinstance(values, Mapping):
        raise UserError(f"{where}: expected a mapping, got {type(values).__name__}")
    assert is_dataclass(kind)
    known = {item.name for item in fields(kind)}
    strange = sorted(set(values) - known)
    if strange:
        raise UserError(
            f"{where}: unknown {', '.join(strange)}; known are {', '.join(sorted(known))}"
        )
    for name, value in values.items():
        if not isinstance(value, (int, float, list, tuple, dict)):
            raise UserError(f"{where}: {name} must be a number, got {value!r}")
    return kind(**values)


def _number(where: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value < math.inf:
        raise UserError(f"{where} must be a number from 0 on, got {value!r}")
    return value


def _shares(where: str, values: Any) -> dict[str, float]:
    """Share by source; one that is not named counts 1 (see `fit.Sampler`)."""
    if not isinstance(values, Mapping):
        raise UserError(f"{where} must be a mapping of sources to numbers, got {values!r}")
    return {str(source): _number(f"{where}, {source}", share) for source, share in values.items()}


def read_recipe(path: Path | None = None) -> Recipe:
    """The recipe in `path`, or the packaged one.

    Raises UserError where it cannot be read or names what does not exist.
    """
    import yaml

    name = str(path) if path else "the packaged recipe"
    try:
        source = path or files("doorway3ds.lab.train").joinpath("doornet/recipes/doornet.yaml")
        text = source.read_text(encoding="utf-8")
        values = yaml.safe_load(text)
    except OSError as error:
        raise UserError(f"cannot read the recipe {name}: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UserError(
            f"the recipe {name} is not valid YAML: {str(error).splitlines()[0]}"
        ) from error
    if not isinstance(values, Mapping) or not values.get("stages"):
        raise UserError(f"the recipe {name} needs a list `stages` of {{epochs, learning_rate}}")
    values = dict(values)
    stages = []
    for number, stage in enumerate(values.pop("stages")):
        stages.append(_build(Stage, stage, f"{name}, stage {number + 1}"))
    parts: dict[str, Any] = {
        "network": _build(DoorNetConfig, values.pop("network", {}), f"{name}, network"),
        "augment": _build(AugmentConfig, values.pop("augment", {}), f"{name}, augment"),
        "losses": _build(LossWeights, values.pop("losses", {}), f"{name}, losses"),
        "pseudo": _build(Pseudo, values.pop("pseudo", {}), f"{name}, pseudo"),
        "compose": _build(ComposeConfig, values.pop("compose", {}), f"{name}, compose"),
    }
    costs = values.pop("costs", {})
    if isinstance(costs, Mapping):
        costs = {key: _number(f"{name}: costs, {key}", value) for key, value in costs.items()}
    parts["costs"] = _build(Costs, costs, f"{name}, costs")
    for key in ("same_place", "closed_weight", "init_share", "first_share"):
        parts[key] = _number(f"{name}: {key}", values.pop(key, getattr(Recipe, key)))
        if key.endswith("_share") and parts[key] > 1:
            raise UserError(f"{name}: {key} must be a share from 0 to 1, got {parts[key]:g}")
    for key in ("shares", "portrait_shares"):
        if key in values:
            values[key] = _shares(f"{name}: {key}", values[key])
    fit = _build(FitConfig, {**values, "stages": tuple(stages)}, name)
    return Recipe(fit=fit, text=text, **parts)
