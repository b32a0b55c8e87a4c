"""What every source of frames has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from doorway3ds.arguments import shown
from doorway3ds.camera.choice import FitCamera, default_camera, turned_camera
from doorway3ds.camera.model import Camera, Pose
from doorway3ds.closing import Closing
from doorway3ds.errors import CallError, UserError
from doorway3ds.types import Frame

if TYPE_CHECKING:
    from typing_extensions import Self

    from doorway3ds.images.codec import Picture
    from doorway3ds.networks.base import Network

CameraFor = FitCamera

PoseOf = Callable[["Pose | None"], Pose]
"""The pose of an image, given the one that the source measured for it, if it did."""


class SourceLost(UserError):
    """A source that gave images, or should have, is gone for good."""


@dataclass(frozen=True)
class View:
    """The camera and pose that the user gave, and what holds without them.

    camera: scaled to each image's size (UserError for another aspect), or a function that gives
        it; outranks the camera a source knows of itself. pose: likewise; a function may keep what
        the source measured.
    """

    camera: Camera | CameraFor | None = None
    pose: Pose | PoseOf | None = None

    def frame(
        self,
        image: NDArray[np.uint8],
        stamp_s: float,
        *,
        focal_35mm: float | None = None,
        camera: Camera | None = None,
        pose: Pose | None = None,
        orientation: int = 1,
        sent: tuple[int, int] | None = None,
    ) -> Frame:
        """A frame; `camera` and `pose` are the source's own, used where the user gave none.

        orientation: EXIF 1 to 8, by which `image` was turned upright. sent: width and height that
        the image had before it was stretched to square pixels, as a camera may be for those.
        """
        height, width = image.shape[:2]
        chosen = self.camera if self.camera is not None else camera
        fit: CameraFor = default_camera
        if isinstance(chosen, Camera):
            own = chosen
            fit = lambda width, height, _: own.scaled_to(width, height)  # noqa: E731
        elif chosen is not None:
            fit = chosen
        try:
            fitted = turned_camera(fit, width, height, focal_35mm, orientation)
        except UserError:
            if sent is None:
                raise
            fitted = turned_camera(fit, *sent, focal_35mm, orientation).stretched_to(width, height)
        placed = self.pose(pose) if callable(self.pose) else self.pose or pose or Pose()
        return Frame(image, fitted, placed, stamp_s)

    def of_picture(self, picture: Picture, stamp_s: float = 0.0) -> Frame:
        """The frame of a decoded image file."""
        return self.frame(
            picture.image,
            stamp_s,
            focal_35mm=picture.focal_35mm,
            orientation=picture.orientation,
        )


def require_view(camera: object, pose: object) -> None:
    """CallError for what is no camera or pose, nor a function that gives one, nor None."""
    for name, value, kind in (("camera", camera, Camera), ("pose", pose, Pose)):
        if value is not None and not isinstance(value, kind) and not callable(value):
            raise CallError(f"{name} must be a {kind.__name__} or None, got {shown(value)}")


class Source(Closing, ABC):
    """An iterator of frames that holds a device, file or connection until it is closed.

    >>> with open_source("webcam://0") as source:  # doctest: +SKIP
    ...     for frame in source:
    ...         print(pipeline(frame).turn_deg)

    name: the URI without its password.
    fps: images a second, where that is known.
    live: frames come when the world gives them; only the newest is kept.
    skipped: frames that came and were not handed out.
    damaged: images that could not be decoded.
    reconnects: how often the connection was made again.
    orientation: EXIF 1 to 8, by which the last frame was turned upright.
    frame_name: what the last frame is called: a file of a folder, else `name`.
    problem: why no image arrives at the moment, in words, or None.
    ended: no further frame will come.
    truth: a network that makes no mistakes about the last frame, if a source has one.
    notice: called with one line for each image left out and each change of the connection,
        perhaps from another thread.

    Frames' stamps are `time.monotonic()` for live sources, the time in the film for others.
    """

    live: bool = False

    def __init__(self, name: str) -> None:
        self.name = name
        self.frame_name = name
        self.fps: float | None = None
        self.skipped = 0
        self.damaged = 0
        self.reconnects = 0
        self.orientation = 1
        self.problem: str | None = None
        self.ended = False
        self.truth: Network | None = None
        self.notice: Callable[[str], None] = _ignore

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}>"

    @abstractmethod
    def read(self, timeout_s: float | None = None) -> Frame | None:
        """The next frame; None if none came within `timeout_s` seconds, or when `ended`.

        Images that cannot be used are left out and counted. Raises SourceLost if the source
        is gone, UserError if nothing of it could be used.
        """

    @abstractmethod
    def close(self) -> None:
        """Releases everything; may be called twice. Ends an iteration in another thread."""

    def require_sensor(self) -> None:
        """UserError if its frames are not as the sensor delivered them."""
        if self.orientation != 1:
            raise UserError(
                f"{self.name} is turned upright by its metadata, and a camera file is of the "
                "sensor; film without rotation, or calibrate with still images"
            )

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Frame:
        while not self.ended:
            frame = self.read()
            if frame is not None:
                return frame
        raise StopIteration


def _ignore(line: str) -> None:
    pass


@dataclass(frozen=True)
class Shot:
    """What a capture gives: an image as it came, and what the device knows about it.

    image: (H, W, 3) uint8 RGB, or the bytes of an image file, decoded only if it is used.
    stamp_s: `time.monotonic()` at exposure, or at arrival where that is unknown.
    sent: width and height before the image was stretched to square pixels.
    """

    image: NDArray[np.uint8] | bytes
    stamp_s: float
    camera: Camera | None = None
    pose: Pose | None = None
    sent: tuple[int, int] | None = None


class Capture(Protocol):
    """One connection to a device or stream; `LiveSource` reads it in a thread of its own."""

    def read(self) -> Shot | None:
        """The next image, waited for a few seconds at most; None if none came.

        Raises OSError or UserError if the connection is lost.
        """

    def close(self) -> None:
        """Releases the device; called from the thread that reads."""
