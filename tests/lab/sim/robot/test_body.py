import math

import numpy as np
import pytest

from doorway3ds.camera.model import Pose
from doorway3ds.camera.presets import PRESETS
from doorway3ds.lab.sim.robot.body import MODELS, Body, FastClock, Gait
from doorway3ds.robots.nao.format import FRAME_ROBOT


def test_a_turn_of_25_degrees_slips_by_less_than_five() -> None:
    errors = []
    for seed in range(300):
        body = Body(clock=FastClock(), rng=np.random.default_rng(seed))
        assert body.wait(body.begin(0.0, 0.0, math.radians(25)))
        errors.append(body.place()[2] - 25)
        assert body.odometry()[2] == pytest.approx(25)
    assert max(np.abs(errors)) < 5
    assert 0.8 < np.std(errors) < 2.5


def test_stopped_half_way_it_stands_half_way() -> None:
    clock = FastClock()
    body = Body(clock=clock, gait=Gait(ramp_s=0.0, slip=0.0, slip_deg=0.0, speed_deg_s=30))
    number = body.begin(0.0, 0.0, math.radians(60))
    clock.sleep(1.0)
    assert body.moving
    body.stop()
    clock.sleep(1.0)
    assert body.place()[2] == pytest.approx(30)
    assert not body.wait(number)


def test_another_move_ends_the_first() -> None:
    body = Body(clock=FastClock())
    first = body.begin(0.0, 0.0, 1.0)
    second = body.begin(0.0, 0.0, 0.5)
    assert not body.wait(first)
    assert body.wait(second)


def test_walking_follows_the_heading() -> None:
    body = Body(1.0, 2.0, 90.0, clock=FastClock())
    body.wait(body.begin(0.5, 0.0, 0.0))
    assert body.place()[:2] == pytest.approx((1.0, 2.5))


@pytest.mark.parametrize(("model", "camera"), [("nao", "nao-v5-top"), ("pepper", "pepper-top")])
def test_the_lens_is_where_the_preset_has_it(model: str, camera: str) -> None:
    body = Body(model=MODELS[model])
    pose = Pose.from_transform(body.transform("CameraTop", FRAME_ROBOT))
    wanted = PRESETS[camera][1]
    assert pose.height_m == pytest.approx(wanted.height_m, abs=0.002)
    assert pose.forward_m == pytest.approx(wanted.forward_m, abs=0.002)
    assert pose.pitch_deg == pytest.approx(wanted.pitch_deg, abs=0.05)


def test_the_head_turns_left_and_looks_down_within_its_limits() -> None:
    clock = FastClock()
    body = Body(clock=clock)
    body.aim("HeadYaw", 0.5, 1.0)
    body.aim("HeadPitch", 9.0, 1.0)
    clock.sleep(0.25)
    assert body.angle("HeadYaw") == pytest.approx(0.25)
    clock.sleep(9.0)
    pose = Pose.from_transform(body.transform("CameraTop", FRAME_ROBOT))
    assert pose.yaw_deg == pytest.approx(math.degrees(0.5))
    assert pose.pitch_deg == pytest.approx(-math.degrees(0.5149 + 0.0209), abs=0.01)
