"""A virtual NAO: NAOqi's services on a real libqi session, backed by a simulated body and its eyes.

Names, arguments and values are NAOqi 2.8's: radians, metres, + left. A script that uses these calls
cannot tell the difference, nor can it do harm.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.robots.naoformat import BYTES, COLOURS, SIZES
from doorway3ds.sim.body import Body

Picture = Callable[[str, int, int], NDArray[np.uint8]]
"""Camera ("CameraTop", "CameraBottom"), width, height -> (H, W, 3) RGB."""

_CAMERAS = {0: "CameraTop", 1: "CameraBottom"}
_JOINTS = ("HeadYaw", "HeadPitch")
_HEAD_SPEED = 1.5  # rad/s at full speed
_POSTURES = ("StandInit", "Stand", "StandZero", "Crouch")


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


def _returns(signature: str) -> Callable[[Any], Any]:
    """Declares a method's return signature to qi, as `qi.bind` does, without importing it."""

    def mark(method: Any) -> Any:
        method.__qi_name__, method.__qi_signature__ = None, None
        method.__qi_return_signature__ = signature
        return method

    return mark


class _Service:
    # Calls run at the same time: stopMove must not wait for moveTo.
    __qi_threading__ = "multi"

    def __init__(self, nao: VirtualNao) -> None:
        self._nao = nao


class Motion(_Service):
    """ALMotion."""

    def wakeUp(self) -> None:
        self._nao.body.awake, self._nao.body.stiffness = True, 1.0

    def rest(self) -> None:
        self._nao.body.stop()
        self._nao.body.awake, self._nao.body.stiffness = False, 0.0
        self._nao.body.posture = "Crouch"

    def robotIsWakeUp(self) -> bool:
        return self._nao.body.awake

    def setStiffnesses(self, names: Any, values: Any) -> None:
        first = values[0] if isinstance(values, list | tuple) else values
        self._nao.body.stiffness = float(first)

    def getStiffnesses(self, names: Any) -> list[float]:
        return [self._nao.body.stiffness for _ in _joints(names)]

    def getAngles(self, names: Any, sensors: bool) -> list[float]:
        return [self._nao.body.angle(name) for name in _joints(names)]

    def setAngles(self, names: Any, angles: Any, fraction: float) -> None:
        joints = _joints(names)
        for name, angle in zip(joints, _list(angles, len(joints)), strict=True):
            self._nao.body.aim(name, float(angle), float(fraction) * _HEAD_SPEED)

    def angleInterpolation(self, names: Any, angles: Any, times: Any, absolute: bool) -> None:
        body, joints = self._nao.body, _joints(names)
        goals, spans = _list(angles, len(joints)), _list(times, len(joints))
        longest = 0.0
        for name, goal, span in zip(joints, goals, spans, strict=True):
            # Each joint may have one goal or a list of them; the last one counts here.
            angle, took = float(_last(goal)), float(_last(span))
            angle += 0.0 if absolute else body.angle(name)
            body.aim(name, angle, abs(angle - body.angle(name)) / max(took, 1e-3))
            longest = max(longest, took)
        body.clock.sleep(longest)

    @_returns("[f]")
    def getTransform(self, name: str, frame: int, sensors: bool) -> list[float]:
        return [float(v) for v in self._nao.body.transform(name, int(frame)).ravel()]

    @_returns("[f]")
    def getPosition(self, name: str, frame: int, sensors: bool) -> list[float]:
        m = self._nao.body.transform(name, int(frame))
        angles = (
            math.atan2(m[2, 1], m[2, 2]),
            math.asin(float(np.clip(-m[2, 0], -1, 1))),
            math.atan2(m[1, 0], m[0, 0]),
        )
        return [*(float(v) for v in m[:3, 3]), *angles]

    @_returns("[f]")
    def getRobotPosition(self, sensors: bool) -> list[float]:
        x, y, heading = self._nao.body.odometry()
        return [x, y, math.radians((heading + 180) % 360 - 180)]

    def moveInit(self) -> None:
        self._nao.body.posture = "StandInit"

    def moveTo(self, x: float, y: float, theta: float) -> bool:
        nao = self._nao
        if not nao.body.awake:
            raise RuntimeError("ALMotion::moveTo the robot is not awake")
        number = nao.body.begin(float(x), float(y), float(theta))
        if nao.faults.stuck:
            nao.body.stop()
            nao.released.wait(60)
            return False
        return nao.body.wait(number)

    def moveToward(self, x: float, y: float, theta: float) -> None:
        body, gait = self._nao.body, self._nao.body.gait
        if not body.awake:
            raise RuntimeError("ALMotion::moveToward the robot is not awake")
        if not any((x, y, theta)):
            body.stop()
            return
        span = 60.0  # it goes on until stopped; nobody lets it go on for longer
        body.begin(
            x * gait.speed_m_s * span, y * gait.speed_m_s * span,
            math.radians(theta * gait.speed_deg_s * span),
        )  # fmt: skip

    def stopMove(self) -> None:
        self._nao.body.stop()
        self._nao.released.set()
        self._nao.released.clear()

    def moveIsActive(self) -> bool:
        return self._nao.body.moving

    def waitUntilMoveIsFinished(self) -> None:
        while self._nao.body.moving:
            self._nao.body.clock.sleep(0.02)


