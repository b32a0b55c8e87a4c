"""Which images belong together, and splits that keep together what does."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import CallError, UserError
from doorway3ds.lab.datasets.samples import Sample

BITS = 63
NEAR = 10  # bits in which two images of one view differ at most, of BITS
_SIDE, _LOW = 32, 8
_ROWS = 1024

Image = NDArray[np.uint8]
Read = TypeVar("Read")
Seen = Callable[[int, int], None]
"""Told of progress: how many are done of how many."""


def unseen(done: int, total: int) -> None:
    """Nobody is told."""


@dataclass(frozen=True)
class Choice:
    """Which images of a data set are taken, and which of them are never split.

    grouping, pattern: see `name_groups`. half_open: see `doors.check_pictures`. limit: at most so
    many (per class, if there are classes), drawn by `seed`.
    """

    grouping: str = "auto"
    pattern: str | None = None
    half_open: str = "leave-out"
    limit: int | None = None
    seed: int = 0

    def draw(self, samples: Sequence[Sample]) -> list[Sample]:
        """At most `limit` of them, in their order."""
        if self.limit is None or len(samples) <= self.limit:
            return list(samples)
        order = np.random.default_rng(self.seed).permutation(len(samples))
        return [samples[i] for i in sorted(order[: self.limit])]


ALL = Choice()


@dataclass(frozen=True)
class Split:
    """Indices to learn from and held out; leaks: near-copies of which each side has one."""

    train: tuple[int, ...]
    held: tuple[int, ...]
    leaks: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Pictures:
    """Readable images in groups.

    groups: by image; what shares one is never split. grouping: how they were found.
    pairs: images that show nearly the same. left_out: why, by name.
    """

    samples: tuple[Sample, ...]
    groups: tuple[str, ...]
    grouping: str
    pairs: tuple[tuple[int, int], ...]
    left_out: Mapping[str, str]

    @property
    def labels(self) -> list[str]:
        """The class of each image: `split` holds out a share of every one."""
        return ["picture"] * len(self.samples)

    def split(self, share: float, seed: int) -> Split:
        """Whole groups held out, near `share` of each class."""
        return self.split_at(*split(self.groups, self.labels, share, seed))

    def split_at(self, train: Sequence[int], held: Sequence[int]) -> Split:
        """These sides with their leaks."""
        outside = set(held)
        leaks = tuple((a, b) for a, b in self.pairs if (a in outside) != (b in outside))
        return Split(tuple(train), tuple(held), leaks)

    def told(self, split: Split) -> dict[str, Any]:
        """What a training's card says of the images."""
        return {
            "left_out": dict(self.left_out),
            "grouping": self.grouping,
            "groups": len(set(self.groups)),
            "near_copies_across_the_split": len(split.leaks),
        }


def read_each(
    samples: Sequence[Sample], read: Callable[[Sample], Read], seen: Seen
) -> tuple[list[tuple[Sample, Read]], dict[str, str]]:
    """What `read` returns for each sample, and why others are left out: its UserErrors."""
    found: list[tuple[Sample, Read]] = []
    left_out: dict[str, str] = {}
    for number, sample in enumerate(samples):
        seen(number, len(samples))
        try:
            found.append((sample, read(sample)))
        except UserError as error:
            left_out[sample.name] = str(error)
    seen(len(samples), len(samples))
    return found, left_out


def group(
    samples: Sequence[Sample], hashes: Sequence[NDArray[np.bool_]], known: bool, choice: Choice
) -> tuple[tuple[Sample, ...], tuple[str, ...], str, tuple[tuple[int, int], ...]]:
    """The first fields of `Pictures`. hashes: perceptual ones. known: the samples name places."""
    pairs = near_pairs(np.array(hashes, bool).reshape(-1, 2, BITS))
    names, how = name_groups(
        samples, pairs, places_known=known, grouping=choice.grouping, pattern=choice.pattern
    )
    return tuple(samples), names, how, tuple(pairs)


def perceptual_hash(image: Image) -> NDArray[np.bool_]:
    """(2, 63) bits of a (H, W, 3) image: of itself and mirrored.

    Signs of the lowest 8x8 cosine frequencies of a 32x32 grey copy about their median, the
    mean left out (as in Zauner, "Implementation and benchmarking of perceptual image hash
    functions", 2010). Scaling, recompression and exposure change few bits.
    """
    grey: Any = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    small = np.asarray(cv2.resize(grey, (_SIDE, _SIDE), interpolation=cv2.INTER_AREA), np.float32)
    codes = []
    for view in (small, small[:, ::-1]):
        low = np.asarray(cv2.dct(np.ascontiguousarray(view)))[:_LOW, :_LOW].ravel()[1:]
        codes.append(low > np.median(low))
    return np.stack(codes)


