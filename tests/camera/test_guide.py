"""A guided calibration on films of a board that was rendered through a known lens."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from doorway3ds.camera.board import find_corners
from doorway3ds.camera.guide import COLUMNS, FEWEST, ROWS, SPREAD, TILTS, Guide
from doorway3ds.camera.info import read_camera_info
from doorway3ds.cli.main import run
from tests.camera.test_calibration import CHESS, check, photograph

FPS = 10.0
HELD = 3
# As VIEWS of the calibration's tests: tilt about x, y, z in degrees, the middle in metres.
POSES = [
    (0, 0, 0, -0.11, -0.08, 0.42),
    (0, 25, 0, 0.12, -0.08, 0.42),
    (0, -25, 5, -0.11, 0.08, 0.42),
    (25, 0, 0, 0.12, 0.08, 0.44),
    (-25, 0, 0, 0.0, 0.0, 0.42),
    (0, 0, 0, 0.0, 0.0, 0.70),
    (20, 20, 0, 0.06, 0.0, 0.50),
    (-20, 20, 0, -0.06, 0.0, 0.50),
    (-20, -20, 10, 0.0, 0.06, 0.45),
    (20, -20, -10, 0.0, -0.06, 0.45),
    (30, 10, 20, 0.05, 0.05, 0.38),
    (-10, 30, -20, -0.05, -0.05, 0.38),
    (0, -35, 0, 0.10, 0.0, 0.55),
    (35, 0, 0, -0.10, 0.0, 0.55),
]


@pytest.fixture(scope="module")
def shots() -> list[np.ndarray]:
    return [photograph(CHESS, pose) for pose in POSES]


def film(path: Path, shots: list[np.ndarray]) -> Path:
    """Each pose is reached by a move and then held."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), FPS, (640, 480))
    for shot in shots:
        for shift in (24, 12, *[0] * HELD):
            writer.write(np.ascontiguousarray(np.roll(shot, shift, axis=1)[..., ::-1]))
    writer.release()
    return path


def test_every_pose_is_taken_once_and_only_when_held(shots):
    guide = Guide(CHESS)
    taken = []
    for number, shot in enumerate(shots[:5]):
        for step, shift in enumerate((24, 12, 0, 0, 0)):
            stamp_s = (5 * number + step) / FPS
            if guide.look(f"{number}:{step}", np.roll(shot, shift, axis=1), stamp_s):
                taken.append((number, step))
    assert taken == [(number, 3) for number in range(5)]
    assert "taken already" in guide.hint
    assert guide.tilts == set(TILTS)


def test_coverage_is_of_zones_tilts_and_distances(shots):
    guide = Guide(CHESS)

    def show(shot: np.ndarray) -> bool:
        show.now += 1
        return any(guide.look("shot", shot, show.now + step / FPS) for step in range(2))

    show.now = 0
    assert show(shots[0])
    assert guide.zones == {0, 1, 4, 5}  # upper left, with its inner corners
    assert guide.tilts == set()
    assert "upper inner" in guide.missing
    for shot in shots[1:4]:
        show(shot)
    assert guide.zones == set(range(COLUMNS * ROWS))
    assert guide.missing.startswith("tilt it")
    assert guide.spread < SPREAD
    for shot in shots[4:]:
        show(shot)
    assert guide.spread == pytest.approx(0.70 / 0.38, rel=0.1)
    assert len(guide.views) >= FEWEST
    assert guide.missing == ""


def test_a_blurred_or_missing_board_is_named(shots):
    guide = Guide(CHESS)
    blurred = cv2.GaussianBlur(shots[0], (0, 0), 3.0)
    assert not any(guide.look("blurred", blurred, step / FPS) for step in range(3))
    assert "blurred" in guide.hint
    assert not guide.look("wall", np.full((480, 640, 3), 128, np.uint8), 1.0)
    assert "no board" in guide.hint


def test_large_images_are_measured_at_full_size(shots):
    guide = Guide(CHESS)
    large = cv2.resize(shots[0], (1280, 960), interpolation=cv2.INTER_CUBIC)
    assert [guide.look("large", large, step / FPS) for step in range(2)] == [False, True]
    points, corners = find_corners(large, CHESS)
    assert np.array_equal(guide.views[0].corners, corners)
    assert np.array_equal(guide.views[0].points, points)


def test_a_film_gives_the_lens_back(tmp_path, shots, capsys):
    path = film(tmp_path / "board.avi", shots)
    out = tmp_path / "camera.yaml"
    assert run(["calibrate", str(path), "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert said.out.count(" taken: zones ") >= FEWEST
    assert f"zones {COLUMNS * ROWS} of {COLUMNS * ROWS}, tilts {' '.join(TILTS)}" in said.out
    assert "coverage" not in said.err
    check(read_camera_info(out))


def test_a_film_that_ends_early_is_used_and_what_it_lacks_is_said(tmp_path, shots, capsys):
    path = film(tmp_path / "short.avi", shots[:5])
    out = tmp_path / "camera.yaml"
    assert run(["calibrate", str(path), "--out", str(out)]) == 0
    assert "coverage is not complete; next would be: hold it much" in capsys.readouterr().err
    assert read_camera_info(out).width == 640
    path = film(tmp_path / "two.avi", shots[:2])
    assert run(["calibrate", str(path), "--out", str(tmp_path / "none.yaml")]) == 1
    assert "2 frames with the board were taken, at least 3" in capsys.readouterr().err
    assert not (tmp_path / "none.yaml").exists()


def test_ctrl_c_calibrates_with_what_there_is(tmp_path, shots, monkeypatch):
    look = Guide.look

    def interrupted(self: Guide, name: str, image: np.ndarray, stamp_s: float) -> bool:
        if len(self.views) == 6:
            raise KeyboardInterrupt
        return look(self, name, image, stamp_s)

    monkeypatch.setattr(Guide, "look", interrupted)
    out = tmp_path / "camera.yaml"
    assert run(["calibrate", str(film(tmp_path / "b.avi", shots[:8])), "--out", str(out)]) == 0
    assert read_camera_info(out).fx == pytest.approx(540, rel=0.03)


def test_a_film_turned_upright_is_refused(tmp_path, shots, monkeypatch, capsys):
    path = film(tmp_path / "upside-down.avi", shots[:1])
    monkeypatch.setattr("doorway3ds.sources.video.orientation", lambda reader: 3)
    assert run(["calibrate", str(path), "--out", str(tmp_path / "camera.yaml")]) == 1
    assert "turned upright by its metadata" in capsys.readouterr().err


def test_a_terminal_shows_zones_tilts_and_what_to_do(tmp_path, shots, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    path = film(tmp_path / "board.avi", shots[:3])
    assert run(["calibrate", str(path), "--out", str(tmp_path / "camera.yaml")]) == 0
    shown = capsys.readouterr().out
    for said in ("zones", "left right", "x1.5", "3 (of 12)", "taken already", "Ctrl-C"):
        assert said in shown, said
