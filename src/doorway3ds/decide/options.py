"""What a user may say of how to decide."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from doorway3ds.compat import StrEnum
from doorway3ds.errors import CallError
from doorway3ds.options import THREADS, Options, setting

PACKAGED = "doornet"
"""The network that decides unless another is named; its file is in the package."""

ALIGNED_DEG = 3.0
"""A robot faces a doorway whose bearing is at most this."""


class Method(StrEnum):
    """How a direction is selected."""

    OPENING = "opening"  # by openings, calibration and the robot's width
    PAPER = "paper"  # as published by Othman & Rad


@dataclass(frozen=True)
class NetworkOptions(Options):
    """Which network looks at the images."""

    panel: ClassVar[str] = "Decision"

    network: str = setting(
        PACKAGED,
        "Network to use, one of `3ds models` or an .onnx file; two are joined by +.",
        metavar="NAME[+NAME]",
    )
    mirror: bool = setting(
        False, "Average over both mirrorings of the image: steadier, at twice the time."
    )
    threads: int | None = setting(None, "CPU threads of the network.", **THREADS)


@dataclass(frozen=True)
class DecideOptions(NetworkOptions):
    """Which network and method decide, and their limits."""

    method: Method = setting(Method.OPENING, "How a direction is selected.")
    preset: str | None = setting(
        None,
        "Operating point of the network's file, such as cautious, balanced or eager.",
        metavar="NAME",
    )
    width_m: float | None = setting(None, "Width of the robot; default: NAO's.", low=0.01, high=5)
    max_unseen_m: float | None = setting(
        None,
        "Abstain if the floor comes into view only beyond this distance.",
        low=0,
        high=100,
    )
    aligned_deg: float = setting(
        ALIGNED_DEG, "Largest bearing at which the robot faces a doorway.", low=0.5, high=30
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.method not in list(Method):
            raise CallError(f"method must be {' or '.join(Method)}, got {self.method!r}")
        object.__setattr__(self, "method", Method(self.method))
