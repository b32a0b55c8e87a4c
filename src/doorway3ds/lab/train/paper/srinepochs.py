"""CNN-SRIN's head scored on the held-out pictures at several numbers of epochs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from doorway3ds.lab.datasets.doors import DoorPictures
from doorway3ds.lab.evaluate import classifier
from doorway3ds.lab.evaluate.classifier import ClassifierMetrics
from doorway3ds.lab.train.engine.loop import Loop, Row, Watcher
from doorway3ds.lab.train.paper import cnn_srin
from doorway3ds.lab.train.paper.srinrun import SrinOptions, loop_config, predict, prepare


@dataclass(frozen=True)
class EpochScores:
    """Held-out scores by epochs, the losses of every epoch, and near-copies across the split."""

    scored: dict[int, ClassifierMetrics]
    history: list[Row]
    leaks: int


def score_epochs(
    pictures: DoorPictures,
    options: SrinOptions,
    out: Path,
    epochs: Sequence[int],
    *,
    watcher: Watcher | None = None,
    seen: Callable[[int, int], None] = lambda done, total: None,
) -> EpochScores:
    """Held-out scores after each of `epochs`.

    One training, stopped and resumed: as the learning rate is constant and the order of pictures
    follows from seed and epoch alone, the weights after N epochs are those of `train_cnn_srin`
    for N epochs. options.epochs is not used.
    """
    ready = prepare(pictures, options, out, seen=seen)
    scored: dict[int, ClassifierMetrics] = {}
    history: list[Row] = []
    for count in sorted(set(epochs)):
        loop = Loop(
            ready.head,
            cnn_srin.losses,
            ready.train,
            ready.held,
            loop_config(replace(options, epochs=count)),
            out,
            identity=ready.identity,
            watcher=watcher,
        )
        history = loop.run(resume=bool(scored))
        scored[count] = classifier.score(ready.records(pictures, predict(ready.head, ready.held)))
    return EpochScores(scored, history, len(ready.split.leaks))
