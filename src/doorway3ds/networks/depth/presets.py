"""Published depth networks by name: what their files are, where they lie, how they are fed.

Depth Anything V2 (Yang et al., arXiv 2406.09414), the small models (24.8 M parameters, Apache-2.0).
Preprocessing as its authors have it: shorter side 518 pixels, both multiples of 14, ImageNet
mean and standard deviation. The metric model was fine-tuned on Hypersim, 1024x768 pixels through a
lens of 886.81 pixels, brought to 686x518 (metric_depth/dataset/hypersim.py of the authors'
repository): 596.1 pixels there. Hypersim's lenses vary a little from scene to scene.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from doorway3ds.networks.depth.spec import RELATIVE_INVERSE, DepthSpec

METRIC = "depth-anything-v2-metric-indoor-small"
RELATIVE = "depth-anything-v2-small"

HYPERSIM_F_PX = 886.81 * math.sqrt(686 / 1024 * 518 / 768)

_IMAGENET_MEAN = (0.485, 0.456, 0.406)
_IMAGENET_STD = (0.229, 0.224, 0.225)

PRESETS: Mapping[str, DepthSpec] = {
    METRIC: DepthSpec(
        unit="m",
        short_side=518,
        multiple=14,
        layout="nchw",
        mean=_IMAGENET_MEAN,
        std=_IMAGENET_STD,
        focal_px=HYPERSIM_F_PX,
    ),
    RELATIVE: DepthSpec(
        unit=RELATIVE_INVERSE,
        short_side=518,
        multiple=14,
        layout="nchw",
        mean=_IMAGENET_MEAN,
        std=_IMAGENET_STD,
    ),
}
