"""Recipes: the packaged one, and what is wrong in others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from doorway3ds.errors import UserError
from doorway3ds.lab.train.doornet.recipe import read_recipe


def test_the_packaged_recipe_is_whole() -> None:
    recipe = read_recipe()
    assert sum(stage.epochs for stage in recipe.fit.stages) > 0
    assert replace(recipe.fit, seed=3).seed == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stages: [{epochs: 1, learning_rate: 0.1, warmth: 3}]", "unknown warmth"),
        ("batch: 4", "needs a list `stages`"),
        ("{", "is not valid YAML"),
        ("stages: [{epochs: 1, learning_rate: fast}]", "learning_rate must be a number"),
        ("{stages: [{epochs: 1, learning_rate: 1}], same_place: near}", "same_place must be a n"),
        ("{stages: [{epochs: 1, learning_rate: 1}], closed_weight: -1}", "closed_weight must be"),
        ("{stages: [{epochs: 1, learning_rate: 1}], costs: {missed: 0}}", "must be above 0"),
        ("{stages: [{epochs: 1, learning_rate: 1}], costs: {missed: high}}", "missed must be a n"),
        ("{stages: [{epochs: 1, learning_rate: 1}], costs: 3}", "costs: expected a mapping"),
        ("{stages: [{epochs: 1, learning_rate: 1}], init_share: 1.5}", "a share from 0 to 1"),
        ("{stages: [{epochs: 1, learning_rate: 1}], first_share: 2}", "first_share must be a sh"),
        ("{stages: [{epochs: 1, learning_rate: 1}], shares: 2}", "shares must be a mapping"),
        ("{stages: [{epochs: 1, learning_rate: 1}], shares: {nyu: most}}", "nyu must be a number"),
        ("{stages: [{epochs: 1, learning_rate: 1}], shares: {nyu: .nan}}", "nyu must be a number"),
        ("{stages: [{epochs: 1, learning_rate: 1}], portrait_shares: {nyu: -1}}", "nyu must be a"),
    ],
)
def test_a_wrong_recipe_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "r.yaml"
    path.write_text(text)
    with pytest.raises(UserError, match=message):
        read_recipe(path)
