"""ALLeds, ALPhotoCapture and ALSystem of a virtual NAO."""

from __future__ import annotations

import math
import re
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from doorway3ds.lab.sim.robot.nao.service import VERSION, Service, asked
from doorway3ds.lab.sim.robot.nao.video import CAMERAS, SIZES

if TYPE_CHECKING:
    from doorway3ds.lab.sim.robot.nao.robot import VirtualNao

Colour = tuple[float, float, float]
_NAMES: dict[str, Colour] = {
    "white": (1, 1, 1), "red": (1, 0, 0), "green": (0, 1, 0), "blue": (0, 0, 1),
    "yellow": (1, 1, 0), "magenta": (1, 0, 1), "cyan": (0, 1, 1),
}  # fmt: skip
_RASTA = (0x00FF00, 0xFFFF00, 0xFF0000)


def _groups() -> dict[str, list[str]]:
    """Group -> LEDs."""
    eyes = {side: [f"{side}FaceLed{k}" for k in range(1, 9)] for side in ("Right", "Left")}
    ears = {side: [f"{side}EarLed{k}" for k in range(1, 11)] for side in ("Right", "Left")}
    brain = [f"Brain{k}" for k in range(12)]
    feet = {side: [f"{side}FootLed"] for side in ("Right", "Left")}
    groups = {
        "FaceLeds": eyes["Right"] + eyes["Left"],
        "EarLeds": ears["Right"] + ears["Left"],
        "BrainLeds": brain,
        "BrainLedsRight": brain[:6], "BrainLedsLeft": brain[6:],
        "BrainLedsFront": [brain[k] for k in (0, 1, 10, 11)],
        "BrainLedsMiddle": [brain[k] for k in (2, 9)],
        "BrainLedsBack": brain[3:9],
        "ChestLeds": ["ChestLed"],
        "FeetLeds": feet["Right"] + feet["Left"],
    }  # fmt: skip
    for side in ("Right", "Left"):
        groups[f"{side}FaceLeds"] = eyes[side]
        groups[f"{side}EarLeds"] = ears[side]
        groups[f"{side}FootLeds"] = feet[side]
    for k in range(8):
        right, left = eyes["Right"][7 - k], eyes["Left"][k]
        groups[f"FaceLedRight{k}"], groups[f"FaceLedLeft{k}"] = [right], [left]
        groups[f"FaceLed{k}"] = [right, left]
    groups["AllLeds"] = sorted({led for leds in groups.values() for led in leds})
    return groups


