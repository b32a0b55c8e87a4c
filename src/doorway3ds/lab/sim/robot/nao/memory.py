"""ALMemory of a virtual NAO: values, devices, events, and how scripts hear of them.

Device/SubDeviceList/...: http://doc.aldebaran.com/2-8/family/nao_technical/nao_dcm/actuator_sensor_names.html
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any

from doorway3ds.camera.model import wrapped_deg
from doorway3ds.lab.sim.robot.model import Model, angles_of
from doorway3ds.lab.sim.robot.nao.service import HEARD, Service

if TYPE_CHECKING:
    from doorway3ds.lab.sim.robot.nao.robot import VirtualNao

_TYPES = {bool: "Bool", int: "Int", float: "Float", str: "String", list: "Array", bytes: "Binary"}
_G = 9.81


def touch_sensors(model: Model) -> list[str]:
    return [part for group in model.touches.values() for part in group]


def sonar(nao: VirtualNao, name: str) -> float:
    """Metres, within what the robot's sonars can tell."""
    least, most = nao.body.model.sonar_m
    return max(least, nao.body.sonar(nao.body.model.sonars[name], most))


def devices(nao: VirtualNao) -> dict[str, Callable[[], Any]]:
    """Key -> what reads it now."""
    body, base = nao.body, "Device/SubDeviceList/"
    out: dict[str, Callable[[], Any]] = {}
    for joint in body.model.joints:
        at = f"{base}{joint}/"
        out[f"{at}Position/Sensor/Value"] = partial(body.angle, joint)
        out[f"{at}Position/Actuator/Value"] = partial(body.goal, joint)
        out[f"{at}Hardness/Actuator/Value"] = partial(body.stiffness, joint)
        out[f"{at}ElectricCurrent/Sensor/Value"] = lambda j=joint: 0.1 * body.stiffness(j)  # type: ignore[misc]
        out[f"{at}Temperature/Sensor/Value"] = lambda: 38.0
        out[f"{at}Temperature/Sensor/Status"] = lambda: 0
    for name in body.model.sonars:
        if body.model.name == "nao":
            # There is but one echo, and the keys of the later ones hold 0.
            for echo in ("", "1"):
                out[f"{base}US/{name}/Sensor/Value{echo}"] = partial(sonar, nao, name)
            for echo in "23456789":
                out[f"{base}US/{name}/Sensor/Value{echo}"] = lambda: 0.0
        else:
            out[f"{base}Platform/{name}/Sonar/Sensor/Value"] = partial(sonar, nao, name)
    for part in touch_sensors(body.model):
        out[f"{base}{part}/Sensor/Value"] = partial(nao.touched.get, part, 0.0)
    out[f"{base}Battery/Charge/Sensor/Value"] = lambda: nao.charge() / 100
    out[f"{base}Battery/Charge/Sensor/TotalVoltage"] = lambda: 21.6 + 3.6 * nao.charge() / 100
    out[f"{base}Battery/Current/Sensor/Value"] = lambda: -1.2 if body.awake else -0.6
    out[f"{base}Battery/Temperature/Sensor/Value"] = lambda: 38.0
    for axis in "XYZ":
        for kind, read in (
            *(("Gyr", _gyro), ("Gyroscope", _gyro), ("Acc", _acceleration)),
            *(("Accelerometer", _acceleration), ("Angle", _lean)),
        ):
            out[f"{base}InertialSensor/{kind}{axis}/Sensor/Value"] = partial(read, nao, axis)
    if body.model.name == "nao":
        for foot in "LR":
            for where in ("FrontLeft", "FrontRight", "RearLeft", "RearRight"):
                out[f"{base}{foot}Foot/FSR/{where}/Sensor/Value"] = partial(_weight, nao, 1 / 8)
            out[f"{base}{foot}Foot/FSR/TotalWeight/Sensor/Value"] = partial(_weight, nao, 1 / 2)
    return out


def _lean(nao: VirtualNao, axis: str) -> float:
    """How the torso leans, rad."""
    if axis == "Z":
        return math.radians(wrapped_deg(nao.body.odometry()[2]))
    return angles_of(nao.body.transform("Torso", 2))["XY".index(axis)]


def _gyro(nao: VirtualNao, axis: str) -> float:
    return math.radians(nao.body.velocity()[2]) if axis == "Z" else 0.0


def _acceleration(nao: VirtualNao, axis: str) -> float:
    """Gravity in the torso's frame, m/s2; + up, so that a robot that stands reads -9.81 along Z."""
    return -_G * float(nao.body.transform("Torso", 2)[2, "XYZ".index(axis)])


def _weight(nao: VirtualNao, share: float) -> float:
    """kg on a sensor of a robot of 5.3 kg that stands on both feet."""
    standing = nao.body.posture not in nao.body.model.grounded
    return 5.3 * share if standing and nao.memory.getData("footContact") else 0.0


