"""A virtual NAO: NAOqi's services on a real libqi session, backed by a simulated body and its eyes.

Names, arguments and values are NAOqi 2.8's: radians, metres, + left. A script that uses these calls
cannot tell the difference, nor can it do harm.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.sim.robot.body import Body
from doorway3ds.lab.sim.robot.nao import (  # noqa: F401  # their services declare themselves
    life,
    machine,
    motion,
    senses,
    speech,
    walk,
)
from doorway3ds.lab.sim.robot.nao.memory import Memory
from doorway3ds.lab.sim.robot.nao.service import services
from doorway3ds.lab.sim.robot.nao.video import Video

Picture = Callable[[str, int, int], NDArray[np.uint8]]
"""Camera ("CameraTop", "CameraBottom"), width, height -> (H, W, 3) RGB."""
Depth = Callable[[str, int, int], NDArray[np.float32]]
"""Camera ("CameraDepth"), width, height -> (H, W) metres."""

_BEAT_S = 0.05
_EMPTY_S = 5400.0
_AHEAD_DEG = 15.0


@dataclass
class Faults:
    """What goes wrong on purpose, from the next call on.

    null: no image. short: bytes missing from each image. frozen: the same image with the same
    stamp. hang_s: every image takes so long. stuck: `moveTo` never ends. clock_s: added to the
    stamps.
    """

    null: bool = False
    short: int = 0
    frozen: bool = False
    hang_s: float = 0.0
    stuck: bool = False
    clock_s: float = 0.0


@dataclass
class VirtualNao:
    """A robot that listens until it is closed.

    >>> nao = VirtualNao(Body(), picture)  # doctest: +SKIP
    >>> nao.listen("tcp://127.0.0.1:9559")  # doctest: +SKIP

    without: services that this robot lacks. depth: what a depth camera sees; None: it has none.
    touched: touch sensor -> 1.0 while it is touched.
    """

    body: Body
    picture: Picture
    faults: Faults = field(default_factory=Faults)
    without: tuple[str, ...] = ()
    on_speech: Callable[[str], None] = lambda text: None
    depth: Depth | None = None

    def __post_init__(self) -> None:
        self.said: list[str] = []
        self.touched: dict[str, float] = {}
        self.released = threading.Event()
        self.session: Any = None
        self._born_s = self.body.clock.now()
        self._feeling = threading.Lock()
        self._felt: float | None = None
        self._closing = threading.Event()
        kinds = services(self.body.model.name)
        self.services: dict[str, Any] = {name: kind(self) for name, kind in kinds.items()}
        self.services["ALSystem"].setRobotName(self.body.model.name)
        self.memory: Memory = self.services["ALMemory"]
        self.video: Video = self.services["ALVideoDevice"]

    def listen(self, url: str) -> str:
        """Serves at `url` (port 0: any free one) and returns where.

        It answers there only once all services are registered. Raises RuntimeError where the
        address is taken, ModuleNotFoundError without `qi`.
        """
        import qi

        qi.logging.setLevel(qi.logging.FATAL)
        self.session = qi.Session()
        self.session.listenStandalone("tcp://127.0.0.1:0")
        for name, service in self.services.items():
            if name not in self.without:
                self.session.registerService(name, service)
        known = set(self.session.endpoints())
        self.session.listen(url)
        threading.Thread(target=self._beat, name="virtual nao", daemon=True).start()
        return str(next(iter(set(self.session.endpoints()) - known), url))

    def charge(self) -> float:
        """Of the battery, in per cent."""
        return max(0.0, 100.0 * (1 - (self.body.clock.now() - self._born_s) / _EMPTY_S))

    def sense(self) -> None:
        """Raises the events of what the body has walked into or come away from."""
        memory, body = self.memory, self.body
        with self._feeling:
            touch = body.touch_deg
            if touch == self._felt:
                return
            before, self._felt = self._felt, touch
            for bumper in self._bumpers(before):
                memory.raiseEvent(bumper, 0.0)
            for bumper in self._bumpers(touch):
                memory.raiseEvent(bumper, 1.0)
            if touch is not None:
                x, y, _ = body.odometry()
                memory.raiseEvent("ALMotion/MoveFailed", ["Obstacle", 1, [x, y]])

    def close(self) -> None:
        self._closing.set()
        self.body.stop()
        self.released.set()
        self.memory._close()
        if self.session is not None:
            self.session.close()
            self.session = None

    def _bumpers(self, touch_deg: float | None) -> list[str]:
        """Those that are pressed by something at a bearing: both by what stands straight ahead."""
        if touch_deg is None:
            return []
        if abs(touch_deg) > 90:
            return ["BackBumperPressed"] if self.body.model.name == "pepper" else []
        out = ["LeftBumperPressed"] if touch_deg > -_AHEAD_DEG else []
        return [*out, "RightBumperPressed"] if touch_deg < _AHEAD_DEG else out

    def _beat(self) -> None:
        """What nobody asks for: walking into something, sonars that begin to hear it."""
        while not self._closing.wait(_BEAT_S):
            self.sense()
            self.services["ALSonar"]._listen()
