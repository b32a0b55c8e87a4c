"""Confidence intervals: Wilson for independent images, bootstrap by place for the rest.

Images of one room resemble each other, so resampling single images gives intervals
that are too narrow; whole places are resampled instead (cluster bootstrap, percentile).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

CONFIDENCE = 0.95  # of every interval
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Interval:
    """A value, its confidence interval, and the number of images that it rests on.

    low, high are nan where no interval was computed or none is defined.
    """

    value: float
    low: float
    high: float
    n: int


@dataclass(frozen=True)
class Measure:
    """One value of a set of images.

    of: from (n,) image indices, with repeats, to the value; nan where undefined. n: how many
    images it rests on.
    """

    of: Callable[[Indices], float]
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
    measures: Mapping[str, Measure], places: Sequence[str], repeats: int = 2000, seed: int = 0
) -> dict[str, Interval]:
    """The value of each measure on all images with the percentile interval over resampled places.

    Resamples in which a value is undefined (no image of its kind drawn) are left out of that
    value's percentiles. `repeats` 0, or a single place, leaves the intervals nan.
    """
    resamples = _resamples(places, repeats, seed) if len(set(places)) > 1 else []
    tail = (1 - CONFIDENCE) / 2
    found = {}
    for name, measure in measures.items():
        low = high = math.nan
        drawn = np.array([measure.of(indices) for indices in resamples], float)
        # An interval from a handful of lucky resamples would be worse than none.
        defined = drawn[~np.isnan(drawn)]
        if len(defined) >= max(repeats / 2, 1):
            low, high = np.quantile(defined, [tail, 1 - tail])
        value = measure.of(np.arange(len(places)))
        found[name] = Interval(float(value), float(low), float(high), measure.n)
    return found


def paired_difference(
    first: Mapping[str, Measure],
    second: Mapping[str, Measure],
    places: Sequence[str],
    repeats: int = 2000,
    seed: int = 0,
) -> dict[str, Interval]:
    """`second - first` with its interval, both computed on the same resampled places.

    The two see the same images, so most of the scatter cancels: the interval is about the
    difference, not about either value.
    """

    def difference(a: Measure, b: Measure) -> Measure:
        return Measure(lambda indices: b.of(indices) - a.of(indices), a.n)

    both = {name: difference(measure, second[name]) for name, measure in first.items()}
    return bootstrap(both, places, repeats, seed)


def by_place(
    measures: Mapping[str, Measure],
    places: Sequence[str],
    repeats: int = 2000,
    shares: Collection[str] = (),
) -> dict[str, Interval]:
    """`bootstrap`, `widened`; shares: names of those measures that are shares."""
    found = bootstrap(measures, places, repeats)
    return {name: widened(value, name in shares) for name, value in found.items()}


def mean(values: ArrayLike) -> Measure:
    """Of the known (not nan) values."""
    array = np.asarray(values, float)
    return Measure(lambda indices: nan_mean(array[indices]), int(np.sum(~np.isnan(array))))


def quantile(values: ArrayLike, q: float) -> Measure:
    """Of the known (not nan) values."""
    array = np.asarray(values, float)

    def of(indices: Indices) -> float:
        known = array[indices][~np.isnan(array[indices])]
        return float(np.quantile(known, q)) if known.size else math.nan

    return Measure(of, int(np.sum(~np.isnan(array))))


def widened(found: Interval, share: bool = False) -> Interval:
    """`found`, unless resampling could not vary it, as with a single image: an interval of no
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


def _resamples(places: Sequence[str], repeats: int, seed: int) -> list[Indices]:
    rng = np.random.default_rng(seed)
    _, inverse = np.unique(np.asarray(places), return_inverse=True)
    members = [np.flatnonzero(inverse == g) for g in range(int(inverse.max()) + 1)]
    picks = rng.integers(len(members), size=(repeats, len(members)))
    return [np.concatenate([members[g] for g in row]) for row in picks]
