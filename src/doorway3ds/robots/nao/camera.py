"""NAO's and Pepper's cameras: nao://192.168.1.10:9559?camera=top&resolution=vga&fps=10.

Images come through ALVideoDevice with the camera's pose from ALMotion.
http://doc.aldebaran.com/2-8/naoqi/vision/alvideodevice-api.html
"""

from __future__ import annotations

import contextlib
import os
import socket
import time
from typing import Any

from doorway3ds.camera.model import Pose
from doorway3ds.errors import CallError, UserError
from doorway3ds.robots.base import RobotError
from doorway3ds.robots.nao import format as naoformat
from doorway3ds.robots.nao.session import Naoqi, address
from doorway3ds.sources.address import query
from doorway3ds.sources.base import Shot, Source, View
from doorway3ds.sources.live import LiveSource

CAMERAS = {"top": (0, "CameraTop"), "bottom": (1, "CameraBottom")}
PATIENCE_S = 1.0
NO_STAMP = (0, 0)
STEADY_DEG = 0.5
"""A camera that turned by more than this while its image was fetched has no known pose."""


def open_uri(uri: str, view: View, **options: Any) -> Source:
    """The source of a nao:// URI; see `doorway3ds.sources.open_source`."""
    kinds = {"camera": str, "resolution": str, "fps": int, "colour": str, "timeout_s": float}
    parts, given = query(uri, kinds)
    host, port = address(uri)
    camera = _choice(uri, "camera", given.get("camera", "top"), CAMERAS)
    resolution = _choice(uri, "resolution", given.get("resolution", "vga"), naoformat.RESOLUTIONS)
    colour = _choice(uri, "colour", given.get("colour", "rgb"), naoformat.COLOURS)
    fps = given.get("fps", 10)
    if not 1 <= fps <= 30:
        raise CallError(f"{uri}: fps must be from 1 to 30, got {fps}")

    # A camera that froze shows a new connection its old image: stamps outlive connections.
    seen: list[tuple[int, int]] = []

    def connect() -> NaoCapture:
        naoqi = Naoqi(host, port, given.get("timeout_s", 5.0))
        try:
            return NaoCapture(naoqi, camera, resolution, colour, fps, seen)
        except BaseException:
            naoqi.close()
            raise

    live = {key: options[key] for key in ("patience_s", "stall_s") if key in options}
    name = f"nao://{host}:{port}"
    return LiveSource(f"{name}?{parts.query}" if parts.query else name, connect, view, **live)


def _choice(uri: str, name: str, value: str, known: dict[str, Any]) -> Any:
    if value.lower() not in known:
        raise CallError(f"{uri}: {name} must be one of {', '.join(known)}, got {value!r}")
    return known[value.lower()]


class NaoCapture:
    """One subscription to one camera; always unsubscribed, also where setting up fails.

    seen: holds the last image's stamp, for the connection after this one. A robot whose answers are
    of no use for PATIENCE_S raises UserError with the reason of the last of them.
    """

    def __init__(
        self,
        naoqi: Naoqi,
        camera: tuple[int, str],
        resolution: int,
        colour: int,
        fps: int,
        seen: list[tuple[int, int]] | None = None,
    ) -> None:
        self._naoqi, self._fps = naoqi, fps
        self._index, self._part = camera
        self._seen = [] if seen is None else seen
        self._next_s = 0.0
        self._good_s = time.monotonic()
        client = _client()
        self._forget_the_dead(client)
        self._handle = naoqi.call(
            "ALVideoDevice", "subscribeCamera", client, self._index, resolution, colour, fps
        )
        if not self._handle or not isinstance(self._handle, str):
            raise UserError(
                f"the robot {naoqi.name} refused camera {self._index}; are there too many clients?"
            )

    def read(self) -> Shot | None:
        """The newest image, or None if there is no new one or it cannot be used."""
        time.sleep(max(0.0, self._next_s - time.monotonic()))
        try:
            shot = self._shot()
        except RobotError:
            raise
        except UserError as error:
            # One null or a cut image is everyday: the next may be whole.
            if time.monotonic() - self._good_s > PATIENCE_S:
                raise UserError(f"{self._naoqi.name}: {error}") from error
            return None
        self._good_s = time.monotonic()
        return shot

    def _shot(self) -> Shot:
        """Raises UserError for what is no fresh image of a camera that stands still."""
        asked_s = time.monotonic()
        self._next_s = asked_s + 1 / self._fps
        before = self._pose()
        container = self._naoqi.call("ALVideoDevice", "getImageRemote", self._handle)
        with contextlib.suppress(RobotError):
            self._naoqi.call("ALVideoDevice", "releaseImage", self._handle)
        fields = naoformat.fields_of(container)
        image, camera = naoformat.to_rgb(fields), naoformat.camera_of(fields)
        stamp = (int(fields[4]), int(fields[5]))
        if stamp in self._seen and stamp != NO_STAMP:
            raise UserError("the robot sends the same image again, with the same stamp")
        self._seen[:] = [stamp]
        after = self._pose()
        if not _alike(before, after):
            raise UserError("the camera keeps moving while its image is fetched")
        # The exposure lies before the request; one period covers an image that waited for us.
        return Shot(image, asked_s - 1 / self._fps, camera, after)

    def close(self) -> None:
        with contextlib.suppress(RobotError):
            self._naoqi.call("ALVideoDevice", "unsubscribe", self._handle, timeout_s=1.0)
        self._naoqi.close()

    def _pose(self) -> Pose:
        values = self._naoqi.call(
            "ALMotion", "getTransform", self._part, naoformat.FRAME_ROBOT, True
        )
        return naoformat.pose_of(values)

    def _forget_the_dead(self, client: str) -> None:
        """Unsubscribes what crashed processes of this computer left behind; their number counts."""
        computer = client.rpartition("-")[0] + "-"
        with contextlib.suppress(RobotError):
            held = self._naoqi.call("ALVideoDevice", "getSubscribers")
            for handle in held if isinstance(held, list | tuple) else ():
                if str(handle).startswith(computer):
                    process = str(handle).removeprefix(computer).partition("_")[0]
                    if process.isdigit() and not _alive(int(process)):
                        self._naoqi.call("ALVideoDevice", "unsubscribe", handle)


def _alike(a: Pose, b: Pose) -> bool:
    angles = ("pitch_deg", "yaw_deg", "roll_deg")
    return all(abs(getattr(a, name) - getattr(b, name)) <= STEADY_DEG for name in angles)


def _client() -> str:
    return f"doorway3ds-{socket.gethostname().split('.')[0]}-{os.getpid()}"


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
