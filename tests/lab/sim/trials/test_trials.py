"""Scenes, episodes and their tables."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from doorway3ds.errors import CallError, UserError
from doorway3ds.lab.sim.trials import trials
from doorway3ds.lab.sim.trials.trial import Episode
from doorway3ds.lab.sim.trials.trials import difference, read_episodes, run_trials, summarise, table

BASE = Episode(
    scene="doorway", seed=0, method="opening", network="truth", outcome="aligned", why="",
    success=True, off_deg=1.0, clear=True, wrong_turns=0, without_door=False, when_blocked=False,
    goes=1, turns=1, looks=2, took_s=2.0,
)  # fmt: skip


def episodes() -> list[Episode]:
    """20 stages: opening fails in 2 of them, paper in 8, among them those 2."""
    out = []
    for seed in range(20):
        out.append(replace(BASE, seed=seed, success=seed >= 2))
        out.append(replace(BASE, seed=seed, method="paper", success=seed >= 8, wrong_turns=1))
    return out


def test_rows_count_and_have_intervals() -> None:
    rows = {(r.scene, r.method): r for r in summarise(episodes())}
    assert rows["doorway", "opening"].success.value == pytest.approx(0.9)
    assert rows["doorway", "paper"].total("wrong_turns") == 20
    assert 0.69 < rows["doorway", "opening"].success.low < 0.71  # Wilson, 18 of 20
    assert rows["all", "paper"].success == rows["doorway", "paper"].success


def test_the_difference_is_taken_on_the_same_stages() -> None:
    gap = difference(episodes())
    assert gap is not None
    assert gap.value == pytest.approx(0.3)
    assert 0.05 <= gap.low < 0.3 < gap.high <= 0.55
    alone = [e for e in episodes() if e.method == "opening"]
    assert difference(alone) is None


def test_the_table_names_scenes_and_methods() -> None:
    text = table(episodes())
    assert "| doorway | opening | 20 | 90 % (70 to 97) | 0 | 0 | 0 | 1.0 | 2.0 s |" in text
    assert "| all | +30 % (" in text


def test_episodes_of_another_version_are_refused(tmp_path: Path) -> None:
    (tmp_path / "episodes.jsonl").write_text('{"scene": "doorway"}\n{"cut')
    with pytest.raises(UserError, match="another version"):
        read_episodes(tmp_path)


def test_episodes_of_another_file_of_the_network_are_refused(tmp_path: Path) -> None:
    net = tmp_path / "a.onnx"
    for content, fits in ((b"one", True), (b"one", True), (b"two", False)):
        net.write_bytes(content)
        if fits:
            trials._require_same_files(tmp_path, str(net))
        else:
            with pytest.raises(UserError, match="another file"):
                trials._require_same_files(tmp_path, str(net))


def test_a_film_keeps_its_frames_and_their_times_and_is_small(tmp_path: Path) -> None:
    pytest.importorskip("PIL")
    from doorway3ds.lab.sim.trials.trial import _write

    rng = np.random.default_rng(0)
    still = np.repeat(rng.integers(0, 255, (60, 8, 3), np.uint8), 10, axis=1)
    moved = np.roll(still, 20, axis=1)
    path = _write(tmp_path / "a.gif", [still, moved, still], [1100, 120, 900])
    found, film = cv2.imreadanimation(str(path))
    assert found
    assert list(film.durations) == [1100, 120, 900]
    shown = film.frames[0][..., 2::-1].astype(int)
    assert np.abs(shown - still).mean() < 40
    assert path.stat().st_size < still.nbytes


@pytest.fixture(scope="module")
def studio() -> Iterator[Any]:
    if find_spec("mujoco") is None:
        pytest.skip("needs the extra 'sim': pip install 'doorway3ds[sim]'")
    from doorway3ds.lab.sim.robot.world import Studio

    try:
        room = Studio((320, 240), plain=True)
    except UserError as error:
        pytest.skip(str(error))
    with room:
        yield room


@pytest.mark.sim
def test_a_scene_is_the_same_each_time_and_shows_what_it_says(studio: Any) -> None:
    from doorway3ds.lab.sim.robot.world import World, stage_of

    stage = stage_of(studio, "doorway", 5)
    world = World(studio, stage)
    truth = studio.truth(stage.home, world.body.camera(320, 240), world.eye())[1]
    assert [(o.cut, o.clear) for o in truth.openings] == [(None, True)]
    again = stage_of(studio, "doorway", 5)
    assert again == stage
    with pytest.raises(CallError, match="expected a scene"):
        stage_of(studio, "volcano", 5)


@pytest.mark.sim
@pytest.mark.parametrize(("scene", "ends"), [("stairs_down", {"no_door", "blocked"}),
                                             ("person", {"blocked"})])  # fmt: skip
def test_with_true_perception_it_goes_to_no_hazard(studio: Any, scene: str, ends: set[str]) -> None:
    from doorway3ds.lab.sim.robot.world import stage_of
    from doorway3ds.lab.sim.trials.trial import play

    stage = stage_of(studio, scene, 3)
    assert set(stage.ends) == ends
    episode = play(studio, stage, "opening")
    assert (episode.success, episode.goes) == (True, 0), episode


@pytest.mark.parametrize(("outcome", "off", "went", "right"), [
    ("aligned", 2.0, True, True), ("aligned", 8.0, True, False), ("blocked", None, False, True),
    ("blocked", None, True, True), ("no_door", None, False, False),
])  # fmt: skip
def test_a_grazing_way_may_be_taken_or_left(
    outcome: str, off: float | None, went: bool, right: bool
) -> None:
    from doorway3ds.lab.sim.stages.scenarios import Stage
    from doorway3ds.lab.sim.trials.trial import _succeeded
    from doorway3ds.robots.loop import Outcome

    stage = Stage("grazing", 0, None, None)  # type: ignore[arg-type]
    assert _succeeded(stage, Outcome(outcome), off, went) is right


@pytest.mark.sim
def test_a_robot_that_stands_still_sees_the_same_scene_with_other_noise(studio: Any) -> None:
    from doorway3ds.lab.sim.robot.world import World, stage_of

    world = World(studio, stage_of(studio, "doorway", 5))
    one, two = world.shot(320, 240), world.shot(320, 240)
    assert two.depth is one.depth
    assert 0 < abs(one.rgb.astype(int) - two.rgb).mean() < 20
    world.body.begin(0.0, 0.0, 0.2)
    world.body.clock.sleep(1.5)
    world.body.stop()
    assert world.shot(320, 240).depth is not one.depth


@pytest.mark.sim
def test_with_true_perception_the_robot_ends_facing_the_doorway(studio: Any) -> None:
    from doorway3ds.lab.sim.robot.world import stage_of
    from doorway3ds.lab.sim.trials.trial import play

    episode = play(studio, stage_of(studio, "doorway", 5), "opening")
    assert (episode.outcome, episode.success) == ("aligned", True)
    assert episode.off_deg is not None
    assert episode.off_deg <= 5
    assert episode.took_s < 60


@pytest.mark.sim
def test_a_trial_that_was_cut_goes_on(studio: Any, tmp_path: Path) -> None:
    first = run_trials(tmp_path, ["no_door"], 1, methods=("opening",), workers=1)
    assert [e.outcome for e in first] == ["no_door"]
    line = (tmp_path / "episodes.jsonl").read_text()
    (tmp_path / "episodes.jsonl").write_text(line[: len(line) // 2])
    assert run_trials(tmp_path, ["no_door"], 1, methods=("opening",), workers=1) == first
    assert read_episodes(tmp_path) == first
