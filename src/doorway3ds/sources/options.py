"""What a user may say of how a source is read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from doorway3ds.options import Options, setting


@dataclass(frozen=True)
class SourceOptions(Options):
    """How a source is read; what a source has no use for is passed over."""

    panel: ClassVar[str] = "Source"

    pace: bool | None = setting(
        None,
        "Read videos and folders in their own time, skipping frames as if live. Default: only if "
        "a panel shows them and nothing is written.",
        names=("--pace/--no-pace",),
    )
    loop: bool = setting(False, "Start a video or folder again at its end.")
    fps: float | None = setting(
        None, "Frame rate of a folder's images and of standard input.", low=0.001, high=1000
    )
    patience_s: float = setting(
        60.0, "Give up once a camera or stream has been gone for this long.", low=0, high=1e6
    )
