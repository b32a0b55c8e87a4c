"""Resident memory over time: how fast it grows, and a plot of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np


def mb_per_hour(seconds: Sequence[float], mb: Sequence[float]) -> float:
    """Slope of a line through the second half, when all that is made once has been made."""
    half = len(seconds) // 2
    if len(seconds) - half < 5:
        return 0.0
    return float(np.polyfit(seconds[half:], mb[half:], 1)[0]) * 3600


def plot(path: Path, title: str, curves: Mapping[str, tuple[Sequence[float], Sequence[float]]]
         ) -> None:  # fmt: skip
    """Writes a PNG of curves {label: (seconds, MB)}."""
    try:
        import matplotlib.pyplot as plt
    except ModuleNotFoundError:
        print("no plot: pip install 'doorway3ds[report]'")
        return
    figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
    for label, (seconds, mb) in curves.items():
        axes.plot(np.array(seconds) / 60, mb, label=label)
    axes.set(xlabel="minutes", ylabel="RSS in MB", title=title)
    axes.set_ylim(0, 1.2 * max(max(mb) for _, mb in curves.values()))
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=120)
    print(f"written to {path}")
