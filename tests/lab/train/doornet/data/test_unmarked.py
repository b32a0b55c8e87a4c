"""Labels that a network gives to photographs which nobody has marked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from doorway3ds.decide.opening import columns_from_spans
from doorway3ds.errors import UserError
from doorway3ds.lab.train.doornet.data.augment import view
from doorway3ds.lab.train.doornet.data.samples import Sample
from doorway3ds.lab.train.doornet.data.unmarked import read_unmarked
from doorway3ds.types import Perception


class Brightness:
    """Sees an opening where an image is bright: surely if white, doubtfully if grey."""

    name = "brightness"
    gives = frozenset({"p_open", "columns"})

    def __init__(self, p_open: float | None = None) -> None:
        self.p_open = p_open

    def __call__(self, image: Any, camera: Any) -> Perception:
        width = image.shape[1]
        level = image.mean(axis=(0, 2)) / 255
        bright = np.flatnonzero(level > 0.3)
        spans = [(bright[0] - 0.5, bright[-1] + 0.5)] if bright.size else []
        votes = columns_from_spans(spans, width)
        top = float(level.max())
        votes = replace(votes, score=votes.score * top, clear=np.full(votes.score.size, top))
        return Perception(p_open=top if self.p_open is None else self.p_open, columns=votes)


def write(folder: Path, name: str, level: int, size: tuple[int, int] = (320, 240)) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    image = np.full((size[1], size[0], 3), 13, np.uint8)
    image[:, size[0] // 2 : size[0] * 3 // 4] = level
    cv2.imwrite(str(folder / name), image)


def labelled(folder: Path, **options: Any) -> dict[str, Sample]:
    return {sample.name: sample for sample in read_unmarked(folder, Brightness(**options))}


def test_an_opening_is_labelled_with_its_edges_way_and_weight(tmp_path: Path) -> None:
    write(tmp_path / "flat" / "hall", "a.png", 242)
    sample = labelled(tmp_path / "flat")["hall/a.png"]
    (span,) = sample.spans
    assert (span.left, span.right) == pytest.approx((159.5, 239.5), abs=0.01)
    assert (span.clear, span.unsure, sample.open, sample.source) == (1, False, 1, "flat")
    assert sample.p_open == pytest.approx(242 / 255)
    assert sample.weight == pytest.approx(2 * 242 / 255 - 1)
    target = view(sample, (192, 256), None)
    assert target.p_open == pytest.approx(242 / 255)
    assert target.score[32:48].min() == pytest.approx(1) and target.score[:30].max() == 0


def test_a_square_is_stretched_to_what_cameras_take(tmp_path: Path) -> None:
    write(tmp_path, "a.png", 242, (256, 256))
    (sample,) = labelled(tmp_path).values()
    assert sample.image.shape == (264, 352, 3)
    assert sample.spans[0].left == pytest.approx(352 / 2 - 0.5, abs=1)


def test_nothing_is_learned_where_there_may_be_an_opening_or_not(tmp_path: Path) -> None:
    write(tmp_path, "sure.png", 242)
    write(tmp_path, "doubt.png", 89)  # 0.35: seen, but the gate says rather not
    sample = labelled(tmp_path)["doubt.png"]
    assert sample.open == 0 and sample.spans[0].unsure
    target = view(sample, (192, 256), None)
    assert target.score.max() == 0 and target.edge_weight.max() == 0
    assert target.score_weight[33:47].max() == 0 and target.score_weight[:30].min() > 0


def test_contradictions_and_doubts_are_left_out(tmp_path: Path) -> None:
    write(tmp_path, "bright.png", 242)
    assert set(labelled(tmp_path, p_open=0.1)) == set()  # columns see one, the gate does not
    assert set(labelled(tmp_path, p_open=0.55)) == set()
    assert set(labelled(tmp_path, p_open=0.9)) == {"bright.png"}


def test_two_without_an_opening_stay_for_each_with_one(tmp_path: Path) -> None:
    write(tmp_path, "open.png", 242)
    for index in range(7):
        write(tmp_path, f"none-{index}.png", 13)
    assert sorted(labelled(tmp_path)) == ["none-0.png", "none-6.png", "open.png"]


def test_a_folder_without_images_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="holds no image to learn from"):
        read_unmarked(tmp_path, Brightness())
