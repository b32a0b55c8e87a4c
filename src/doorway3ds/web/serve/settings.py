"""What `3ds serve` is told when it starts."""

from __future__ import annotations

from dataclasses import dataclass, field

from doorway3ds.camera.choice import CameraChoice
from doorway3ds.decide.options import DecideOptions
from doorway3ds.web.base.access import ServerSettings


@dataclass(frozen=True, kw_only=True)
class Settings(ServerSettings):
    """How decisions are made.

    decide: used unless a request says otherwise. camera: of images that come without one.
    """

    decide: DecideOptions = field(default_factory=DecideOptions)
    camera: CameraChoice = field(default_factory=CameraChoice)
