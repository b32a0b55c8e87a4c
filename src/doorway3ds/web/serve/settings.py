"""What `3ds serve` is told when it starts."""

from __future__ import annotations

from dataclasses import dataclass, field

from doorway3ds.camera.model import Pose
from doorway3ds.sources.base import CameraFor
from doorway3ds.web.base.settings import ServerSettings


@dataclass(frozen=True, kw_only=True)
class Settings(ServerSettings):
    """How decisions are made.

    method, network: used if a request names none. threads: of one network, None for its own
        choice.
    camera, pose: of pictures that come without; None: from EXIF, else assumed.
    """

    method: str = "opening"
    network: str = "doornet"
    threads: int | None = None
    camera: CameraFor | None = None
    pose: Pose = field(default_factory=Pose)
    width_m: float | None = None
    max_unseen_m: float | None = None
