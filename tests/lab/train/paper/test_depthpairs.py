from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.errors import CallError, UserError
from doorway3ds.lab.train.paper.densedepth import NYU
from doorway3ds.lab.train.paper.depthpairs import read_depth_pairs, target
from doorway3ds.lab.train.paper.depthrun import augmented
from tests.factories import depth_pairs, room, save

SMALL = replace(NYU, height=72, width=96)


def test_targets_are_ten_metres_by_depth_and_zero_where_unknown(tmp_path: Path) -> None:
    folder = depth_pairs(tmp_path, 2)
    depth = np.full((72, 96), 2500, np.uint16)
    depth[:, :48] = 50  # 5 cm: nearer than the limit
    depth[:36, 48:] = 0
    save(folder / "depth" / "00.png", depth)
    pairs = read_depth_pairs(folder, SMALL, unit_m=0.001)
    found = target(pairs.samples[0], SMALL)
    assert found.shape == (1, 36, 48)
    assert np.allclose(found[0, :, :24], 100.0)
    assert np.allclose(found[0, :18, 24:], 0.0)
    assert np.allclose(found[0, 18:, 24:], 4.0)
    ramp = 10 / np.linspace(1, 4, 96)
    expected = ramp.reshape(48, 2).mean(axis=1)
    assert np.allclose(target(pairs.samples[1], SMALL)[0, 5], expected, rtol=2e-3)


def test_missing_damaged_and_mismatched_depth_is_left_out_and_named(tmp_path: Path) -> None:
    folder = depth_pairs(tmp_path, 8)
    (folder / "depth" / "01.png").unlink()
    (folder / "depth" / "02.png").write_bytes(b"no image")
    save(folder / "depth" / "03.png", np.full((72, 72), 2000, np.uint16))
    save(folder / "depth" / "04.png", np.zeros((72, 96), np.uint16))
    save(folder / "depth" / "05.png", np.full((36, 48), 2000, np.uint16))  # half the size: fine
    (folder / "images" / "06.png").write_bytes(b"")
    pairs = read_depth_pairs(folder, SMALL, unit_m=0.001)
    why = {Path(name).stem: reason for name, reason in pairs.left_out.items()}
    assert sorted(why) == ["01", "02", "03", "04", "06"]
    assert why["01"] == "has no depth file"
    assert "is not a one-channel depth image that can be read" in why["02"]
    assert "different aspects: 96x72 and 72x72" in why["03"]
    assert why["04"] == "has no known depth at all"
    assert len(pairs.samples) == 3
    for file in (folder / "depth").iterdir():
        file.unlink()
    with pytest.raises(UserError, match=r"no image with readable depth; images/00\.png"):
        read_depth_pairs(folder, SMALL, unit_m=0.001)


def test_a_wrong_unit_is_seen_by_the_median(tmp_path: Path) -> None:
    folder = depth_pairs(tmp_path, 3)
    with pytest.raises(UserError, match=r"median depth is 2\.5e\+03 m.*--unit-m 0\.001 would fit"):
        read_depth_pairs(folder, SMALL, unit_m=1.0)
    with pytest.raises(UserError, match=r"--unit-m 0\.001 would fit"):
        read_depth_pairs(folder, SMALL, unit_m=1e-5)
    with pytest.raises(CallError, match="give --unit-m"):
        read_depth_pairs(folder, SMALL)


def test_depth_beside_the_picture(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for number in range(3):
        save(tmp_path / f"{number}.png", room(rng, is_open=False))
        save(tmp_path / f"{number}_depth.png", np.full((72, 96), 2000, np.uint16))
    pairs = read_depth_pairs(tmp_path, SMALL, unit_m=0.001)
    assert [s.name for s in pairs.samples] == ["0.png", "1.png", "2.png"]
    assert pairs.median_m == 2.0


@pytest.mark.parametrize("zipped", [False, True])
def test_densedepth_s_own_layout(tmp_path: Path, zipped: bool) -> None:
    """8-bit training depth in 10/255 m, 16-bit test depth in millimetres, the scene as place."""
    rng = np.random.default_rng(0)
    train, test = [], []
    for scene in ("kitchen_0001", "office_0002"):
        for number in range(2):
            name = f"data/nyu2_train/{scene}/{number}"
            save(tmp_path / f"{name}.jpg", room(rng, is_open=True))
            save(tmp_path / f"{name}.png", np.full((72, 96), 51, np.uint8))
            train.append(f"{name}.jpg,{name}.png")
    name = "data/nyu2_test/00000"
    save(tmp_path / f"{name}_colors.png", room(rng, is_open=True))
    save(tmp_path / f"{name}_depth.png", np.full((72, 96), 4000, np.uint16))
    test.append(f"{name}_colors.png,{name}_depth.png")
    (tmp_path / "data" / "nyu2_train.csv").write_text("\n".join(train) + "\n")
    (tmp_path / "data" / "nyu2_test.csv").write_text("\n".join(test) + "\n")
    source = tmp_path
    if zipped:
        source = tmp_path / "nyu_data.zip"
        with zipfile.ZipFile(source, "w") as archive:
            for file in sorted((tmp_path / "data").rglob("*.*")):
                archive.write(file, file.relative_to(tmp_path))
    pairs = read_depth_pairs(source, SMALL, unpack=tmp_path / "out")
    assert len(pairs.samples) == 5 and len(set(pairs.groups)) == 3
    split = pairs.split(0.5, 0)
    kept, held = split.train, split.held
    assert [pairs.samples[i].name for i in held] == [f"{name}_colors.png"]
    assert target(pairs.samples[kept[0]], SMALL).mean() == pytest.approx(5.0)  # 51 counts: 2 m
    assert target(pairs.samples[held[0]], SMALL).mean() == pytest.approx(2.5)


def test_a_damaged_zip_and_one_that_reaches_outside(tmp_path: Path) -> None:
    path = tmp_path / "nyu.zip"
    path.write_bytes(b"PK nothing")
    with pytest.raises(UserError, match="is damaged"):
        read_depth_pairs(path, SMALL)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("../outside.txt", "x")
    with pytest.raises(UserError, match="outside of its own folder"):
        read_depth_pairs(path, SMALL)
    assert not (tmp_path.parent / "outside.txt").exists()


def test_one_pair_cannot_be_split(tmp_path: Path) -> None:
    pairs = read_depth_pairs(depth_pairs(tmp_path, 1), SMALL, unit_m=0.001)
    with pytest.raises(UserError, match="expected at least 2"):
        pairs.split(0.2, 0)


def test_mirroring_takes_picture_and_depth_along() -> None:
    image = np.arange(3 * 4 * 6, dtype=np.float32).reshape(3, 4, 6)
    truth = image[:1, ::2, ::2].copy()
    kinds = set()
    for seed in range(40):
        changed, map_ = augmented(image, truth, np.random.default_rng(seed))
        mirrored = not np.array_equal(map_, truth)
        assert np.array_equal(map_, truth[:, :, ::-1] if mirrored else truth)
        upright = changed[:, :, ::-1] if mirrored else changed
        assert sorted(upright[:, 0, 0]) == [0, 24, 48]
        kinds.add((mirrored, tuple(upright[:, 0, 0])))
    assert len(kinds) > 8