def near_pairs(hashes: NDArray[np.bool_], near: int = NEAR) -> list[tuple[int, int]]:
    """Index pairs (a < b) of (N, 2, 63) hashes that show nearly the same, mirrored or not."""
    signs = np.where(hashes, 1.0, -1.0).astype(np.float32)
    plain, mirrored = signs[:, 0], signs[:, 1]
    pairs: list[tuple[int, int]] = []
    for start in range(0, len(signs), _ROWS):
        rows = plain[start : start + _ROWS]
        alike = np.maximum(rows @ plain.T, rows @ mirrored.T)
        for a, b in zip(*np.nonzero((BITS - alike) / 2 <= near), strict=True):
            if start + a < b:
                pairs.append((int(start + a), int(b)))
    return pairs


def clusters(count: int, pairs: Sequence[tuple[int, int]]) -> list[int]:
    """A group number for each of `count` images: pairs, and what they link, share one."""
    parent = list(range(count))

    def root(node: int) -> int:
        while parent[node] != node:
            parent[node] = parent[parent[node]]
            node = parent[node]
        return node

    for a, b in pairs:
        parent[root(a)] = root(b)
    return [root(node) for node in range(count)]


def name_groups(
    samples: Sequence[Sample],
    pairs: Sequence[tuple[int, int]],
    *,
    places_known: bool,
    grouping: str = "auto",
    pattern: str | None = None,
) -> tuple[tuple[str, ...], str]:
    """The group of each sample, and in words how it was found.

    grouping: `auto` takes the samples' places where the data set names them, else
    near-duplicates; `near` always near-duplicates; `folder` the folder an image lies in.
    pattern: instead, a regular expression whose first group is the place, searched in the name.
    """
    if pattern is not None:
        return _by_pattern([s.name for s in samples], pattern), f"pattern {pattern}"
    if grouping == "folder":
        return tuple(str(s.image_path.parent) for s in samples), "folders"
    if grouping == "auto" and places_known:
        return tuple(s.place for s in samples), "places named by the data set"
    found = tuple(samples[root].name for root in clusters(len(samples), pairs))
    return found, f"near-duplicates (perceptual hash, {NEAR} of {BITS} bits)"


def _by_pattern(names: Sequence[str], pattern: str) -> tuple[str, ...]:
    try:
        expression = re.compile(pattern)
    except re.error as error:
        raise CallError(f"--group-pattern is not a regular expression: {error}") from error
    if not expression.groups:
        raise CallError("--group-pattern needs one group in parentheses, as in '(room\\d+)_'")
    found = []
    for name in names:
        match = expression.search(name)
        if match is None:
            raise UserError(f"--group-pattern {pattern!r} is not found in {name}")
        found.append(match.group(1))
    return tuple(found)


def split(
    groups: Sequence[str], labels: Sequence[str], share: float, seed: int
) -> tuple[list[int], list[int]]:
    """(training, held-out) indices: whole groups, near `share` of each label held out.

    In an order that the seed shuffles, each group is held out that brings the shares nearer.
    Raises UserError where a label's images cannot be on both sides.
    """
    names = sorted(set(labels))
    of_group: dict[str, NDArray[np.float64]] = {}
    for group, label in zip(groups, labels, strict=True):
        of_group.setdefault(group, np.zeros(len(names)))[names.index(label)] += 1
    for position, name in enumerate(names):
        holding = sum(counts[position] > 0 for counts in of_group.values())
        if holding < 2:
            raise UserError(
                f"class {name} has all its images in {holding} group; expected at least 2, "
                f"so that one can be held out: add images of other places"
            )
    total = np.sum(list(of_group.values()), axis=0)
    wanted = np.maximum(share * total, 1.0)
    order = sorted(of_group)
    np.random.default_rng(seed).shuffle(order)
    taken = np.zeros(len(names))
    held: set[str] = set()
    for group in order:
        counts = of_group[group]
        after = taken + counts
        gain = np.abs(taken - wanted) / wanted - np.abs(after - wanted) / wanted
        # a label must never be held out as a whole
        if gain.sum() > 0 and np.all((after < total) | (counts == 0)):
            taken = after
            held.add(group)
    for position, name in enumerate(names):
        if taken[position] == 0:
            smallest = min(
                (g for g in order if of_group[g][position] > 0 and g not in held),
                key=lambda g: of_group[g].sum(),
            )
            if np.any((taken + of_group[smallest] >= total) & (of_group[smallest] > 0)):
                raise UserError(
                    f"no group can be held out for class {name} without emptying a class; "
                    f"add images of other places"
                )
            taken = taken + of_group[smallest]
            held.add(smallest)
    sides: tuple[list[int], list[int]] = ([], [])
    for index, group in enumerate(groups):
        sides[group in held].append(index)
    return sides
