from __future__ import annotations

import csv
import os
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
from doorway3ds.errors import UserError
from doorway3ds.lab.train.engine import backend as engine
from doorway3ds.lab.train.engine import checkpoint
from doorway3ds.lab.train.engine.loop import Loop, LoopConfig
from tests.lab.train.team import pair

pytestmark = pytest.mark.train

CONFIG = LoopConfig(epochs=4, learning_rate=0.01, batch=4, seed=3)

# One process of two, or alone, trains and writes its weights.
_MEMBER = """
import sys
import numpy as np
from pathlib import Path
from doorway3ds.lab.train.engine import backend as engine
from tests.lab.train.engine.test_loop import CONFIG, Noisy, make
team = engine.join()
loop, _ = make(Path(sys.argv[1]), team=team)
history = loop.run()
if team.leads:
    np.savez(sys.argv[2], *loop.model.get_weights(), loss=history[-1]["val_loss"])
engine.leave(team)
"""


class Noisy:
    """Ten points of a line; noise that follows from epoch and index alone."""

    def __init__(self, count: int = 10) -> None:
        self.names = [f"p{i}" for i in range(count)]
        self.x = np.random.default_rng(0).normal(size=(count, 3)).astype(np.float32)
        self.y = self.x @ np.array([[1.0], [-2.0], [0.5]], np.float32)
        self.loaded: list[list[int]] = []

    def load(self, indices: Sequence[int], epoch: int | None) -> tuple[Any, Any]:
        self.loaded.append(list(indices))
        x = self.x[list(indices)].copy()
        if epoch is not None:
            for row, index in enumerate(indices):
                x[row] += np.random.default_rng((epoch, index)).normal(0, 0.01, 3)
        return x, self.y[list(indices)]


def losses(output: Any, target: Any) -> dict[str, Any]:
    return {"loss": ((output - target) ** 2).mean(), "worst": (output - target).abs().max()}


def make(
    folder: Path,
    config: LoopConfig = CONFIG,
    data: Noisy | None = None,
    **more: Any,
) -> tuple[Loop, Noisy]:
    keras = engine.start(1)
    keras.utils.set_random_seed(1)
    model = keras.Sequential(
        [keras.Input((3,)), keras.layers.Dense(4, activation="relu"), keras.layers.Dense(1)]
    )
    data = data or Noisy()
    return Loop(model, losses, data, Noisy(4), config, folder, **more), data


def same(a: Loop, b: Loop) -> bool:
    pairs = zip(a.model.get_weights(), b.model.get_weights(), strict=True)
    return all(np.array_equal(x, y) for x, y in pairs)


class Killed(Exception):
    """Stands for the process's end between two batches."""


class Stops:
    """A watcher that interrupts after some batches."""

    def __init__(self, after: int, act: Any) -> None:
        self.left, self.act = after, act

    def batch(self, epoch: int, step: int, steps: int, told: dict[str, float]) -> None:
        self.left -= 1
        if self.left == 0:
            self.act()

    def epoch(self, row: dict[str, float]) -> None:
        pass


def kill() -> None:
    raise Killed


def test_it_learns_and_logs(tmp_path: Path) -> None:
    loop, _ = make(tmp_path)
    history = loop.run()
    assert [row["epoch"] for row in history] == [1, 2, 3, 4]
    assert history[-1]["val_loss"] < history[0]["val_loss"]
    with (tmp_path / "checkpoint.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["loss"]) for row in rows] == [row["loss"] for row in history]
    assert set(rows[0]) == {"epoch", "loss", "worst", "val_loss", "val_worst"}


@pytest.mark.parametrize("batches", [1, 3, 5, 8])
def test_resumed_after_a_kill_it_ends_with_the_same_weights(tmp_path: Path, batches: int) -> None:
    whole, _ = make(tmp_path / "whole")
    whole.run()
    cut, _ = make(tmp_path / "cut", watcher=Stops(batches, kill))
    with pytest.raises(Killed):
        cut.run()
    again, _ = make(tmp_path / "cut")
    history = again.run(resume=True)
    assert same(again, whole)
    assert [row["epoch"] for row in history] == [1, 2, 3, 4]


def test_ctrl_c_leaves_a_checkpoint_of_that_batch(tmp_path: Path) -> None:
    whole, _ = make(tmp_path / "whole")
    whole.run()
    before = signal.getsignal(signal.SIGINT)
    cut, _ = make(tmp_path / "cut", watcher=Stops(5, lambda: os.kill(os.getpid(), signal.SIGINT)))
    with pytest.raises(KeyboardInterrupt):
        cut.run()
    assert signal.getsignal(signal.SIGINT) is before
    _, state = checkpoint.load(tmp_path / "cut" / "checkpoint.npz")
    assert (state["epoch"], state["step"]) == (1, 2)
    again, data = make(tmp_path / "cut")
    history = again.run(resume=True)
    assert same(again, whole)
    assert len(data.loaded) == 4 * 3 - 5
    assert history[1]["loss"] == pytest.approx(_rows(tmp_path / "whole")[1]["loss"], rel=1e-6)


def _rows(folder: Path) -> list[dict[str, float]]:
    with (folder / "checkpoint.csv").open() as file:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]


