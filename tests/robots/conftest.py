"""A virtual NAO on a real libqi session, whose eyes see a wall with an opening painted on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from doorway3ds.lab.sim.robot.body import Body, Gait

FAST = Gait(speed_deg_s=120.0, ramp_s=0.05)


def picture(part: str, width: int, height: int) -> np.ndarray:
    image = np.zeros((height, width, 3), np.uint8)
    image[:, : width // 2] = (200, 60, 20)
    image[: height // 2, :, 2] = 120
    return image


@pytest.fixture
def virtual() -> Iterator[Callable[..., Any]]:
    """Starts virtual robots: virtual(**VirtualNao's options) -> (robot, "127.0.0.1:port")."""
    pytest.importorskip("qi", reason="needs the extra 'nao': the qi package")
    from doorway3ds.lab.sim.robot.nao import VirtualNao

    running = []

    def start(**options: Any) -> tuple[VirtualNao, str]:
        nao = VirtualNao(options.pop("body", Body(gait=FAST)), picture, **options)
        running.append(nao)
        return nao, nao.listen("tcp://127.0.0.1:0").removeprefix("tcp://")

    yield start
    for nao in running:
        nao.close()
