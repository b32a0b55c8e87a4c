"""What Python 3.10, that of ROS 2 Humble, lacks."""

from __future__ import annotations

import sys

if sys.version_info >= (3, 11):
    from enum import StrEnum as StrEnum
else:
    from enum import Enum

    class StrEnum(str, Enum):
        """Members are strings, and are written as such."""

        __str__ = str.__str__
        __format__ = str.__format__
