"""The stand-ins for today's networks have the size of what they stand for."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")
script = Path(__file__).resolve().parents[1] / "benchmarks" / "peers.py"
spec = importlib.util.spec_from_file_location("peers", script)
peers = importlib.util.module_from_spec(spec)
spec.loader.exec_module(peers)


@pytest.mark.parametrize(
    ("module", "millions"), [(peers.detector(), 3.2), (peers.depth_network(518), 24.8)]
)
def test_parameters_are_as_published(module: torch.nn.Module, millions: float) -> None:
    count = sum(parameter.numel() for parameter in module.parameters())
    assert count / 1e6 == pytest.approx(millions, rel=0.02)


def test_shapes_of_the_answers() -> None:
    with torch.no_grad():
        maps = peers.detector()(torch.rand(1, 3, 64, 96))
        depth = peers.depth_network(42)(torch.rand(1, 3, 42, 42))
    assert [tuple(x.shape) for x in maps] == [(1, 144, 64 // s, 96 // s) for s in (8, 16, 32)]
    assert depth.shape == (1, 42, 42)
