"""ALVideoDevice of a virtual NAO."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.sim.robot.naoservice import Service, returns
from doorway3ds.robots.nao.format import BYTES, COLOURS, SIZES

if TYPE_CHECKING:
    from doorway3ds.lab.sim.robot.nao import VirtualNao

_CAMERAS = {0: "CameraTop", 1: "CameraBottom"}


@dataclass
class _Subscription:
    camera: int
    resolution: int
    colour: int
    fps: int
    last: tuple[float, Any] | None = None


class Video(Service):
    """ALVideoDevice."""

    _MOST = 6  # of one name

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._lock = threading.Lock()
        self._open: dict[str, _Subscription] = {}
        self._latest: dict[tuple[int, int, int], Any] = {}

    def subscribeCamera(
        self, name: str, camera: int, resolution: int, colour: int, fps: int
    ) -> str:
        known = camera in _CAMERAS and resolution in SIZES and colour in BYTES
        if not known or not 1 <= fps <= 30:
            return ""
        with self._lock:
            for number in range(self._MOST):
                handle = f"{name}_{number}"
                if handle not in self._open:
                    self._open[handle] = _Subscription(camera, resolution, colour, fps)
                    return handle
        return ""

    def unsubscribe(self, handle: str) -> bool:
        with self._lock:
            return self._open.pop(handle, None) is not None

    def getSubscribers(self) -> list[str]:
        with self._lock:
            return sorted(self._open)

    @returns("+(iiiiiiriffff)")
    def getImageRemote(self, handle: str) -> Any:
        """The container, or nothing for an unknown handle, as on the robot."""
        faults = self._nao.faults
        with self._lock:
            subscription = self._open.get(handle)
        if faults.hang_s:
            time.sleep(faults.hang_s)
        if subscription is None or faults.null:
            return None
        now = time.time() + faults.clock_s
        last = subscription.last
        if last is not None and 0 <= now - last[0] < 1 / subscription.fps:
            return last[1]
        # A camera that froze gives its last picture to new subscribers, too.
        kind = (subscription.camera, subscription.resolution, subscription.colour)
        if faults.frozen and kind in self._latest:
            return self._latest[kind]
        container = self._photograph(subscription, now, faults.short)
        subscription.last = (now, container)
        self._latest[kind] = container
        return container

    def releaseImage(self, handle: str) -> bool:
        with self._lock:
            return handle in self._open

    def _photograph(self, asked: _Subscription, now: float, short: int) -> tuple[Any, ...]:
        width, height = SIZES[asked.resolution]
        rgb = self._nao.picture(_CAMERAS[asked.camera], width, height)
        pixels = _coloured(rgb, asked.colour).tobytes()
        across, down = (math.radians(v) / 2 for v in self._nao.body.model.fov_deg)
        return (
            width, height, BYTES[asked.colour], asked.colour, int(now), int(now % 1 * 1e6),
            pixels[: len(pixels) - short], asked.camera, across, down, -across, -down,
        )  # fmt: skip


def _coloured(rgb: NDArray[np.uint8], colour: int) -> NDArray[np.uint8]:
    if colour == COLOURS["rgb"]:
        return np.ascontiguousarray(rgb)
    if colour == COLOURS["bgr"]:
        return np.ascontiguousarray(rgb[..., ::-1])
    if colour == COLOURS["grey"]:
        return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)
    yuv = cv2.cvtColor(rgb, cv2.COLOR_RGB2YUV_YUY2)
    return np.asarray(yuv, np.uint8)
