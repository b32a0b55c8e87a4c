"""Boards rendered through a known lens; the calibration must find that lens again."""

from __future__ import annotations

import numpy as np
import pytest

from doorway3ds.camera.board import Board, find_corners
from doorway3ds.camera.calibration import calibrate
from doorway3ds.camera.info import read_camera_info
from doorway3ds.camera.model import Camera, pixel_to_ray
from doorway3ds.cli.main import run
from doorway3ds.errors import UserError
from doorway3ds.images.codec import write_image

cv2 = pytest.importorskip("cv2")

LENS = Camera("lens", 640, 480, 540.0, 545.0, 326.0, 233.0, (-0.2, 0.06, 0.001, -0.001, 0.0))
CHESS = Board(9, 6, 0.025)
CHARUCO = Board(8, 6, 0.03, 0.022)
# Tilt about x, y, z in degrees, then the board's middle in metres.
VIEWS = [
    (20, 0, 0, 0.0, 0.0, 0.45),
    (-25, 10, 5, -0.10, -0.06, 0.42),
    (0, 30, -10, 0.12, -0.06, 0.45),
    (10, -30, 3, -0.10, 0.07, 0.42),
    (-20, -15, 20, 0.12, 0.07, 0.45),
    (30, 20, -5, 0.0, 0.0, 0.35),
]


def texture(board: Board) -> tuple[np.ndarray, float]:
    """The board drawn with a white margin of one square, and its pixels per metre."""
    per_square = 48
    if board.marker_m is None:
        rows, columns = board.rows + 1, board.columns + 1
        y, x = np.mgrid[0 : rows * per_square, 0 : columns * per_square] // per_square
        drawn = np.where((x + y) % 2, 255, 0).astype(np.uint8)
    else:
        pattern = cv2.aruco.CharucoBoard(
            (board.columns, board.rows),
            board.square_m,
            board.marker_m,
            cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary)),
        )
        drawn = pattern.generateImage((board.columns * per_square, board.rows * per_square))
    return np.pad(drawn, per_square, constant_values=255), per_square / board.square_m


def photograph(board: Board, view: tuple[float, ...], lens: Camera = LENS) -> np.ndarray:
    """The board seen through a lens, twice oversampled."""
    drawn, scale = texture(board)
    angles = np.radians(view[:3])
    turn = np.eye(3)
    for axis, angle in zip(np.eye(3), angles, strict=True):
        turn = turn @ cv2.Rodrigues(axis * angle)[0]
    middle = np.array(view[3:])
    fine = lens.scaled_to(1280, 960)
    x, y = np.meshgrid(np.arange(1280), np.arange(960))
    rays = pixel_to_ray(fine, np.stack([x, y], -1))
    distance = (middle @ turn[:, 2]) / (rays @ turn[:, 2])
    local = (rays * distance[..., None] - middle) @ turn
    u = local[..., 0] * scale + (drawn.shape[1] - 1) / 2
    v = local[..., 1] * scale + (drawn.shape[0] - 1) / 2
    seen = cv2.remap(
        drawn, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR, borderValue=140
    )
    small = cv2.resize(seen, (640, 480), interpolation=cv2.INTER_AREA)
    return np.repeat(small[..., None], 3, axis=2)


@pytest.fixture(scope="module")
def chess_pictures() -> list[tuple[str, np.ndarray]]:
    return [(f"{i}.png", photograph(CHESS, view)) for i, view in enumerate(VIEWS)]


def check(camera: Camera) -> None:
    assert (camera.width, camera.height, camera.assumed) == (640, 480, False)
    assert (camera.fx, camera.fy) == pytest.approx((LENS.fx, LENS.fy), rel=0.01)
    assert (camera.cx, camera.cy) == pytest.approx((LENS.cx, LENS.cy), abs=4)
    # What counts is where rays go, not single coefficients.
    xy = np.array([(40.0, 40.0), (600.0, 60.0), (60.0, 440.0), (320.0, 240.0)])
    off = pixel_to_ray(camera, xy) - pixel_to_ray(LENS, xy)
    assert np.degrees(np.abs(off).max()) < 0.5


