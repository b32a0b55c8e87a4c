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
from doorway3ds.lab.sim.robot.naomotion import Motion, Posture
from doorway3ds.lab.sim.robot.naoservice import Service
from doorway3ds.lab.sim.robot.naovideo import Video

Picture = Callable[[str, int, int], NDArray[np.uint8]]
"""Camera ("CameraTop", "CameraBottom"), width, height -> (H, W, 3) RGB."""


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


class Speech(Service):
    """ALTextToSpeech: what was said is kept and handed to `VirtualNao.on_speech`."""

    def say(self, text: str) -> None:
        self._nao.said.append(text)
        self._nao.on_speech(text)
        self._nao.body.clock.sleep(min(0.05 * len(text), 3.0))


class Memory(Service):
    """ALMemory: values, events, and the objects through which scripts hear of them."""

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._lock = threading.Lock()
        self._values: dict[str, Any] = {
            "footContact": 1.0,
            "LeftBumperPressed": 0.0,
            "RightBumperPressed": 0.0,
            "RobotConfig/Body/Type": {"nao": "nao", "pepper": "juliette"}[nao.body.model.name],
        }
        self._subscribers: dict[str, Any] = {}

    def getData(self, key: str) -> Any:
        with self._lock:
            if key not in self._values:
                raise RuntimeError(f"ALMemory::getData {key} was never set")
            return self._values[key]

    def insertData(self, key: str, value: Any) -> None:
        with self._lock:
            self._values[key] = value

    def getDataListName(self) -> list[str]:
        with self._lock:
            return sorted(self._values)

    def subscriber(self, name: str) -> Any:
        import qi

        class Subscriber:
            def __init__(self) -> None:
                self.signal = qi.Signal("(m)")

        with self._lock:
            return self._subscribers.setdefault(name, Subscriber())

    def raiseEvent(self, name: str, value: Any) -> None:
        """As on the robot, also for whoever plays the sensors: a bumper, a fall, lost ground."""
        if name == "robotHasFallen":
            self._nao.body.stop()
            self._nao.body.posture = "LyingBelly"
        self.insertData(name, value)
        with self._lock:
            subscriber = self._subscribers.get(name)
        if subscriber is not None:
            subscriber.signal(value)


@dataclass
class VirtualNao:
    """A robot that listens until it is closed.

    >>> nao = VirtualNao(Body(), picture)  # doctest: +SKIP
    >>> nao.listen("tcp://127.0.0.1:9559")  # doctest: +SKIP

    without: services that this robot lacks.
    """

    body: Body
    picture: Picture
    faults: Faults = field(default_factory=Faults)
    without: tuple[str, ...] = ()
    on_speech: Callable[[str], None] = lambda text: None

    def __post_init__(self) -> None:
        self.said: list[str] = []
        self.released = threading.Event()
        self.memory = Memory(self)
        self.video = Video(self)
        self._session: Any = None

    def listen(self, url: str) -> str:
        """Serves at `url` (port 0: any free one) and returns where.

        It answers there only once all services are registered. Raises RuntimeError where the
        address is taken, ModuleNotFoundError without `qi`.
        """
        import qi

        qi.logging.setLevel(qi.logging.FATAL)
        self._session = qi.Session()
        self._session.listenStandalone("tcp://127.0.0.1:0")
        services = {
            "ALMotion": Motion(self),
            "ALRobotPosture": Posture(self),
            "ALTextToSpeech": Speech(self),
            "ALMemory": self.memory,
            "ALVideoDevice": self.video,
        }
        for name, service in services.items():
            if name not in self.without:
                self._session.registerService(name, service)
        known = set(self._session.endpoints())
        self._session.listen(url)
        return str(next(iter(set(self._session.endpoints()) - known), url))

    def close(self) -> None:
        self.body.stop()
        self.released.set()
        if self._session is not None:
            self._session.close()
            self._session = None
