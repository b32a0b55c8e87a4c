from __future__ import annotations

import math

import pytest

torch = pytest.importorskip("torch")

from doorway3ds.lab.train.doornet.losses import columns_loss, depth_loss, edges_loss  # noqa: E402

pytestmark = pytest.mark.train


def test_columns_loss_by_hand() -> None:
    output = {"score": torch.tensor([[0.0, 2.0]])}
    target = {"score": torch.tensor([[0.0, 1.0]]), "score_weight": torch.tensor([[1.0, 0.5]])}
    first, second = math.log(2), math.log(1 + math.exp(-2))
    expected = (1.0 * first + 0.5 * 4 * second) / (1.0 + 0.5 * 4)
    assert float(columns_loss(output, target)) == pytest.approx(expected, rel=1e-6)


def test_edges_loss_by_hand() -> None:
    output = {"left": torch.tensor([[0.2, 9.0]]), "right": torch.tensor([[0.1, 9.0]])}
    target = {
        "left": torch.tensor([[0.1, 0.0]]),
        "right": torch.tensor([[0.1, 0.0]]),
        "edge_weight": torch.tensor([[1.0, 0.0]]),
    }
    overlap = 1 - 0.2 / 0.3
    distance = 0.1 - 0.02 / 2  # smooth L1 beyond beta
    assert float(edges_loss(output, target)) == pytest.approx(overlap + 8 * distance, rel=1e-5)


def test_depth_loss_by_hand() -> None:
    output = torch.tensor([[[2.0, 2.0], [2.0, 2.0]]])
    target = torch.tensor([[[1.0, 2.0], [0.0, 2.0]]])
    plain, gradient = depth_loss(output, target, torch.tensor([1.0]))
    assert float(plain) == pytest.approx(math.log(2) / 3, rel=1e-6)
    # scale 1: one known pair along x (log 2), one along y (0); scales 2 and 4: no pair
    assert float(gradient) == pytest.approx(math.log(2) / 3, rel=1e-6)


def test_missing_labels_cost_nothing() -> None:
    nothing = torch.zeros(1, 4, 4)
    plain, gradient = depth_loss(torch.ones(1, 4, 4), nothing, torch.tensor([1.0]))
    assert float(plain) == 0 and float(gradient) == 0
