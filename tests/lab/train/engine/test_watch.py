from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch")
from doorway3ds.errors import UserError
from doorway3ds.lab.train.engine import watch
from doorway3ds.lab.train.engine.watch import TensorBoard

pytestmark = pytest.mark.train


def row(epoch: int, loss: float) -> dict[str, float]:
    return {"epoch": epoch, "loss": loss, "val_loss": 2 * loss}


def test_tensorboard_reads_both_sides_and_a_resumed_epoch_once(tmp_path: Path) -> None:
    pytest.importorskip("tensorboard")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    told: list[dict[str, float]] = []

    class Ears:
        def batch(self, *what: object) -> None:
            told.append({})

        def epoch(self, row: dict[str, float]) -> None:
            told.append(row)

    first = TensorBoard(tmp_path, Ears())
    first.batch(1, 1, 2, {"loss": 9.0})
    for number in (1, 2):
        first.epoch(row(number, 1.0 / number))
    assert told == [{}, row(1, 1.0), row(2, 0.5)]
    again = TensorBoard(tmp_path, Ears())
    for number in (2, 3):
        again.epoch(row(number, 5.0 / number))
    events = EventAccumulator(str(tmp_path)).Reload()
    assert set(events.Tags()["scalars"]) == {"loss/training", "loss/held out"}
    found = [(e.step, e.value) for e in events.Scalars("loss/training")]
    assert found == [(1, 1.0), (2, 2.5), (3, pytest.approx(5 / 3))]
    assert events.Scalars("loss/held out")[0].value == 2.0


def test_a_missing_package_is_an_install_hint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, "find_spec", lambda name: None)
    with pytest.raises(UserError, match="pip install tensorboard"):
        TensorBoard(tmp_path, None)  # type: ignore[arg-type]