class Posture(_Service):
    """ALRobotPosture."""

    def goToPosture(self, name: str, speed: float) -> bool:
        body = self._nao.body
        if name not in _POSTURES:
            return False
        if body.posture != name:
            body.clock.sleep(0.6 / max(float(speed), 0.1))
        body.posture, body.awake, body.stiffness = name, True, 1.0
        for joint in _JOINTS:
            body.aim(joint, 0.0, _HEAD_SPEED)
        return True

    def getPosture(self) -> str:
        return self._nao.body.posture

    def getPostureList(self) -> list[str]:
        return list(_POSTURES)


class Speech(_Service):
    """ALTextToSpeech: what was said is kept and handed to `VirtualNao.on_speech`."""

    def say(self, text: str) -> None:
        self._nao.said.append(text)
        self._nao.on_speech(text)
        self._nao.body.clock.sleep(min(0.05 * len(text), 3.0))


class Memory(_Service):
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
class _Subscription:
    camera: int
    resolution: int
    colour: int
    fps: int
    last: tuple[float, Any] | None = None


class Video(_Service):
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

    @_returns("+(iiiiiiriffff)")
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


def _joints(names: Any) -> list[str]:
    wanted = [names] if isinstance(names, str) else list(names)
    out: list[str] = []
    for name in wanted:
        out += _JOINTS if name in ("Head", "Body") else (name,)
    unknown = [name for name in out if name not in _JOINTS]
    if unknown:
        raise RuntimeError(f"ALMotion: unknown joint {unknown[0]}; this robot moves {_JOINTS}")
    return out


def _list(values: Any, size: int) -> list[Any]:
    out = list(values) if isinstance(values, list | tuple) else [values] * size
    if len(out) != size:
        raise RuntimeError(f"ALMotion: expected {size} values, got {len(out)}")
    return out


def _last(value: Any) -> Any:
    return value[-1] if isinstance(value, list | tuple) else value


def _coloured(rgb: NDArray[np.uint8], colour: int) -> NDArray[np.uint8]:
    if colour == COLOURS["rgb"]:
        return np.ascontiguousarray(rgb)
    if colour == COLOURS["bgr"]:
        return np.ascontiguousarray(rgb[..., ::-1])
    if colour == COLOURS["grey"]:
        return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)
    yuv = cv2.cvtColor(rgb, cv2.COLOR_RGB2YUV_YUY2)
    return np.asarray(yuv, np.uint8)
