"""ALSonar, ALTouch, ALFaceDetection and ALTracker of a virtual NAO."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from doorway3ds.lab.sim.robot.nao.memory import sonar, touch_sensors
from doorway3ds.lab.sim.robot.nao.service import Extractor, Service, asked

if TYPE_CHECKING:
    from doorway3ds.lab.sim.robot.nao.robot import VirtualNao

NEAR_M = 0.5


class Sonar(Extractor, name="ALSonar"):
    """ALSonar: distances in the simulated home, and events about what is nearer than half a metre.

    The events are raised while somebody subscribes.
    """

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._near: dict[str, bool] = {}
        self._heard_s = -math.inf

    def getFilteredValues(self) -> list[float]:
        return [sonar(self._nao, name) for name in self._nao.body.model.sonars]

    def getMemoryKeyList(self) -> list[str]:
        keys = self._nao.memory.getDataList("Device/SubDeviceList/")
        return [key for key in keys if "/US/" in key or "/Sonar/" in key]

    def getOutputNames(self) -> list[str]:
        return [*self.getMemoryKeyList(), *self.getEventList()]

    def getEventList(self) -> list[str]:
        kinds = ("Detected", "NothingDetected")
        return [f"Sonar{name}{kind}" for name in self._nao.body.model.sonars for kind in kinds]

    def _listen(self) -> None:
        """Raises events for what has changed."""
        now = self._nao.body.clock.now()
        if not self._subscribed or now - self._heard_s < self.getCurrentPeriod() / 1000:
            return
        self._heard_s = now
        for name in self._nao.body.model.sonars:
            metres = sonar(self._nao, name)
            if self._near.get(name) != (metres < NEAR_M):
                self._near[name] = metres < NEAR_M
                kind = "Detected" if self._near[name] else "NothingDetected"
                self._nao.memory.raiseEvent(f"Sonar{name}{kind}", metres)


class Touch(Service, name="ALTouch"):
    """ALTouch."""

    def getSensorList(self) -> list[str]:
        return touch_sensors(self._nao.body.model)

    def getStatus(self) -> list[list[Any]]:
        """[[sensor, touched], ...], as the event TouchChanged has it."""
        touched = self._nao.touched
        return [[name, bool(touched.get(name))] for name in self.getSensorList()]


class Battery(Service, name="ALBattery"):
    """ALBattery."""

    def getBatteryCharge(self) -> int:
        return int(self._nao.charge())


class FaceDetection(Extractor, name="ALFaceDetection"):
    """ALFaceDetection: nobody is in view, unless somebody raises FaceDetected."""

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._camera = 0
        self._known: list[str] = []

    def learnFace(self, name: str) -> bool:
        """Whether a face was in view to learn."""
        if not self._nao.memory.getData("FaceDetected"):
            return False
        self._known = [*self._known, name] if name not in self._known else self._known
        return True

    def reLearnFace(self, name: str) -> bool:
        return name in self._known and self.learnFace(name)

    def forgetPerson(self, name: str) -> bool:
        known = name in self._known
        self._known = [n for n in self._known if n != name]
        return known

    def getLearnedFacesList(self) -> list[str]:
        return list(self._known)

    def clearDatabase(self) -> bool:
        self._known = []
        return True

    def isProcessing(self) -> bool:
        return bool(self._subscribed) and not asked(self, "isPaused")

    def setActiveCamera(self, camera: int) -> bool:
        if camera not in (0, 1):
            return False
        self._camera = int(camera)
        return True

    def getActiveCamera(self) -> int:
        return self._camera

    def getEventList(self) -> list[str]:
        return ["FaceDetected"]

    getMemoryKeyList = getOutputNames = getEventList


class Tracker(Service, name="ALTracker"):
    """ALTracker: looks and points where it is told; no target is ever in view."""

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._targets: dict[str, Any] = {}
        self._active = ""

    def registerTarget(self, target: str, parameters: Any) -> None:
        self._targets[self._one("registerTarget", target, asked(self, "getSupportedTargets"))] = (
            parameters
        )

    def unregisterTarget(self, target: str) -> None:
        self._targets.pop(target, None)

    def unregisterTargets(self, targets: Any) -> None:
        for target in targets:
            self.unregisterTarget(target)

    def unregisterAllTargets(self) -> None:
        self._targets.clear()

    def getRegisteredTargets(self) -> list[str]:
        return list(self._targets)

    def track(self, target: str) -> None:
        if target not in self._targets:
            raise RuntimeError(f"ALTracker::track register {target} first")
        self._active = target
        self._nao.memory.raiseEvent("ALTracker/ActiveTargetChanged", target)
        self._nao.memory.raiseEvent("ALTracker/TargetLost", target)

    def trackEvent(self, event: str) -> None:
        self._active = event

    def stopTracker(self) -> None:
        self._active = ""
        self._nao.memory.raiseEvent("ALTracker/ActiveTargetChanged", "")

    def isActive(self) -> bool:
        return bool(self._active)

    def getActiveTarget(self) -> str:
        return self._active

    def lookAt(self, position: Any, *rest: Any) -> None:
        """(position, [frame,] fraction of the speed, whole body): turns the head to a point."""
        frame, fraction = _aimed("lookAt", rest, 2)
        x, y, z = self._from("HeadYaw", position, frame)
        yaw, pitch = math.atan2(y, x), math.atan2(-z, math.hypot(x, y))
        self._nao.services["ALMotion"].angleInterpolationWithSpeed(
            ["HeadYaw", "HeadPitch"], [yaw, pitch], fraction
        )

    def pointAt(self, effector: str, position: Any, *rest: Any) -> None:
        """("LArm" or "RArm", position, [frame,] fraction of the speed): an arm towards a point."""
        side = self._one("pointAt", effector, ("LArm", "RArm"))[0]
        frame, fraction = _aimed("pointAt", rest, 1)
        x, y, z = self._from(f"{side}ShoulderPitch", position, frame)
        pitch, roll = math.atan2(-z, x), math.atan2(y, math.hypot(x, z))
        joints = [f"{side}{j}" for j in ("ShoulderPitch", "ShoulderRoll", "ElbowRoll")]
        self._nao.services["ALMotion"].angleInterpolationWithSpeed(
            joints, [pitch, roll, 0.0], fraction
        )

    def _from(self, joint: str, position: Any, frame: int) -> tuple[float, float, float]:
        """A point as seen from a joint's place, along the torso's axes."""
        body = self._nao.body
        point = np.array([*(float(v) for v in position[:3]), 1.0])
        inside = np.linalg.inv(body.transform("Torso", frame)) @ point
        x, y, z = inside[:3] - body.transform(joint, 0)[:3, 3]
        return float(x), float(y), float(z)


def _aimed(method: str, rest: tuple[Any, ...], size: int) -> tuple[int, float]:
    """Frame (the torso's without one) and fraction of the speed."""
    if len(rest) not in (size, size + 1):
        raise RuntimeError(f"ALTracker::{method} expected {size} or {size + 1} more values")
    if len(rest) == size:
        return 0, float(rest[0])
    return int(rest[0]), float(rest[1])
