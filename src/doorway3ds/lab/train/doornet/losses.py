"""Losses of doornet; every label may be missing, so every loss is a weighted mean.

All take torch tensors and return scalars. Edges are trained by their intersection over union
in one dimension (Yu et al., "UnitBox", ACM MM 2016) plus a smooth L1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Tensor = Any


@dataclass(frozen=True)
class LossWeights:
    """Share of each loss in the sum."""

    p_open: float = 0.5
    score: float = 1.0
    edges: float = 1.0
    clear: float = 0.3
    depth: float = 1.0
    gradient: float = 0.5
    floor: float = 0.5
    segments: float = 0.3


def _mean(values: Tensor, weights: Tensor) -> Tensor:
    return (values * weights).sum() / weights.sum().clamp(min=1e-6)


def columns_loss(output: Mapping[str, Tensor], target: Mapping[str, Tensor]) -> Tensor:
    """Binary cross-entropy of "this strip looks through an opening"."""
    from torch.nn import functional

    loss = functional.binary_cross_entropy_with_logits(
        output["score"], target["score"], reduction="none"
    )
    # openings fill one strip in fifteen: inside and outside get like say
    weight = target["score_weight"] * (1 + 3 * target["score"])
    return _mean(loss, weight)


def edges_loss(output: Mapping[str, Tensor], target: Mapping[str, Tensor]) -> Tensor:
    """1 - IoU of the voted and the true opening, and smooth L1 of both distances."""
    from torch.nn import functional

    left, right = output["left"], output["right"]
    true_left, true_right = target["left"], target["right"]
    shared = left.minimum(true_left) + right.minimum(true_right)
    union = left.maximum(true_left) + right.maximum(true_right)
    overlap = 1 - shared / union.clamp(min=1e-4)
    distance = sum(
        functional.smooth_l1_loss(a, b, beta=0.02, reduction="none")
        for a, b in ((left, true_left), (right, true_right))
    )
    return _mean(overlap + 8 * distance, target["edge_weight"])


def depth_loss(output: Tensor, target: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """L1 of log depth, and L1 of its gradients at three scales; (B, h, w), 0 = unknown.

    weight: (B,). The gradients keep edges of doorways sharp (Li & Snavely, CVPR 2018).
    """
    known = (target > 0).float() * weight[:, None, None]
    error = output.clamp(min=0.05).log() - target.clamp(min=0.05).log()
    plain = _mean(error.abs(), known)
    gradient = error.new_zeros(())
    for step in (1, 2, 4):
        e, k = error[:, ::step, ::step], known[:, ::step, ::step]
        dx, kx = (e[:, :, 1:] - e[:, :, :-1]).abs(), k[:, :, 1:] * k[:, :, :-1]
        dy, ky = (e[:, 1:] - e[:, :-1]).abs(), k[:, 1:] * k[:, :-1]
        gradient = gradient + _mean(dx, kx) + _mean(dy, ky)
    return plain, gradient / 3


def all_losses(
    output: Mapping[str, Tensor], target: Mapping[str, Tensor], weights: LossWeights
) -> dict[str, Tensor]:
    """Each weighted loss by name; their sum is what training lowers."""
    from torch.nn import functional

    bce = functional.binary_cross_entropy_with_logits
    # a little smoothing: labels of open and closed are wrong in a few per cent
    p_open = bce(output["p_open"], target["p_open"] * 0.96 + 0.02, reduction="none")
    plain, gradient = depth_loss(output["depth"], target["depth"], target["depth_weight"])
    clear = bce(output["clear"], target["clear"] * 0.94 + 0.03, reduction="none")
    share = target["segment_weight"][:, None, None]
    floor_known = (target["floor"] != 255).float() * share
    floor = bce(output["floor"], (target["floor"] == 1).float(), reduction="none")
    known = (target["segments"] != 255).float() * share
    classes = target["segments"].long().clamp(max=output["segments"].shape[1] - 1)
    segments = functional.cross_entropy(output["segments"], classes, reduction="none")
    return {
        "p_open": weights.p_open * _mean(p_open, target["p_open_weight"]),
        "score": weights.score * columns_loss(output, target),
        "edges": weights.edges * edges_loss(output, target),
        "clear": weights.clear * _mean(clear, target["clear_weight"]),
        "depth": weights.depth * plain,
        "gradient": weights.gradient * gradient,
        "floor": weights.floor * _mean(floor, floor_known),
        "segments": weights.segments * _mean(segments, known),
    }
