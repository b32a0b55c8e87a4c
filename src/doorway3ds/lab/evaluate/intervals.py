"""Confidence intervals: Wilson for independent pictures, bootstrap by place for the rest.

Pictures of one room resemble each other, so resampling single pictures gives intervals
that are too narrow; whole places are resampled instead (cluster bootstrap, percentile).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

CONFIDENCE = 0.95  # of every interval
Indices = NDArray[np.intp]
# (n,) picture indices, with repeats -> (M,) values, nan where undefined
Statistic = Callable[[Indices], NDArray[np.floating[Any]]]


@dataclass(frozen=True)
class Interval:
    """A value, its confidence interval, and the number of pictures that it rests on.

    low, high are nan where no interval was computed or none is defined.
    """

    value: float
    low: float
    high: float
    n: int


def plain(value: Any) -> Any:
    """The same for JSON: dataclasses as mappings, arrays as lists, unknown numbers as None."""
    if is_dataclass(value):
        value = vars(value)
    if isinstance(value, Mapping):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def wilson(successes: int, n: int) -> Interval:
    """Wilson score interval of a share of independent trials (Wilson 1927)."""
    if not 0 <= successes <= n:
        raise ValueError(f"successes must lie in 0..n, got {successes} of {n}")
    if n == 0:
        return Interval(math.nan, math.nan, math.nan, 0)
    z = NormalDist().inv_cdf((1 + CONFIDENCE) / 2)
    share = successes / n
    scale = 1 + z * z / n
    middle = (share + z * z / (2 * n)) / scale
    half = z / scale * math.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    # Exact at the ends; rounding would leave 1e-17 beyond them.
    low = 0.0 if successes == 0 else middle - half
    high = 1.0 if successes == n else middle + half
    return Interval(share, low, high, n)


def bootstrap(
    statistic: Statistic,
    places: Sequence[str],
    counts: Sequence[int],
    repeats: int = 2000,
    seed: int = 0,
) -> list[Interval]:
    """Values of `statistic` on all pictures with the percentile interval over resampled places.

    counts: (M,) pictures that each value rests on. Resamples in which a value is undefined (no
    picture of its kind drawn) are left out of that value's percentiles. `repeats` 0, or a single
    place, leaves the intervals nan.
    """
    value = np.asarray(statistic(np.arange(len(places))), float)
    draws = np.empty((0, len(value)))
    if repeats > 0 and len(set(places)) > 1:
        draws = np.stack([statistic(indices) for indices in _resamples(places, repeats, seed)])
    tail = (1 - CONFIDENCE) / 2
    found = []
    for m, count in enumerate(counts):
        low = high = math.nan
        # An interval from a handful of lucky resamples would be worse than none.
        defined = draws[~np.isnan(draws[:, m]), m]
        if len(defined) >= max(repeats / 2, 1):
            low, high = np.quantile(defined, [tail, 1 - tail])
        found.append(Interval(float(value[m]), float(low), float(high), count))
    return found


def paired_difference(
    first: Statistic,
    second: Statistic,
    places: Sequence[str],
    counts: Sequence[int],
    repeats: int = 2000,
    seed: int = 0,
) -> list[Interval]:
    """`second - first` with its interval, both computed on the same resampled places.

    The two see the same pictures, so most of the scatter cancels: the interval is about the
    difference, not about either value.
    """

    def difference(indices: Indices) -> NDArray[np.floating[Any]]:
        return np.asarray(second(indices)) - np.asarray(first(indices))

    return bootstrap(difference, places, counts, repeats, seed)


def mean_interval(values: ArrayLike, places: Sequence[str], repeats: int = 2000) -> Interval:
    """Mean of the known (not nan) values with its interval by place."""
    array = np.asarray(values, float)
    known = int(np.sum(~np.isnan(array)))
    (found,) = bootstrap(
        lambda indices: np.array([nan_mean(array[indices])]), places, [known], repeats
    )
    return widened(found)


def widened(found: Interval, share: bool = False) -> Interval:
    """`found`, unless resampling could not vary it, as with a single picture: an interval of no
    width would claim certainty. A share of 0 or 1 then has Wilson's interval, other values none.
    """
    if found.low != found.high:  # nan is not equal to itself
        return found
    if share and found.value in (0.0, 1.0):
        return wilson(round(found.value * found.n), found.n)
    return Interval(found.value, math.nan, math.nan, found.n)


def nan_mean(values: NDArray[np.floating[Any]]) -> float:
    """Mean of the known values, nan (without a warning) where there is none."""
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else math.nan


def nan_quantile(values: NDArray[np.floating[Any]], q: float) -> float:
    """Quantile of the known values, nan (without a warning) where there is none."""
    known = values[~np.isnan(values)]
    return float(np.quantile(known, q)) if known.size else math.nan


def _resamples(places: Sequence[str], repeats: int, seed: int) -> list[Indices]:
    rng = np.random.default_rng(seed)
    _, inverse = np.unique(np.asarray(places), return_inverse=True)
    members = [np.flatnonzero(inverse == g) for g in range(int(inverse.max()) + 1)]
    picks = rng.integers(len(members), size=(repeats, len(members)))
    return [np.concatenate([members[g] for g in row]) for row in picks]
