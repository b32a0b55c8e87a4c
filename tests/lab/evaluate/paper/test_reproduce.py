"""The paper's printed numbers against what follows from its own pixels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.camera.choice import default_camera
from doorway3ds.camera.model import Camera
from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.errors import UserError
from doorway3ds.lab.evaluate.paper import printed
from doorway3ds.lab.evaluate.paper.reproduce import (
    Answer,
    angle_table,
    answer_pictures,
    behind_floor,
    confusion_table,
    count,
    epochs_table,
    floor_verdict,
    pictures_table,
    read_pictures,
    recompute,
    result,
    verdict,
)
from doorway3ds.types import Perception
from tests.factories import write_picture

ROWS = [recompute(row) for row in printed.ROWS]


class Flat:
    """p_open is the mean brightness; depth falls off to both sides of column 240 of 320."""

    name = "flat"
    gives = frozenset({"p_open", "depth"})

    def __call__(self, image: np.ndarray, camera: Camera) -> Perception:
        depth = np.full((240, 320), 2.0, np.float32)
        depth[:, 230:251] = 3.0
        return Perception(p_open=float(image.mean()) / 255, depth_m=depth, network=self.name)


def twelve(folder: Path) -> Path:
    """Six bright pictures in open-door/, six in no-door/, of which one is bright, too."""
    for index in range(6):
        write_picture(folder / "open-door" / f"{index}.png", 64, 48, 200)
        write_picture(folder / "no-door" / f"{index}.png", 64, 48, 200 if index == 0 else 40)
    return folder


def answers(folder: Path) -> list[Answer]:
    def fit(width: int, height: int, focal_35mm: float | None) -> Camera:
        return Camera.from_fov(width, height, printed.FOV_DEG)

    decide = Pipeline(Flat(), method="paper").decide
    return answer_pictures(read_pictures(folder, fit), decide)


def test_there_are_seven_rows_of_each_table() -> None:
    assert [(r.table, r.number) for r in printed.ROWS] == [
        (t, n) for t in (3, 4) for n in range(1, 8)
    ]


def test_no_printed_row_contradicts_the_unrounded_formula() -> None:
    assert [str(r.row) for r in ROWS if not r.agrees] == []
    angles = [r for r in ROWS if r.difference_deg is not None]
    assert len(angles) == 9
    for found in angles:
        assert found.difference_deg is not None
        assert abs(found.difference_deg) <= 0.5 * 10**-found.row.digits
    first = angles[0]
    assert first.angle_deg == pytest.approx(-95 * 60.9 / 320)
    assert first.difference_deg == pytest.approx(18.1 - 95 * 60.9 / 320)


def test_the_text_s_rounded_step_fails_all_of_table_4_and_one_of_table_3() -> None:
    wrong = [(r.row.table, r.row.number) for r in ROWS if not r.text_agrees]
    assert wrong == [(3, 4), (4, 1), (4, 2), (4, 3), (4, 4)]
    assert "Table 3, row 4; Table 4, row 1" in verdict(ROWS)
    assert "unrounded: none" in verdict(ROWS)


@pytest.mark.parametrize(
    "wrong",
    [
        {"angle_deg": 18.1},  # another sign
        {"angle_deg": -18.2},  # off by a digit
        {"angle_deg": None},  # held back though free
        {"trigger_row": 200},  # the path ends too early
    ],
)
def test_a_row_that_contradicts_is_found(wrong: dict[str, float | None]) -> None:
    found = recompute(replace(printed.ROWS[0], **wrong))  # type: ignore[arg-type]
    assert not found.agrees
    assert "unrounded: Table 3, row 1." in verdict([found])
    assert angle_table([found]).rows[0][1] == "contradicts the formula"


def test_printed_depths_need_a_raised_head() -> None:
    behind = [str(row) for row in printed.ROWS if behind_floor(row, 0)]
    assert len(behind) == 9
    assert {"Table 3, row 3", "Table 4, row 7"}.isdisjoint(behind)
    assert not [row for row in printed.ROWS if behind_floor(row, 9.7)]
    assert "9 of 11" in floor_verdict(printed.ROWS)
    # 65.5 rows below the middle of a level camera 0.52 m up, floor is 2.16 m deep
    row = replace(printed.ROWS[0], max_depth=None, best_depth=0.225)
    assert behind_floor(row, 1.2) is True
    assert behind_floor(replace(row, best_depth=0.220), 1.2) is False


def test_gates_hold_angles_back() -> None:
    by_name = {str(r.row): r for r in ROWS}
    for name in ("Table 3, row 2", "Table 3, row 6", "Table 4, row 7"):
        assert by_name[name].angle_deg is None
    assert by_name["Table 3, row 2"].free is False


def test_the_printed_counts_and_shares_fit_their_pictures() -> None:
    c = printed.TABLE_2
    assert c.tp + c.fp + c.tn + c.fn == printed.PICTURES
    best = max(printed.VALIDATION_ACCURACY, key=lambda e: printed.VALIDATION_ACCURACY[e])
    assert best == printed.ADOPTED_EPOCHS


def test_twelve_pictures_are_counted_beside_the_paper(tmp_path: Path) -> None:
    found = answers(twelve(tmp_path / "data"))
    here = count(found)
    assert here is not None
    assert (here.tn, here.fp, here.tp, here.fn) == (5, 1, 6, 0)
    table = confusion_table(here)
    assert list(table.columns) == ["paper, 12 NAO images", "here"]
    assert [cells for _, _, cells in table.rows[:4]] == [
        ["5", "5"], ["1", "1"], ["5", "6"], ["1", "0"],
    ]  # fmt: skip
    told = result(ROWS, found, None)
    assert told["table_2"]["here"] == {"tn": 5, "fp": 1, "tp": 6, "fn": 0}
    assert len(told["tables_1_and_2"]) == 12


def test_modules_after_a_closed_gate_say_nothing(tmp_path: Path) -> None:
    rows = {name: cells for name, _, cells in pictures_table(answers(twelve(tmp_path / "d"))).rows}
    assert rows["no-door/1.png"] == ["no door", "0.157", "no door", "–", "–", "–", "–", "–"]
    assert rows["no-door/0.png"][2] == "open (wrong)"
    truth, _, _, deepest, best, trigger, path, angle = rows["open-door/0.png"]
    assert (truth, deepest, best) == ("open", "120, 230 (0.30)", "120, 240 (0.30)")
    assert (trigger, path) == ("238, 240", "free")
    assert angle == f"{(160 - 240) * 60.9 / 320:+.3f}°"


def test_a_plain_folder_is_answered_without_counts(tmp_path: Path) -> None:
    for index in range(12):
        write_picture(tmp_path / "flat" / f"{index:02d}.png", 64, 48)
    found = answers(tmp_path / "flat")
    assert [a.is_open for a in found] == [None] * 12
    assert count(found) is None
    assert list(confusion_table(None).columns) == ["paper, 12 NAO images"]


def test_another_number_or_class_is_refused(tmp_path: Path) -> None:
    folder = twelve(tmp_path / "data")
    write_picture(folder / "no-door" / "more.png", 64, 48)
    with pytest.raises(UserError, match=r"expected 12 images .* got 13"):
        read_pictures(folder, default_camera)
    (folder / "no-door" / "more.png").unlink()
    (folder / "no-door").rename(folder / "half-open")
    with pytest.raises(UserError, match="is half open"):
        read_pictures(folder, default_camera)
    with pytest.raises(UserError, match="expected a folder"):
        read_pictures(tmp_path / "nowhere", default_camera)
    (folder / "open-door" / "0.png").write_bytes(b"no image")
    (folder / "half-open").rename(folder / "no-door")
    with pytest.raises(UserError, match=r"0\.png"):
        answers(folder)


def test_without_a_training_the_paper_stands_alone() -> None:
    table = epochs_table(None)
    assert [cells for _, _, cells in table.rows] == [["95.79 %"], ["97.96 %"], ["97.51 %"]]
    told = result(ROWS, [], None)
    assert told["tables_1_and_2"] is None
    assert [row["here"] for row in told["epochs"]] == [None] * 3
