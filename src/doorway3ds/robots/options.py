"""What a user may say of a robot's motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from doorway3ds.options import Options, setting
from doorway3ds.robots.base import Limits


@dataclass(frozen=True)
class MotionOptions(Options):
    """Whether a robot may move, and its limits."""

    panel: ClassVar[str] = "Robot"

    move: bool = setting(False, "Allow motion. Without it nothing moves.")
    max_turn_deg: float = setting(60.0, "Largest turn.", low=1, high=180)
    ttl_s: float = setting(2.0, "Refuse to move on a decision older than this.", low=0.05, high=60)
    turn_timeout_s: float = setting(
        20.0, "Stop a turn that takes longer than this.", low=0.5, high=120
    )
    blocked_s: float = setting(2.0, "Time between looks at a blocked way.", low=0, high=600)

    def limits(self) -> Limits:
        """What no turn may exceed."""
        return Limits(
            max_turn_deg=self.max_turn_deg, ttl_s=self.ttl_s, turn_timeout_s=self.turn_timeout_s
        )
