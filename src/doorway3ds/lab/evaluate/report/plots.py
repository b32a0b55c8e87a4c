"""Plots of a report, as bytes of PNG files (extra `report`: matplotlib)."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from doorway3ds.lab.evaluate import metrics
from doorway3ds.lab.evaluate.classifier import ClassifierMetrics, ClassifierRecord
from doorway3ds.lab.evaluate.depth import DepthRecord
from doorway3ds.lab.evaluate.direction import METRICS, DirectionMetrics, DirectionRecord, judge

COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
GO_ROWS = ("within_5deg", "inside", "go_when_clear", "go_when_blocked", "go_without_door")


def bearing_errors(runs: Mapping[str, Sequence[DirectionRecord]]) -> bytes:
    """Share of doorway images whose bearing error is at most so many degrees."""
    with figure() as (axes, done):
        for name, records in runs.items():
            doorway = [judge(r) for r in records if r.truth.openings]
            if not doorway:
                continue
            # Images without a listed opening never arrive: the curve ends below 1.
            errors = np.sort([abs(o.error_deg) for o in doorway if o.matched is not None])
            share = np.arange(1, len(errors) + 1) / len(doorway)
            axes.step(np.append(0, errors), np.append(0, share), where="post", label=name)
        axes.axvline(5, color="0.6", linewidth=0.8, linestyle=":")
        axes.set(xlim=(0, 30), ylim=(0, 1), xlabel="bearing error, degrees at most")
        axes.set_ylabel("share of doorway images")
        axes.legend(frameon=False)
    return done()


def shares(runs: Mapping[str, DirectionMetrics]) -> bytes:
    """The table's main shares as points with intervals."""
    with figure() as (axes, done):
        for number, (name, scored) in enumerate(runs.items()):
            offset = 0.5 - (number + 1) / (len(runs) + 1)
            rows = [scored[row] for row in GO_ROWS]
            at = np.arange(len(rows))[::-1] + 0.6 * offset
            value = np.array([row.value for row in rows])
            low = np.nan_to_num(value - [row.low for row in rows])
            high = np.nan_to_num([row.high for row in rows] - value)
            spread = np.clip([low, high], 0, None)
            axes.errorbar(value, at, xerr=spread, fmt="o", label=name, markersize=4)
        axes.set_yticks(np.arange(len(GO_ROWS))[::-1], [METRICS[row].title for row in GO_ROWS])
        axes.set(xlim=(0, 1), xlabel="share, with the 95 % interval by place")
        axes.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.3, 1.0), ncols=2)
    return done()


def roc(runs: Mapping[str, Sequence[ClassifierRecord]]) -> bytes:
    """True- against false-positive rate."""
    with figure() as (axes, done):
        for name, records in runs.items():
            false, true = metrics.roc_curve(
                [r.is_open for r in records], [r.p_open for r in records]
            )
            axes.step(false, true, where="post", label=name)
        axes.plot([0, 1], [0, 1], color="0.7", linewidth=0.8, linestyle=":")
        axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="not open, called open")
        axes.set_ylabel("open, called open")
        axes.set_aspect("equal")
        axes.legend(frameon=False)
    return done()


def reliability(runs: Mapping[str, ClassifierMetrics]) -> bytes:
    """Share really open against the probability given; the dot's area is the bin's images."""
    with figure() as (axes, done):
        for name, scored in runs.items():
            c = scored.calibration
            (line,) = axes.plot(c.probability, c.frequency, linewidth=1)
            area, color = 10 + 300 * c.count / c.count.sum(), line.get_color()
            axes.scatter(c.probability, c.frequency, s=area, color=color, alpha=0.6, label=name)
        axes.plot([0, 1], [0, 1], color="0.7", linewidth=0.8, linestyle=":")
        axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="p_open given", ylabel="share really open")
        axes.set_aspect("equal")
        axes.legend(frameon=False)
    return done()


def depth_spread(runs: Mapping[str, Sequence[DepthRecord]]) -> bytes:
    """Share of images whose delta1 is at most so much."""
    with figure() as (axes, done):
        for name, records in runs.items():
            values = np.sort([r.errors.delta1 for r in records if r.errors.pixels])
            share = np.arange(1, len(values) + 1) / max(len(values), 1)
            axes.step(values, share, where="post", label=name)
        axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="delta1 at most", ylabel="share of images")
        axes.legend(frameon=False)
    return done()


@contextmanager
def figure(
    width: float = 6.4, height: float = 4.2, kind: str = "png"
) -> Iterator[tuple[Any, Callable[[], bytes]]]:
    """Axes to draw on, and a function that returns the finished picture's bytes.

    width, height: inches. kind: of file.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
    axes = figure.add_subplot()
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_prop_cycle(color=COLORS)

    def done() -> bytes:
        buffer = io.BytesIO()
        figure.savefig(buffer, format=kind)
        return buffer.getvalue()

    yield axes, done