def test_a_loss_that_is_not_finite_stops_and_names_the_batch(tmp_path: Path) -> None:
    class Poisoned(Noisy):
        def load(self, indices: Sequence[int], epoch: int | None) -> tuple[Any, Any]:
            x, y = super().load(indices, epoch)
            if epoch == 2 and 7 in indices:
                x[0] = np.nan
            return x, y

    loop, _ = make(tmp_path, data=Poisoned())
    with pytest.raises(UserError, match=r"epoch 3, batch \d \(.*p7.*\)"):
        loop.run()
    assert all(np.isfinite(w).all() for w in loop.model.get_weights())
    arrays, state = checkpoint.load(tmp_path / "checkpoint.npz")
    assert state["epoch"] == 2
    assert all(np.isfinite(a).all() for a in arrays.values())


def test_early_stopping_keeps_the_best(tmp_path: Path) -> None:
    wild = LoopConfig(epochs=40, learning_rate=0.01, batch=4, seed=3, patience=2)
    loop, _ = make(tmp_path, wild)
    told = iter([5.0, 3.0, 4.0, 3.5, 1.0])
    weights: list[list[Any]] = []

    def validate() -> dict[str, float]:
        weights.append(loop.model.get_weights())
        return {"loss": next(told)}

    loop.validate = validate  # type: ignore[method-assign]
    assert len(loop.run()) == 4
    found = loop.model.get_weights()
    assert all(np.array_equal(a, b) for a, b in zip(found, weights[1], strict=True))


def test_gradients_are_clipped_together(tmp_path: Path) -> None:
    steps = []
    for clip in (1e9, 1e-3):
        loop, _ = make(tmp_path, LoopConfig(1, 0.1, 10, clip_norm=clip))
        seen: list[float] = []
        apply = loop.optimizer.apply

        def spy(grads: Any, variables: Any, seen: Any = seen, apply: Any = apply) -> None:
            seen.append(float(np.sqrt(sum(float((g**2).sum()) for g in grads))))
            apply(grads, variables)

        loop.optimizer.apply = spy
        loop.run()
        steps.append(seen[0])
    assert steps[0] > 0.01
    assert steps[1] == pytest.approx(1e-3, rel=1e-4)


def test_a_checkpoint_of_another_training_is_refused(tmp_path: Path) -> None:
    make(tmp_path, identity="a")[0].run()
    with pytest.raises(UserError, match="is of another training"):
        make(tmp_path, identity="b")[0].run(resume=True)
    longer = LoopConfig(epochs=6, learning_rate=0.01, batch=4, seed=3)
    assert len(make(tmp_path, longer, identity="a")[0].run(resume=True)) == 6


def test_no_pictures_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no training images"):
        make(tmp_path, data=Noisy(0))


def test_bfloat16_learns_with_weights_in_float32(tmp_path: Path) -> None:
    loop, _ = make(tmp_path, LoopConfig(4, 0.01, 4, seed=3, half=True))
    history = loop.run()
    assert history[-1]["loss"] < history[0]["loss"]
    assert {w.dtype for w in loop.model.get_weights()} == {np.dtype("float32")}


def test_two_processes_learn_what_one_does(tmp_path: Path) -> None:
    result = tmp_path / "two.npz"
    with pair(_MEMBER, tmp_path / "two", result) as members:
        loop, _ = make(tmp_path / "one")
        history = loop.run()
        assert [member.wait(timeout=400) for member in members] == [0, 0]
    with np.load(result) as two:
        for number, weight in enumerate(loop.model.get_weights()):
            assert np.allclose(two[f"arr_{number}"], weight, atol=1e-5)
        assert float(two["loss"]) == pytest.approx(history[-1]["val_loss"], rel=1e-4)


def test_slow_variables_take_their_share_of_a_step(tmp_path: Path) -> None:
    one = LoopConfig(epochs=1, learning_rate=0.01, batch=10, seed=3)
    plain, _ = make(tmp_path / "plain", one)
    start = [w.copy() for w in plain.model.get_weights()]
    plain.run()
    made, data = make(tmp_path / "paced", one)
    slow = (made.learns[:1], 0.1)
    paced = Loop(made.model, losses, data, Noisy(4), one, tmp_path / "paced", slow=slow)
    paced.run()
    for index, (old, full, part) in enumerate(
        zip(start, plain.model.get_weights(), paced.model.get_weights(), strict=True)
    ):
        share = 0.1 if index == 0 else 1.0
        np.testing.assert_allclose(part - old, share * (full - old), rtol=1e-4, atol=1e-7)
