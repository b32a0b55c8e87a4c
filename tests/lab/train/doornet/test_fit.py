"""doornet's training on the shared loop: what it draws, averages, keeps and takes up again."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
from doorway3ds.errors import UserError
from doorway3ds.lab.train.doornet.data.augment import AugmentConfig
from doorway3ds.lab.train.doornet.data.samples import Sample, read_samples
from doorway3ds.lab.train.doornet.fit import FitConfig, Held, Stage, fit
from doorway3ds.lab.train.doornet.losses import LossWeights
from doorway3ds.lab.train.doornet.model import DoorNet, DoorNetConfig, build_doornet
from doorway3ds.lab.train.engine import backend as engine
from doorway3ds.lab.train.engine.training import Run
from tests.lab.train.engine.test_loop import Killed, Stops, kill
from tests.lab.train.team import pair

pytestmark = pytest.mark.train

CONFIG = FitConfig(
    stages=(Stage(2, 1e-3), Stage(1, 3e-4, 40)), steps_per_epoch=2, batch=2, ema=0.9, seed=4
)
SMALL = DoorNetConfig(8, 8, 8, 8, 2, 0.3)

# One process of two trains and writes its weights.
_MEMBER = """
import sys
import numpy as np
from pathlib import Path
from doorway3ds.lab.train.engine import backend as engine
from doorway3ds.lab.train.doornet.data.samples import read_samples
from tests.lab.train.doornet.test_fit import CONFIG, build, run
engine.start(1)
team = engine.join()
teachers, rendered, out = map(Path, sys.argv[1:])
net = build(teachers)
samples = read_samples(rendered)
history = run(net, samples[2:], out, held=samples[:2], team=team)
np.savez(out / f"rank{team.rank}.npz", *net.whole.get_weights(), loss=history[-1]["val_loss"])
engine.leave(team)
"""


def build(teachers: Path) -> DoorNet:
    keras = engine.start(1)
    keras.utils.set_random_seed(1)
    return build_doornet(teachers / "deeplabv3_mnv2_ade20k_512.onnx", SMALL)


def run(net: DoorNet, samples: list[Sample], out: Path, **more: Any) -> list[dict[str, float]]:
    config, held = more.pop("config", CONFIG), more.pop("held", ())
    half = more.pop("half", False)
    augment, weights = AugmentConfig(), LossWeights()
    into = Run(out, **more)
    return fit(net, samples, config, into, augment=augment, weights=weights, held=held, half=half)


def same(a: DoorNet, b: DoorNet) -> bool:
    pairs = zip(a.whole.get_weights(), b.whole.get_weights(), strict=True)
    return all(np.array_equal(x, y) for x, y in pairs)


def interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def test_resumed_anywhere_it_ends_with_the_weights_of_an_unbroken_run(
    teachers: Path, rendered: Path, tmp_path: Path
) -> None:
    samples = read_samples(rendered)
    held, kept = samples[:2], samples[2:]
    whole = build(teachers)
    history = run(whole, kept, tmp_path / "whole", held=held)
    assert [row["epoch"] for row in history] == [1, 2, 3]
    assert all(np.isfinite(row[k]) for row in history for k in ("loss", "val_loss", "val_depth"))
    assert (tmp_path / "whole" / "stage-1.csv").read_text().count("\n") == 2
    # in the first stage's second epoch, and in the second stage before its first checkpoint
    for act, error, batches in ((interrupt, KeyboardInterrupt, 3), (kill, Killed, 5)):
        out = tmp_path / act.__name__
        with pytest.raises(error):
            run(build(teachers), kept, out, held=held, watcher=Stops(batches, act))
        again = build(teachers)
        rows = run(again, kept, out, held=held, resume=True)
        for row, want in zip(rows, history, strict=True):
            assert row == pytest.approx(want)
        assert same(again, whole)

    # done already: nothing is trained, nothing written anew
    before = (out / "stage-1.weights.h5").stat().st_mtime_ns
    again = build(teachers)
    assert run(again, kept, out, held=held, resume=True, watcher=Stops(1, kill)) == history
    assert same(again, whole)
    assert (out / "stage-1.weights.h5").stat().st_mtime_ns == before
    with pytest.raises(UserError, match="is of another training"):
        run(again, kept[1:], out, resume=True)

    # the file of averaged weights is what a later training starts from
    other = build(teachers)
    other.whole.load_weights(out / "stage-1.weights.h5")
    assert same(other, whole)


def test_the_kept_weights_are_the_average_with_its_warm_up(
    teachers: Path, rendered: Path, tmp_path: Path
) -> None:
    net = build(teachers)
    seen: list[list[np.ndarray]] = []

    class Look(Stops):
        def batch(self, epoch: int, step: int, steps: int, told: dict[str, float]) -> None:
            seen.append([w.copy() for w in net.decoder.get_weights()])

    mean = [w.copy() for w in net.decoder.get_weights()]
    one = replace(CONFIG, stages=(Stage(2, 1e-2),), ema=0.2)
    run(net, read_samples(rendered), tmp_path, config=one, watcher=Look(0, kill))
    assert len(seen) == 4
    for step, weights in enumerate(seen, start=1):
        decay = min(0.2, step / (step + 10))  # the decay itself from the third step on
        mean = [decay * m + (1 - decay) * w for m, w in zip(mean, weights, strict=True)]
    for got, want in zip(net.decoder.get_weights(), mean, strict=True):
        assert np.allclose(got, want, atol=1e-6)


def test_early_stopping_keeps_the_weights_that_were_best_on_held_out_places(
    teachers: Path, rendered: Path, tmp_path: Path
) -> None:
    from doorway3ds.lab.train.engine.loop import Loop, LoopConfig

    samples = read_samples(rendered)
    net = build(teachers)
    config = replace(CONFIG, stages=(Stage(8, 0.1),), patience=1, ema=0.0)
    history = run(net, samples[2:], tmp_path, held=samples[:2], config=config)
    told = [row["val_loss"] for row in history]
    assert len(told) == int(np.nanargmin(told)) + 2 < 8
    judge = Loop(
        net.whole,
        lambda output, target: _losses(output, target),
        Held(samples[:2], 2, None),
        Held(samples[:2], 2, None),
        LoopConfig(1, 0.1, 2),
        tmp_path,
        stem="judge",
    )
    assert judge.validate()["loss"] == pytest.approx(np.nanmin(told), rel=1e-4)


def _losses(output: Any, target: Any) -> dict[str, Any]:
    from doorway3ds.lab.train.doornet.fit import _losses

    return _losses(output, target, LossWeights())


def test_a_loss_that_is_no_number_names_the_pictures(
    teachers: Path, rendered: Path, tmp_path: Path
) -> None:
    samples = [replace(s, weight=float("nan")) for s in read_samples(rendered)]
    net = build(teachers)
    with pytest.raises(UserError, match=r"epoch 1, batch 1 \(00\d+.png, 00\d+.png\)"):
        run(net, samples, tmp_path)
    assert not (tmp_path / "stage-0.npz").exists()


def test_bfloat16_learns_with_weights_in_float32(
    teachers: Path, rendered: Path, tmp_path: Path
) -> None:
    net = build(teachers)
    one = replace(CONFIG, stages=(Stage(1, 1e-3, 40),), steps_per_epoch=1)
    (row,) = run(net, read_samples(rendered), tmp_path, config=one, half=True)
    assert np.isfinite(row["loss"])
    assert {w.dtype for w in net.whole.get_weights()} == {np.dtype("float32")}


def test_two_processes_end_with_the_same_weights(
    teachers: Path, rendered: Path, tmp_path: Path
) -> None:
    out = tmp_path / "two"
    with pair(_MEMBER, teachers, rendered, out) as members:
        assert [member.wait(timeout=500) for member in members] == [0, 0]
    with np.load(out / "rank0.npz") as first, np.load(out / "rank1.npz") as second:
        assert len(first.files) > 100
        assert all(np.array_equal(first[name], second[name]) for name in first.files)
        assert np.isfinite(first["loss"])
    # one wrote the files, and they are whole
    again = build(teachers)
    again.whole.load_weights(out / "stage-1.weights.h5")
