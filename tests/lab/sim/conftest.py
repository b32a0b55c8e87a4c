"""Hand-made homes, and a renderer where MuJoCo and an OpenGL driver are installed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.errors import UserError
from doorway3ds.lab.sim.homes.apartment import Home, Portal, Room
from doorway3ds.lab.sim.homes.furnish import Furnished
from doorway3ds.lab.sim.render.renderer import Eye, open_context

STYLE = {"day": 0.0, "sunny": 0.0, "sun_deg": 0.0, "sun_up_deg": 30.0, "trim": 0.0}


def two_rooms(*portals: Portal, wall_m: float = 0.12) -> Home:
    """Two rooms of 4 x 5 m side by side, the wall between them at x = 4."""
    rooms = (
        Room(0, "empty", 0.0, 0.0, 4.0, 5.0, lamps=((2.0, 2.5),)),
        Room(1, "empty", 4.0, 0.0, 8.0, 5.0, lamps=((6.0, 2.5),)),
    )
    return Home(1, rooms, portals, 2.5, wall_m, STYLE)


def bare(home: Home, **things: Any) -> Furnished:
    """The home with nothing in it but what is named."""
    empty: dict[str, Any] = dict.fromkeys(("standing", "hung", "mirrors", "rugs", "curtains"), ())
    return Furnished(home, **{**empty, **things})


def doorway(state: str = "no_leaf", at: float = 2.5, width: float = 0.9, **more: Any) -> Portal:
    return Portal(0, 4.0, at, width, 0.0, 2.05, (0, 1), state, **more)


@pytest.fixture(scope="session")
def gl() -> Iterator[Any]:
    """An off-screen OpenGL context, or a skip that says what is missing."""
    if find_spec("mujoco") is None:
        pytest.skip("needs the extra 'sim': pip install 'doorway3ds[sim]'")
    try:
        context = open_context()
    except UserError as error:
        pytest.skip(str(error))
    yield context
    context.free()


@pytest.fixture
def shoot(gl: Any) -> Callable[..., Any]:
    """Draws a furnished home: (furnished, camera, eye) -> Shot with an ideal sensor."""
    from doorway3ds.lab.sim.homes.plan import Plan
    from doorway3ds.lab.sim.pictures.dataset import take
    from doorway3ds.lab.sim.render.renderer import Renderer
    from doorway3ds.lab.sim.render.scene import build

    def call(furnished: Furnished, camera: Camera, eye: Eye) -> Any:
        scene = build(furnished.home, furnished=furnished)
        renderer = Renderer(scene, gl)
        try:
            return take(renderer, Plan(furnished), camera, eye, None)
        finally:
            renderer.close()

    return call


def level(x: float, y: float, heading_deg: float, height_m: float = 1.2, **pose: float) -> Eye:
    return Eye(x, y, heading_deg, Pose(height_m=height_m, **pose))


def camera(width: int = 320, height: int = 240, hfov_deg: float = 65.0) -> Camera:
    return Camera.from_fov(width, height, hfov_deg)


def tilted(rng: np.random.Generator) -> dict[str, float]:
    return {"pitch_deg": float(rng.uniform(-12, 12)), "roll_deg": float(rng.uniform(-3, 3))}
