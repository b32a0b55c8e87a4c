from __future__ import annotations

import cv2
import numpy as np
import pytest

from doorway3ds.errors import CallError, UserError
from doorway3ds.lab.datasets import places as groups
from doorway3ds.lab.datasets.samples import Sample
from doorway3ds.lab.train.options import GroupOptions
from tests.factories import room


def test_copies_are_near_and_other_pictures_are_not() -> None:
    rng = np.random.default_rng(0)
    first, other = (room(rng, is_open=True, width=320, height=240) for _ in range(2))
    _, jpeg = cv2.imencode(".jpg", first, [cv2.IMWRITE_JPEG_QUALITY, 60])
    copies = [
        np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR)),
        np.asarray(cv2.resize(first, (200, 150), interpolation=cv2.INTER_AREA)),
        np.ascontiguousarray(first[:, ::-1]),
        np.clip(first * 1.1 + 5, 0, 255).astype(np.uint8),
    ]
    hashes = np.array([groups.perceptual_hash(i) for i in (first, *copies, other)])
    pairs = groups.near_pairs(hashes)
    assert {(0, 1), (0, 2), (0, 3), (0, 4)} <= set(pairs)
    assert all(5 not in pair for pair in pairs)
    assert len(set(groups.clusters(6, pairs))) == 2


def test_what_links_pictures_joins_them() -> None:
    assert groups.clusters(5, [(0, 1), (3, 4), (1, 3)]) == [4, 4, 2, 4, 4]


@pytest.mark.parametrize("seed", range(10))
def test_whole_groups_are_held_out_near_the_share_of_each_class(seed: int) -> None:
    rng = np.random.default_rng(seed)
    names = [f"g{n}" for n in rng.integers(0, 40, 400)]
    labels = ["open" if n < 120 else "shut" for n in rng.permutation(400)]
    train, held = groups.split(names, labels, 0.2, seed)
    assert sorted(train + held) == list(range(400))
    assert {names[i] for i in train}.isdisjoint(names[i] for i in held)
    for label, count in (("open", 120), ("shut", 280)):
        share = sum(labels[i] == label for i in held) / count
        assert 0.1 < share < 0.3


def test_each_class_is_on_both_sides_however_few() -> None:
    train, held = groups.split(["a", "b", "c", "d"], ["x", "x", "y", "y"], 0.05, 3)
    assert len(train) == len(held) == 2


def test_a_class_in_one_group_cannot_be_held_out() -> None:
    with pytest.raises(UserError, match="class y has all its images in 1 group"):
        groups.split(["a", "b", "c", "c"], ["x", "x", "y", "y"], 0.2, 0)


def test_leaks_are_near_pairs_across_the_split() -> None:
    pictures = groups.Pictures((), (), "", ((0, 1), (1, 2), (2, 3)), {})
    assert pictures.split_at([0, 1], [2, 3]).leaks == ((1, 2),)


def test_groups_by_pattern_and_its_refusals(tmp_path) -> None:  # type: ignore[no-untyped-def]
    samples = [
        Sample(n, n, tmp_path / n, True) for n in ("room1_a.jpg", "room1_b.jpg", "room2.jpg")
    ]

    def named(pattern: str) -> tuple[str, ...]:
        return groups.name_groups(samples, [], places_known=False, pattern=pattern)[0]

    assert named(r"room(\d)") == ("1", "1", "2")
    with pytest.raises(CallError, match="needs one group"):
        named("room")
    with pytest.raises(CallError, match="not a regular expression"):
        named("(")
    with pytest.raises(UserError, match=r"is not found in room2\.jpg"):
        named("(room1)")
    with pytest.raises(CallError, match="group must be one of auto, near, folder"):
        GroupOptions(group="magic")
