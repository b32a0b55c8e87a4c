"""What doornet is trained and judged on, batch by batch."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.errors import UserError
from doorway3ds.lab.train.doornet.data.augment import AugmentConfig
from doorway3ds.lab.train.doornet.data.samples import read_samples
from doorway3ds.lab.train.doornet.fit import Drawn, FitConfig, Held, Sampler, Stage, collate
from doorway3ds.lab.train.engine.backend import Team

CONFIG = FitConfig(stages=(Stage(2, 1e-3),), batch=2, seed=4)


def test_batches_are_those_of_their_number_whoever_draws_them(rendered: Path) -> None:
    sampler = Sampler(read_samples(rendered), CONFIG, AugmentConfig())
    data = Drawn(sampler, batch=2, first=6, steps=2, encode=None)
    third = data.batches(1)[0]
    image, target = collate([drawn for _, drawn in sampler.draw(8)])
    own, labels = data.load(third, 1)
    assert np.array_equal(own, image)
    assert all(np.array_equal(labels[name], target[name]) for name in target)
    for rank in range(2):
        part, _ = data.load(Team(rank, 2).share(third), 1)
        assert np.array_equal(part, image[rank::2])
    assert [data.names[i] for i in third] == [sample.name for sample, _ in sampler.draw(8)]


def test_shares_say_which_sources_are_drawn(rendered: Path) -> None:
    samples = read_samples(rendered)
    other = [replace(sample, source="other") for sample in samples]
    config = replace(CONFIG, shares={"rendered": 0.0, "other": 0.3})
    sampler = Sampler(samples + other, config, AugmentConfig())
    assert {s.source for step in range(6) for s, _ in sampler.draw(step)} == {"other"}
    # one that is not named is drawn from, too
    sampler = Sampler(samples + other, replace(config, shares={"rendered": 0.0}), AugmentConfig())
    assert {s.source for step in range(6) for s, _ in sampler.draw(step)} == {"other"}
    with pytest.raises(UserError, match="leave nothing of the images given: rendered"):
        Sampler(samples, config, AugmentConfig())


def test_what_counts_double_is_drawn_twice_as_often(rendered: Path) -> None:
    samples = [
        replace(s, draws=3.0 if k == 0 else 1.0) for k, s in enumerate(read_samples(rendered))
    ]
    samples = [replace(s, spans=(), place=str(k)) for k, s in enumerate(samples)]
    sampler = Sampler(samples, replace(CONFIG, batch=50), AugmentConfig(colour=0, occluder=0))
    names = [sample.name for step in range(4) for sample, _ in sampler.draw(step)]
    share = names.count(samples[0].name) / len(names)
    assert share == pytest.approx(3 / (len(samples) + 2), abs=0.1)


def test_held_out_pictures_come_in_batches_of_one_shape(rendered: Path) -> None:
    samples = read_samples(rendered)[:5]
    upright = [
        replace(s, image=np.rot90(s.image), depth_m=None, segments=None, extra={})
        for s in samples[:2]
    ]
    data = Held([samples[2], *upright, samples[3], samples[4]], 2, None)
    assert data.batches(None) == [[0, 3], [4], [1, 2]]
    assert [data.load(b, None)[0].shape for b in data.batches(None)] == [
        (2, 3, 192, 256),
        (1, 3, 192, 256),
        (2, 3, 256, 192),
    ]
