"""ALAutonomousLife, ALBasicAwareness and ALBehaviorManager of a virtual NAO.

State is kept and answered for; the robot does nothing on its own.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from doorway3ds.lab.sim.robot.nao.service import Service, asked

if TYPE_CHECKING:
    from doorway3ds.lab.sim.robot.nao.robot import VirtualNao


class AutonomousLife(Service, name="ALAutonomousLife"):
    """ALAutonomousLife: disabled when the robot starts."""

    _STATES = ("solitary", "interactive", "disabled", "safeguard")
    _ABILITIES = (
        "AutonomousBlinking", "BackgroundMovement", "BasicAwareness", "ListeningMovement",
        "SpeakingMovement",
    )  # fmt: skip

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._state, self._focus = "disabled", ""
        self._abilities = dict.fromkeys(self._ABILITIES, True)
        self._history: list[tuple[str, int]] = [("disabled", int(time.time()))]

    def getState(self) -> str:
        return self._state

    def setState(self, state: str) -> None:
        self._one("setState", state, self._STATES)
        if (self._state, state) == ("interactive", "solitary"):
            raise RuntimeError("ALAutonomousLife::setState cannot go from interactive to solitary")
        if state in ("disabled", "safeguard"):
            self.stopAll()
        if state != self._state:
            self._state = state
            self._history.append((state, int(time.time())))
            self._nao.memory.raiseEvent("AutonomousLife/State", state)

    def getStateHistory(self, depth: int = 0) -> list[list[Any]]:
        return [list(entry) for entry in self._history[-depth:]]

    def focusedActivity(self) -> str:
        return self._focus

    def switchFocus(self, activity: str, flags: int = 0) -> None:
        if self._state == "disabled":
            raise RuntimeError("ALAutonomousLife::switchFocus not while it is disabled")
        self._focus = activity
        self._nao.memory.raiseEvent("AutonomousLife/FocusedActivity", activity)

    def stopFocus(self) -> None:
        self._focus = ""

    stopAll = stopFocus

    def getAutonomousAbilityEnabled(self, ability: str) -> bool:
        return self._abilities.get(ability, False)

    def setAutonomousAbilityEnabled(self, ability: str, enabled: bool) -> None:
        self._one("setAutonomousAbilityEnabled", ability, ("All", *self._ABILITIES))
        for name in self._abilities if ability == "All" else (ability,):
            self._abilities[name] = bool(enabled)

    def getAutonomousAbilitiesStatus(self) -> list[list[Any]]:
        """[[name, enabled, running], ...]."""
        alive = self._state != "disabled"
        return [[name, on, on and alive] for name, on in self._abilities.items()]

    def getLifeTime(self) -> int:
        return int(time.time()) - self._history[0][1]


class BasicAwareness(Service, name="ALBasicAwareness"):
    """ALBasicAwareness."""

    _paused = False

    def isAwarenessRunning(self) -> bool:
        return bool(asked(self, "isEnabled"))

    def isRunning(self) -> bool:
        return self.isAwarenessRunning() and not self._paused

    def startAwareness(self) -> None:
        asked(self, "setEnabled", True)

    def stopAwareness(self) -> None:
        asked(self, "setEnabled", False)

    def pauseAwareness(self) -> None:
        self._paused = True

    def resumeAwareness(self) -> None:
        self._paused = False

    def isAwarenessPaused(self) -> bool:
        return self._paused

    def resetAllParameters(self) -> None:
        self._unset("getParameter")


class BehaviorManager(Service, name="ALBehaviorManager"):
    """ALBehaviorManager: the animations that each robot brings; they run and move nothing."""

    _TOOK_S = 1.0

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._installed: list[str] = asked(self, "getInstalledBehaviors")
        self._until: dict[str, float] = {}
        self._defaults: list[str] = []

    def isBehaviorInstalled(self, name: str) -> bool:
        return name in self._installed

    isBehaviorPresent = preloadBehavior = isBehaviorInstalled

    def startBehavior(self, name: str) -> None:
        """Starts it and does not wait."""
        if name not in self._installed:
            raise RuntimeError(f"ALBehaviorManager::startBehavior {name} is not installed")
        self._until[name] = self._nao.body.clock.now() + self._TOOK_S

    def runBehavior(self, name: str) -> None:
        """Runs it to its end, or until it is stopped."""
        self.startBehavior(name)
        while self.isBehaviorRunning(name):
            self._nao.body.clock.sleep(0.05)

    def stopBehavior(self, name: str) -> None:
        self._until.pop(name, None)

    def stopAllBehaviors(self) -> None:
        self._until.clear()

    def isBehaviorRunning(self, name: str) -> bool:
        return self._until.get(name, 0.0) > self._nao.body.clock.now()

    isBehaviorLoaded = isBehaviorRunning

    def getRunningBehaviors(self) -> list[str]:
        return [name for name in self._installed if self.isBehaviorRunning(name)]

    getLoadedBehaviors = getRunningBehaviors

    def getDefaultBehaviors(self) -> list[str]:
        return list(self._defaults)

    def addDefaultBehavior(self, name: str) -> None:
        self._defaults.append(name)

    def removeDefaultBehavior(self, name: str) -> None:
        if name in self._defaults:
            self._defaults.remove(name)
