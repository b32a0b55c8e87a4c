"""The moving average of a network's weights, which is what some trainings keep."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any


class Average:
    """Exponential moving average of Keras variables, `decay` per step."""

    def __init__(self, weights: Sequence[Any], decay: float) -> None:
        self.weights, self.decay = list(weights), decay
        self.means: list[Any] = []
        self.take()

    def take(self) -> None:
        """The weights as they are become the average."""
        self.means = [w.value.detach().clone() for w in self.weights]

    def follow(self, steps: int) -> None:
        """Takes in the weights after step number `steps`, counted from 1."""
        # short at first, so that the first, random weights leave no trace
        decay = min(self.decay, steps / (steps + 10))
        for mean, weight in zip(self.means, self.weights, strict=True):
            mean.lerp_(weight.value.detach(), 1 - decay)

    def put(self) -> None:
        """The average becomes the weights."""
        for mean, weight in zip(self.means, self.weights, strict=True):
            weight.assign(mean)

    @contextmanager
    def shown(self) -> Iterator[None]:
        """The network has the average for a while."""
        learned = [w.value.detach().clone() for w in self.weights]
        self.put()
        try:
            yield
        finally:
            for value, weight in zip(learned, self.weights, strict=True):
                weight.assign(value)