class Memory(Service, name="ALMemory"):
    """ALMemory."""

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._lock = threading.RLock()
        self._values: dict[str, Any] = {
            "footContact": 1.0,
            "LeftBumperPressed": 0.0,
            "RightBumperPressed": 0.0,
            "FaceDetected": [],
            **HEARD,
            "RobotConfig/Body/Type": nao.body.model.kind,
        }
        self._stamps: dict[str, float] = {}
        self._devices = devices(nao)
        self._touches = nao.body.model.touches
        self._events: set[str] = set()
        self._micro: set[str] = set()
        self._signals: dict[str, Any] = {}
        # Of each event: module -> (method, message).
        self._callbacks: dict[str, dict[str, tuple[str, str]]] = {}
        # One thread: events arrive in the order in which they were raised.
        self._herald = ThreadPoolExecutor(1, thread_name_prefix="events")

    # Values.

    def getData(self, key: str, deprecated: int = 0) -> Any:
        with self._lock:
            device = self._devices.get(key)
            if device is None:
                if key not in self._values:
                    raise RuntimeError(f"ALMemory::getData {key} was never set")
                return self._values[key]
        return device()

    def getListData(self, keys: Any) -> list[Any]:
        """A value for each key, None for one that was never set."""
        return [self.getData(k) if self._has(k) else None for k in keys]

    def getDataList(self, part: str) -> list[str]:
        """The keys that hold `part`."""
        return [key for key in self.getDataListName() if part in key]

    def getDataListName(self) -> list[str]:
        with self._lock:
            return sorted({*self._values, *self._devices})

    def getTimestamp(self, key: str) -> list[Any]:
        """[value, seconds, microseconds] of when it was set."""
        value = self.getData(key)
        when = self._stamps.get(key, time.time())
        return [value, int(when), int(when % 1 * 1e6)]

    def getType(self, key: str) -> str:
        return _TYPES.get(type(self.getData(key)), "Invalid")

    def insertData(self, key: str, value: Any) -> None:
        with self._lock:
            self._values[key] = value
            self._stamps[key] = time.time()

    def insertListData(self, pairs: Any) -> None:
        for key, value, *_ in pairs:
            self.insertData(key, value)

    def removeData(self, key: str) -> None:
        with self._lock:
            if key not in self._values:
                raise RuntimeError(f"ALMemory::removeData {key} was never set")
            del self._values[key]

    def _has(self, key: str) -> bool:
        with self._lock:
            return key in self._devices or key in self._values

    # Events.

    def declareEvent(self, name: str, extractor: str = "") -> None:
        with self._lock:
            self._events.add(name)

    def getEventList(self) -> list[str]:
        with self._lock:
            return sorted(self._events)

    def getMicroEventList(self) -> list[str]:
        with self._lock:
            return sorted(self._micro)

    def getSubscribers(self, name: str) -> list[str]:
        with self._lock:
            return sorted(self._callbacks.get(name, ()))

    def removeEvent(self, name: str) -> None:
        with self._lock:
            self._events.discard(name)
            self._micro.discard(name)
            self._callbacks.pop(name, None)

    removeMicroEvent = removeEvent

    def subscribeToEvent(self, name: str, module: str, *rest: str) -> None:
        """(name, module, method) or (name, module, message, method).

        The module's method is called with the event's name, its value and the message, without one
        the module's name.
        """
        if len(rest) not in (1, 2):
            raise RuntimeError(
                f"ALMemory::subscribeToEvent expected name, module[, message], method, got "
                f"{[name, module, *rest]}"
            )
        message = rest[0] if len(rest) == 2 else module
        with self._lock:
            self._events.add(name)
            self._callbacks.setdefault(name, {})[module] = (rest[-1], message)

    def subscribeToMicroEvent(self, name: str, module: str, message: str, method: str) -> None:
        self.subscribeToEvent(name, module, message, method)
        with self._lock:
            self._events.discard(name)
            self._micro.add(name)

    def unsubscribeToEvent(self, name: str, module: str) -> None:
        with self._lock:
            if self._callbacks.get(name, {}).pop(module, None) is None:
                raise RuntimeError(
                    f"ALMemory::unsubscribeToEvent {module} does not subscribe to {name}"
                )

    unsubscribeToMicroEvent = unsubscribeToEvent

    def subscriber(self, name: str) -> Any:
        """An object whose `signal` fires with the event's value."""
        import qi

        class Subscriber:
            def __init__(self) -> None:
                self.signal = qi.Signal("(m)")

        with self._lock:
            self._events.add(name)
            return self._signals.setdefault(name, Subscriber())

    def raiseMicroEvent(self, name: str, value: Any) -> None:
        with self._lock:
            self._micro.add(name)
        self._raise(name, value)

    def raiseEvent(self, name: str, value: Any) -> None:
        """As on the robot, also for whoever plays the sensors: a bumper, a touch, a fall."""
        if name == "robotHasFallen":
            self._nao.body.stop()
            self._nao.body.posture = "LyingBelly"
        with self._lock:
            self._events.add(name)
        parts = self._touches.get(name, ())
        for part in parts:
            self._nao.touched[part] = float(value)
        self._raise(name, value)
        if parts:
            self._raise("TouchChanged", [[part, bool(value)] for part in parts])

    def _raise(self, name: str, value: Any) -> None:
        self.insertData(name, value)
        with self._lock:
            signal = self._signals.get(name)
            callbacks = list(self._callbacks.get(name, {}).items())
        if signal is not None:
            signal.signal(value)
        for module, (method, message) in callbacks:
            self._herald.submit(self._call, module, method, name, value, message)

    def _call(self, module: str, method: str, name: str, value: Any, message: str) -> None:
        """Calls a module and does not wait for it; one that is gone is forgotten."""
        session = self._nao.session
        if session is None:
            return
        try:
            session.service(module).call(method, name, value, message, _async=True)
        except RuntimeError:
            with self._lock:
                self._callbacks.get(name, {}).pop(module, None)

    def _close(self) -> None:
        self._herald.shutdown(wait=False, cancel_futures=True)