def test_a_chessboard_gives_the_lens_back(chess_pictures):
    found = calibrate(chess_pictures, CHESS, "mine")
    assert found.rms_px < 0.15
    assert set(found.errors_px) == {name for name, _ in chess_pictures}
    assert found.without_board == ()
    assert found.coverage > 0.4
    check(found.camera)


def test_a_charuco_board_gives_the_lens_back():
    pictures = [(f"{i}.png", photograph(CHARUCO, view)) for i, view in enumerate(VIEWS)]
    found = calibrate(pictures, CHARUCO, "mine")
    assert found.rms_px < 0.3
    check(found.camera)


def test_pictures_without_a_board_are_named(chess_pictures):
    grey = np.full((480, 640, 3), 128, np.uint8)
    found = calibrate([*chess_pictures[:4], ("wall.png", grey)], CHESS, "mine")
    assert found.without_board == ("wall.png",)
    with pytest.raises(UserError, match="found in 2 of 3 images"):
        calibrate([*chess_pictures[:2], ("wall.png", grey)], CHESS, "mine")
    assert find_corners(grey, CHARUCO) is None


def test_other_sizes_boards_and_dictionaries_are_refused(chess_pictures):
    small = np.zeros((240, 320, 3), np.uint8)
    with pytest.raises(UserError, match="320x240"):
        calibrate([chess_pictures[0], ("small.png", small)], CHESS, "mine")
    with pytest.raises(UserError, match="at least 3x3"):
        Board(2, 6, 0.025)
    with pytest.raises(UserError, match="smaller than its square"):
        Board(8, 6, 0.02, 0.03)
    with pytest.raises(UserError, match="DICT_4X4_50"):
        find_corners(small, Board(8, 6, 0.03, 0.02, "DICT_NONE"))


def test_the_command_writes_a_camera_file(tmp_path, chess_pictures, capsys):
    for name, image in chess_pictures:
        write_image(tmp_path / "shots" / name, image)
    out = tmp_path / "head.yaml"
    call = ["calibrate", str(tmp_path / "shots"), "--board", "9x6", "--square-mm", "25"]
    assert run([*call, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "reprojection error" in printed
    assert f"wrote {out}" in printed
    camera = read_camera_info(out)
    assert camera.name == "head"
    check(camera)
    assert run([*call[:2], "--board", "9by6"]) == 2
    assert "--board" in capsys.readouterr().err


# An equidistant lens of 122 deg; what the polynomials make of it must not turn back in the image.
WIDE = Camera("wide", 640, 480, 300.0, 300.0, 322.0, 238.0, (0.0,) * 4, False, "equidistant")


def test_the_model_is_the_one_that_predicts_other_views(tmp_path, capsys):
    rng = np.random.default_rng(5)
    for number in range(10):
        x, y, z = rng.uniform(-0.17, 0.17), rng.uniform(-0.12, 0.12), rng.uniform(0.16, 0.28)
        view = (*rng.uniform(-25, 25, 2), rng.uniform(-15, 15), x, y, z)
        write_image(tmp_path / "shots" / f"{number}.png", photograph(CHESS, view, WIDE))
    call = ["calibrate", str(tmp_path / "shots"), "--out", str(tmp_path / "wide.yaml")]
    assert run(call) == 0
    assert "equidistant chosen" in capsys.readouterr().out
    camera = read_camera_info(tmp_path / "wide.yaml")
    assert camera.untrusted == 0
    xy = np.array([(5.0, 240.0), (634.0, 240.0), (320.0, 20.0), (320.0, 240.0)])
    ours, true = (np.arctan(np.hypot(*pixel_to_ray(c, xy)[:, :2].T)) for c in (camera, WIDE))
    assert np.degrees(np.abs(ours - true)).max() < 0.8
    assert run([*call, "--model", "spline"]) == 2
    assert "plumb_bob, rational_polynomial, fisheye" in capsys.readouterr().err


def test_pictures_taken_either_way_up_are_of_one_sensor(tmp_path, chess_pictures):
    from tests.factories import encode

    for number, (_, image) in enumerate(chess_pictures):
        held = 3 if number % 2 else 1
        (tmp_path / f"{number}.jpg").write_bytes(encode(image, orientation=held))
    out = tmp_path / "sensor.yaml"
    assert run(["calibrate", str(tmp_path), "--out", str(out), "--model", "plumb_bob"]) == 0
    check(read_camera_info(out))
