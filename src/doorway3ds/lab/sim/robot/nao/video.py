"""ALVideoDevice of a virtual NAO."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.sim.robot.nao import colours
from doorway3ds.lab.sim.robot.nao.service import TABLE, Service, each, returns

if TYPE_CHECKING:
    from doorway3ds.lab.sim.robot.nao.robot import VirtualNao

SIZES = {
    0: (160, 120), 1: (320, 240), 2: (640, 480), 3: (1280, 960), 4: (2560, 1920),
    7: (80, 60), 8: (40, 30),
}  # fmt: skip
CAMERAS = {0: "CameraTop", 1: "CameraBottom", 2: "CameraDepth"}
DEPTH = 2
CONTAINER = "(iiiiiiriffff)"
_PARAMETERS: dict[int, tuple[int, int, int]] = TABLE["ALVideoDevice"]["parameters"]
_HFLIP, _VFLIP = 7, 8


@dataclass
class _Subscription:
    """What one client sees. many: it subscribed to cameras, rather than to one."""

    cameras: list[int]
    resolutions: list[int]
    colours: list[int]
    fps: int
    many: bool = False
    last: dict[int, tuple[float, Any]] = field(default_factory=dict)


class Video(Service, name="ALVideoDevice"):
    """ALVideoDevice."""

    _MOST = 6  # of one name

    def __init__(self, nao: VirtualNao) -> None:
        super().__init__(nao)
        self._lock = threading.Lock()
        self._open: dict[str, _Subscription] = {}
        self._latest: dict[tuple[int, int, int], Any] = {}
        self._active = 0
        self._parameters: dict[tuple[int, int], int] = {}

    # Subscribing.

    def subscribeCamera(
        self, name: str, camera: int, resolution: int, colour: int, fps: int
    ) -> str:
        """The handle, "" where something is asked for that there is not."""
        return self._subscribe(name, _Subscription([camera], [resolution], [colour], fps))

    def subscribeCameras(
        self, name: str, cameras: Any, resolutions: Any, colour_spaces: Any, fps: int
    ) -> str:
        size = len(cameras)
        asked = _Subscription(
            list(cameras), each("resolutions", resolutions, size),
            each("colour spaces", colour_spaces, size), fps, True,
        )  # fmt: skip
        return self._subscribe(name, asked)

    def subscribe(self, name: str, resolution: int, colour: int, fps: int) -> str:
        """To the active camera."""
        return self.subscribeCamera(name, self._active, resolution, colour, fps)

    def unsubscribe(self, handle: str) -> bool:
        with self._lock:
            return self._open.pop(handle, None) is not None

    def unsubscribeAllInstances(self, name: str) -> None:
        with self._lock:
            for handle in [h for h in self._open if h.rpartition("_")[0] == name]:
                del self._open[handle]

    def getSubscribers(self) -> list[str]:
        with self._lock:
            return sorted(self._open)

    def _subscribe(self, name: str, asked: _Subscription) -> str:
        every = zip(asked.cameras, asked.resolutions, asked.colours, strict=True)
        known = all(
            self._has(c) and r in SIZES and colours.suits(k, c == DEPTH) for c, r, k in every
        )
        if not known or not asked.cameras or not 1 <= asked.fps <= 30:
            return ""
        with self._lock:
            for number in range(self._MOST):
                handle = f"{name}_{number}"
                if handle not in self._open:
                    self._open[handle] = asked
                    return handle
        return ""

    # What a subscription asks for.

    def setActiveCamera(self, *given: Any) -> bool:
        """(camera): for `subscribe`; (handle, camera): of a subscription."""
        camera = int(given[-1])
        if not self._has(camera):
            return False
        if len(given) == 1:
            self._active = camera
            return True
        return self._change(given[0], "cameras", camera)

    def getActiveCamera(self, handle: str = "") -> int:
        if not handle:
            return self._active
        with self._lock:
            return self._open[handle].cameras[0] if handle in self._open else -1

    def setResolution(self, handle: str, resolution: int) -> bool:
        return resolution in SIZES and self._change(handle, "resolutions", resolution)

    def setColorSpace(self, handle: str, colour: int) -> bool:
        depth = self.getActiveCamera(handle) == DEPTH
        return colours.suits(colour, depth) and self._change(handle, "colours", colour)

    def setFrameRate(self, handle: str, fps: int) -> bool:
        return 1 <= fps <= 30 and self._change(handle, "fps", fps)

    def getResolution(self, handle: Any) -> int:
        return int(self._asked(handle, "resolutions"))

    def getColorSpace(self, handle: Any) -> int:
        return int(self._asked(handle, "colours"))

    def getFrameRate(self, handle: Any) -> int:
        return int(self._asked(handle, "fps"))

    def _change(self, handle: str, what: str, value: int) -> bool:
        with self._lock:
            asked = self._open.get(handle)
            if asked is None:
                return False
            setattr(asked, what, value if what == "fps" else [value] * len(asked.cameras))
            asked.last.clear()
            return True

    def _asked(self, handle: Any, what: str) -> int:
        with self._lock:
            asked = self._open.get(str(handle))
            if asked is None:
                return -1
            value = getattr(asked, what)
            return int(value if what == "fps" else value[0])

    # Images.

    @returns("+" + CONTAINER)
    def getImageRemote(self, handle: str) -> Any:
        """The container, or nothing for an unknown handle, as on the robot."""
        images = self._images(handle)
        return images[0] if images else None

    getImageLocal = getImageRemote

    @returns("[" + CONTAINER + "]")
    def getImagesRemote(self, handle: str) -> Any:
        """A container for each camera of the subscription."""
        return self._images(handle)

    getImagesLocal = getImagesRemote

    def releaseImage(self, handle: str) -> bool:
        with self._lock:
            return handle in self._open

    releaseImages = releaseImage

    def _images(self, handle: str) -> list[Any]:
        faults = self._nao.faults
        with self._lock:
            asked = self._open.get(handle)
        if faults.hang_s:
            time.sleep(faults.hang_s)
        if asked is None or faults.null:
            return []
        return [self._image(asked, k) for k in range(len(asked.cameras))]

    def _image(self, asked: _Subscription, k: int) -> Any:
        faults = self._nao.faults
        now = time.time() + faults.clock_s
        last = asked.last.get(k)
        if last is not None and 0 <= now - last[0] < 1 / asked.fps:
            return last[1]
        # A camera that froze gives its last image to new subscribers, too.
        kind = (asked.cameras[k], asked.resolutions[k], asked.colours[k])
        if faults.frozen and kind in self._latest:
            return self._latest[kind]
        container = self._photograph(*kind, now, faults.short)
        asked.last[k] = (now, container)
        self._latest[kind] = container
        return container

    def _photograph(self, camera: int, resolution: int, colour: int, now: float, short: int
                    ) -> tuple[Any, ...]:  # fmt: skip
        width, height = SIZES[resolution]
        nao = self._nao
        look = nao.depth if camera == DEPTH and nao.depth is not None else nao.picture
        seen: NDArray[np.generic] = look(CAMERAS[camera], width, height)
        if self.getParameter(camera, _HFLIP):
            seen = seen[:, ::-1]
        if self.getParameter(camera, _VFLIP):
            seen = seen[::-1]
        across, down = self._fov(camera)
        pixels = colours.encode(seen, colour, across).tobytes()
        return (
            width, height, colours.LAYERS[colour], colour, int(now), int(now % 1 * 1e6),
            pixels[: len(pixels) - short], camera, across / 2, down / 2, -across / 2, -down / 2,
        )  # fmt: skip

    # Cameras.

    def hasDepthCamera(self) -> bool:
        return self._has(DEPTH)

    def getCameraIndexes(self) -> list[int]:
        return [index for index in CAMERAS if self._has(index)]

    def getCameraName(self, camera: int) -> str:
        return CAMERAS[camera] if self._has(camera) else ""

    def getCameraModel(self, camera: int) -> int:
        return self._nao.body.model.camera_model if camera != DEPTH else 4

    def getHorizontalFOV(self, camera: int) -> float:
        return self._fov(camera)[0]

    def getVerticalFOV(self, camera: int) -> float:
        return self._fov(camera)[1]

    def openCamera(self, camera: int) -> bool:
        return self._has(camera)

    startCamera = stopCamera = closeCamera = isCameraOpen = isCameraStarted = openCamera

    def resolutionToSizes(self, resolution: int) -> list[int]:
        return list(SIZES.get(resolution, (-1, -1)))

    def getAngularPositionFromImagePosition(self, camera: int, at: Any) -> list[float]:
        """Angles (+ left, + down) of an image position in 0..1."""
        across, down = self._fov(camera)
        return [
            math.atan((0.5 - at[0]) * 2 * math.tan(across / 2)),
            math.atan((at[1] - 0.5) * 2 * math.tan(down / 2)),
        ]

    def getImagePositionFromAngularPosition(self, camera: int, at: Any) -> list[float]:
        across, down = self._fov(camera)
        return [
            0.5 - math.tan(at[0]) / (2 * math.tan(across / 2)),
            0.5 + math.tan(at[1]) / (2 * math.tan(down / 2)),
        ]

    def setParameter(self, camera: int, parameter: int, value: int) -> bool:
        if not self._has(camera) or parameter not in _PARAMETERS:
            return False
        least, most, _ = _PARAMETERS[parameter]
        if not least <= value <= most:
            return False
        self._parameters[camera, parameter] = int(value)
        self._forget()
        return True

    def getParameter(self, camera: int, parameter: int) -> int:
        default = _PARAMETERS.get(parameter, (0, 0, -1))[2]
        return self._parameters.get((camera, parameter), default)

    def getParameterRange(self, camera: int, parameter: int) -> list[int]:
        return list(_PARAMETERS.get(parameter, (-1, -1, -1))[:2])

    def getParameterInfo(self, camera: int, parameter: int) -> list[int]:
        """[value, least, most, default]."""
        least, most, default = _PARAMETERS.get(parameter, (-1, -1, -1))
        return [self.getParameter(camera, parameter), least, most, default]

    def setParameterToDefault(self, camera: int, parameter: int) -> bool:
        return self.setParameter(camera, parameter, _PARAMETERS.get(parameter, (0, 0, -1))[2])

    def setAllParametersToDefault(self, camera: int) -> bool:
        self._parameters = {k: v for k, v in self._parameters.items() if k[0] != camera}
        self._forget()
        return self._has(camera)

    def setParam(self, parameter: int, value: int, camera: int | None = None) -> None:
        """As `setParameter`, of the active camera; 18 selects that."""
        if parameter == 18:
            self.setActiveCamera(int(value))
            return
        self.setParameter(self._active if camera is None else camera, parameter, value)

    def getParam(self, parameter: int, camera: int | None = None) -> int:
        if parameter == 18:
            return self._active
        return self.getParameter(self._active if camera is None else camera, parameter)

    def setCameraParameter(self, handle: str, parameter: int, value: int) -> bool:
        return self.setParameter(self.getActiveCamera(handle), parameter, value)

    def getCameraParameter(self, handle: str, parameter: int) -> int:
        return self.getParameter(self.getActiveCamera(handle), parameter)

    def _forget(self) -> None:
        with self._lock:
            for asked in self._open.values():
                asked.last.clear()

    def _has(self, camera: int) -> bool:
        return camera in CAMERAS and (camera != DEPTH or self._nao.depth is not None)

    def _fov(self, camera: int) -> tuple[float, float]:
        model = self._nao.body.model
        fov = model.depth_fov_deg if camera == DEPTH else None
        across, down = fov or model.fov_deg
        return math.radians(across), math.radians(down)
