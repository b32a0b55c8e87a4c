"""What p_open's errors cost, and the p_open at whose 0.5 they cost least.

A network's own p_open is a chance. Where one error costs more than the other, its odds times the
ratio of the costs are to be compared with 1 (Elkan, "The foundations of cost-sensitive learning",
IJCAI 2001). The ratio depends on how near the image is: seen from afar a doorway that is missed
costs the way on, and a false one another look; a closed door that is taken for a doorway at arm's
length is walked into.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import UserError


@dataclass(frozen=True)
class Costs:
    """Of p_open's errors; all alike by default.

    missed: of a doorway that is missed, against one that is none, `far_m` away or farther.
    false_near: of a doorway that is none, against one that is missed, `near_m` away or nearer.
    near_m, far_m: median depth of the image; between them the costs' logarithms go over into
        each other in proportion to its logarithm.

    Raises UserError for costs that are not above 0 or distances that do not rise.
    """

    missed: float = 1.0
    false_near: float = 1.0
    near_m: float = 1.5
    far_m: float = 2.0

    def __post_init__(self) -> None:
        values = (self.missed, self.false_near, self.near_m, self.far_m)
        # a file's metadata may hold null
        above = all(isinstance(value, (int, float)) and 0 < value < math.inf for value in values)
        if not (above and self.near_m < self.far_m):
            raise UserError(f"costs must be above 0 and near_m below far_m, got {self}")


def weigh(p_open: float, depth_m: NDArray[np.floating[Any]], costs: Costs) -> float:
    """p_open with its odds weighed by what errors cost in an image of this depth.

    depth_m: (h, w) metres, nan where unknown; an image without any counts as far.
    """
    known = depth_m[np.isfinite(depth_m)]
    median_m = float(np.median(known)) if known.size else costs.far_m
    held_m = min(max(median_m, costs.near_m), costs.far_m)
    near = math.log(costs.far_m / held_m) / math.log(costs.far_m / costs.near_m)
    ratio = math.pow(costs.missed, 1 - near) * math.pow(costs.false_near, -near)
    return p_open * ratio / (p_open * ratio + 1 - p_open)