class Leds(Service, name="ALLeds"):
    """ALLeds: colours are kept, fading takes its time."""

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._groups = _groups()
        self._colours: dict[str, Colour] = dict.fromkeys(self._groups["AllLeds"], (1.0, 1.0, 1.0))

    def listGroups(self) -> list[str]:
        return sorted(self._groups)

    def listGroup(self, name: str) -> list[str]:
        return self._leds(name)

    def listLEDs(self) -> list[str]:
        return list(self._colours)

    listLED = listGroup

    def createGroup(self, name: str, leds: Any) -> None:
        self._groups[name] = [led for part in leds for led in self._leds(part)]

    def on(self, name: str) -> None:
        self.setIntensity(name, 1.0)

    def off(self, name: str) -> None:
        self.setIntensity(name, 0.0)

    reset = on

    def setIntensity(self, name: str, intensity: float) -> None:
        self._paint(name, (intensity,) * 3, 0.0)

    def getIntensity(self, name: str) -> list[Any]:
        """[[LED, [red, green, blue] in 0..1], ...]."""
        return [[led, list(self._colours[led])] for led in self._leds(name)]

    def fade(self, name: str, intensity: float, duration: float) -> None:
        self._paint(name, (intensity,) * 3, duration)

    def fadeRGB(self, name: str, *rest: Any) -> None:
        """(name, 0xRRGGBB or a colour's name, seconds) or (name, red, green, blue, seconds)."""
        if len(rest) == 2:
            self._paint(name, _colour(rest[0]), rest[1])
        elif len(rest) == 4:
            self._paint(name, (float(rest[0]), float(rest[1]), float(rest[2])), rest[3])
        else:
            raise RuntimeError(f"ALLeds::fadeRGB expected a colour and seconds, got {list(rest)}")

    def fadeListRGB(self, name: str, colours: Any, times: Any) -> None:
        if len(colours) != len(times):
            raise RuntimeError("ALLeds::fadeListRGB expected as many times as colours")
        past = 0.0
        for colour, when in zip(colours, times, strict=True):
            self._paint(name, _colour(colour), float(when) - past)
            past = float(when)

    def rasta(self, duration: float) -> None:
        for colour in _RASTA:
            self._paint("FaceLeds", _colour(colour), duration / len(_RASTA))

    def rotateEyes(self, rgb: int, rotation: float, duration: float) -> None:
        """One LED of each eye after the other, for `duration` seconds."""
        if rotation <= 0:
            raise RuntimeError(f"ALLeds::rotateEyes expected a time above 0, got {rotation}")
        for step in range(max(1, math.ceil(8 * duration / rotation))):
            self.off("FaceLeds")
            self._paint(f"FaceLed{step % 8}", _colour(rgb), rotation / 8)

    def randomEyes(self, duration: float) -> None:
        """Colours that change five times a second; the same ones each time."""
        for step in range(max(1, int(5 * duration))):
            for k in range(8):
                self._paint(f"FaceLed{k}", _colour((step * 8 + k) * 0x9E3779 & 0xFFFFFF), 0.0)
            self._nao.body.clock.sleep(0.2)

    def earLedsSetAngle(self, degrees: int, duration: float, leave_on: bool) -> None:
        self._nao.body.clock.sleep(max(0.0, float(duration)))
        self.setIntensity("EarLeds", 1.0 if leave_on else 0.0)

    def _leds(self, name: str) -> list[str]:
        if name in self._groups:
            return list(self._groups[name])
        if name in self._colours:
            return [name]
        raise RuntimeError(f"ALLeds: no LED or group {name}; see listGroups")

    def _paint(self, name: str, colour: tuple[float, ...], duration: float) -> None:
        red, green, blue = (min(max(float(v), 0.0), 1.0) for v in colour)
        leds = self._leds(name)
        self._nao.body.clock.sleep(max(0.0, float(duration)))
        for led in leds:
            self._colours[led] = (red, green, blue)


def _colour(value: Any) -> Colour:
    """0xRRGGBB or a name as red, green, blue in 0..1."""
    if isinstance(value, str):
        if value.lower() not in _NAMES:
            raise RuntimeError(f"ALLeds: expected {', '.join(_NAMES)} or 0xRRGGBB, got {value}")
        return _NAMES[value.lower()]
    rgb = int(value)
    return (rgb >> 16 & 255) / 255, (rgb >> 8 & 255) / 255, (rgb & 255) / 255


class System(Service, name="ALSystem"):
    """ALSystem."""

    def systemInfo(self) -> list[str]:
        return [VERSION, asked(self, "robotName"), time.strftime("%Y-%m-%d")]

    def reboot(self) -> None:
        """The motors go off; the session goes on."""
        self._nao.services["ALMotion"].rest()

    shutdown = reboot


class PhotoCapture(Service, name="ALPhotoCapture"):
    """ALPhotoCapture: images are written, and into a folder of this robot's own alone."""

    def takePicture(self, folder: str, name: str, overwrite: bool = True) -> list[str]:
        """Returns [where it was written]."""
        return self.takePictures(1, folder, name, overwrite)

    def takePictures(self, count: int, folder: str, name: str, overwrite: bool = True) -> list[str]:
        from doorway3ds.images.codec import write_image

        self._own = getattr(self, "_own", None) or tempfile.TemporaryDirectory(prefix="nao-")
        stem, _, suffix = name.rpartition(".") if "." in name else (name, "", "")
        suffix = suffix or asked(self, "getPictureFormat")
        if suffix not in ("jpg", "png"):
            raise RuntimeError(f"ALPhotoCapture: expected jpg or png, got {suffix}")
        width, height = SIZES[asked(self, "getResolution")]
        out = []
        for number in range(count):
            counted = f"{stem}_{number}" if count > 1 else stem
            plain = re.sub(r"[^\w.-]+", "_", f"{folder}_{counted}").strip("._")
            image = self._nao.picture(CAMERAS[asked(self, "getCameraID")], width, height)
            out.append(str(write_image(Path(self._own.name, f"{plain}.{suffix}"), image)))
        return out
