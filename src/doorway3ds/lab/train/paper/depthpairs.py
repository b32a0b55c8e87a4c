"""Images with depth: the layouts that DenseDepth is trained from, read and checked."""

from __future__ import annotations

import re
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import CallError, UserError
from doorway3ds.files import read_text
from doorway3ds.images.folder import images_in
from doorway3ds.lab.datasets import places as groups
from doorway3ds.lab.datasets.places import ALL, Choice, Pictures, Seen, Split, unseen
from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.datasets.samples import Sample, load_depth, load_frame
from doorway3ds.lab.train.paper.densedepth import Setting

INDEX_TRAIN, INDEX_TEST = "nyu2_train.csv", "nyu2_test.csv"
_UNIT_8_BIT = 10 / 255  # metres per count of the index' training images
_UNIT_16_BIT = 0.001  # of its test images
_ASPECT = 0.02  # relative difference of image's and depth's aspect that is stretched away


@dataclass(frozen=True)
class DepthPairs(Pictures):
    """Images with depth.

    held: names that the data set itself sets aside for testing; empty where it says nothing.
    """

    held: frozenset[str]
    median_m: float

    def split(self, share: float, seed: int) -> Split:
        """The data set's own sides where it has them, else whole groups."""
        if not 0 < len(self.held) < len(self.samples):
            return super().split(share, seed)
        sides: tuple[list[int], list[int]] = ([], [])
        for index, sample in enumerate(self.samples):
            sides[sample.name in self.held].append(index)
        return self.split_at(*sides)


@dataclass(frozen=True)
class _Found:
    samples: list[Sample]
    known: bool
    held: frozenset[str] = frozenset()


def read_depth_pairs(
    path: Path,
    setting: Setting,
    choice: Choice = ALL,
    *,
    unit_m: float | None = None,
    unpack: Path | None = None,
    seen: Seen = unseen,
) -> DepthPairs:
    """Pairs of a folder or of DenseDepth's zip, which is unpacked to `unpack`.

    Layouts: DenseDepth's (data/nyu2_train.csv), NYU labelled or rendered (doorways.csv beside
    images/ and depth/), or any images/ and depth/ (or rgb/ and depth/) with files of the same
    stem, or NAME_depth.png beside NAME.jpg. unit_m: metres per count, needed for the last two.

    Raises UserError where nothing is readable, or the median depth says that the unit is wrong.
    """
    if path.suffix.lower() == ".zip" and path.is_file():
        path = _unpacked(path, unpack or path.with_suffix(""))
    if not path.is_dir():
        raise UserError(f"expected a folder or .zip with images and depth, got {path}")
    found = _found(path, unit_m)
    read, left_out = groups.read_each(choice.draw(found.samples), _checked, seen)
    if not read:
        why = "{}: {}".format(*next(iter(left_out.items()))) if left_out else "none was found"
        raise UserError(f"{path} has no image with readable depth; {why}")
    kept = [sample for sample, _ in read]
    median_m = float(np.median([median for _, (_, median) in read]))
    _require_plausible(median_m, setting, kept[0].depth_unit_m)
    grouped = groups.group(kept, [code for _, (code, _) in read], found.known, choice)
    held = found.held & {s.name for s in kept}
    return DepthPairs(*grouped, left_out, held, median_m)


def target(sample: Sample, setting: Setting) -> NDArray[np.float32]:
    """(1, h/2, w/2) farthest depth / depth, 0 where unknown."""
    depth = load_depth(sample)
    if depth is None:
        raise UserError(f"{sample.name} has no depth")
    known = np.isfinite(depth) & (depth > 0)
    clipped = np.clip(np.where(known, depth, 1.0), setting.nearest_m, setting.farthest_m)
    raw = np.where(known, setting.farthest_m / clipped, 0.0).astype(np.float32)
    size = (setting.width // 2, setting.height // 2)
    # Averaged over what is known, as a pixel of the small map covers several.
    total = np.asarray(cv2.resize(raw, size, interpolation=cv2.INTER_AREA))
    weight = np.asarray(cv2.resize(known.astype(np.float32), size, interpolation=cv2.INTER_AREA))
    small = np.where(weight >= 0.5, total / np.maximum(weight, 1e-6), 0.0)
    return np.asarray(small, np.float32)[None]


def _checked(sample: Sample) -> tuple[NDArray[np.bool_], float]:
    """The image's hash and its median depth; UserError where the pair is of no use."""
    if sample.depth_path is None or not sample.depth_path.is_file():
        raise UserError("has no depth file")
    image = load_frame(sample).image
    depth = load_depth(sample)
    assert depth is not None
    wide, deep = image.shape[1] / image.shape[0], depth.shape[1] / depth.shape[0]
    if abs(wide / deep - 1) > _ASPECT:
        raise UserError(
            f"image and depth have different aspects: {image.shape[1]}x{image.shape[0]} and "
            f"{depth.shape[1]}x{depth.shape[0]}"
        )
    known = depth[np.isfinite(depth) & (depth > 0)]
    if known.size == 0:
        raise UserError("has no known depth at all")
    return groups.perceptual_hash(image), float(np.median(known))


def _require_plausible(median_m: float, setting: Setting, unit_m: float) -> None:
    low, high = setting.plausible_m
    if not low <= median_m <= high:
        hints = [unit_m * 10.0**power for power in (-3, -2, -1, 1, 2, 3)]
        fitting = next((u for u in hints if low <= median_m / unit_m * u <= high), None)
        hint = f"; --unit-m {fitting:g} would fit" if fitting else ""
        raise UserError(
            f"the median depth is {median_m:.3g} m at {unit_m:g} m per count; expected "
            f"{low:g} to {high:g} m for {setting.name}: is the unit right?{hint}"
        )


def _found(path: Path, unit_m: float | None) -> _Found:
    for index in (path / "data" / INDEX_TRAIN, path / INDEX_TRAIN):
        if index.is_file():
            train = _indexed(index, path, _UNIT_8_BIT if unit_m is None else unit_m)
            test_index = index.with_name(INDEX_TEST)
            test = _indexed(test_index, path, _UNIT_16_BIT) if test_index.is_file() else []
            return _Found([*train, *test], True, frozenset(s.name for s in test))
    if (path / "doorways.csv").is_file() and (path / "depth").is_dir():
        data = read_dataset(path)
        if data.layout == "plain":
            unit = _required(unit_m, path)
            return _Found([replace(s, depth_unit_m=unit) for s in data.samples], data.places_known)
        return _Found(list(data.samples), data.places_known)
    return _Found(_matched(path, _required(unit_m, path)), False)


def _required(unit_m: float | None, path: Path) -> float:
    if unit_m is None:
        raise CallError(
            f"{path} does not say the unit of its depth; give --unit-m, metres per count "
            f"(0.001 for millimetres, 1 for metres)"
        )
    return unit_m


def _indexed(index: Path, root: Path, unit_m: float) -> list[Sample]:
    """Lines "image,depth" of DenseDepth's index; an image's folder is its place."""
    samples = []
    for number, line in enumerate(read_text(index).splitlines(), 1):
        if not line.strip():
            continue
        names = [part.strip() for part in line.split(",")]
        if len(names) != 2 or any(".." in Path(n).parts or Path(n).is_absolute() for n in names):
            raise UserError(f"{index} line {number}: expected image,depth below the folder")
        folder = Path(names[0]).parent
        place = folder.name if folder.name not in (".", "nyu2_test") else names[0]
        samples.append(
            Sample(
                name=names[0],
                place=place,
                image_path=root / names[0],
                is_open=None,
                depth_path=root / names[1],
                depth_unit_m=unit_m,
            )
        )
    return samples


def _matched(path: Path, unit_m: float) -> list[Sample]:
    """Images of any folder whose depth has the same stem, or NAME_depth, or none."""
    images = next((path / n for n in ("images", "rgb", "image") if (path / n).is_dir()), path)
    files = images_in(images, recursive=True)
    beside = images == path
    samples = []
    for file in files:
        if beside and re.search(r"[_-]depth$", file.stem):
            continue
        inside = file.relative_to(images).parent
        folder, stems = (
            (file.parent, (f"{file.stem}_depth", f"{file.stem}-depth"))
            if beside
            else (path / "depth" / inside, (file.stem, f"{file.stem}_depth"))
        )
        candidates = [folder / f"{s}{e}" for s in stems for e in (".png", ".tif", ".tiff")]
        samples.append(
            Sample(
                name=file.relative_to(path).as_posix(),
                place=file.relative_to(path).as_posix(),
                image_path=file,
                is_open=None,
                depth_path=next((c for c in candidates if c.is_file()), None),
                depth_unit_m=unit_m,
            )
        )
    return samples


def _unpacked(archive: Path, folder: Path) -> Path:
    """The zip's files in `folder`; those that lie there with their full size are kept."""
    try:
        with zipfile.ZipFile(archive) as file:
            for item in file.infolist():
                there = folder / item.filename
                if ".." in Path(item.filename).parts or Path(item.filename).is_absolute():
                    raise UserError(f"{archive} holds {item.filename}, outside of its own folder")
                if item.is_dir() or (there.is_file() and there.stat().st_size == item.file_size):
                    continue
                file.extract(item, folder)
    except (zipfile.BadZipFile, EOFError) as error:
        raise UserError(f"{archive} is damaged: {error}; fetch it again") from error
    except OSError as error:
        raise UserError(f"cannot unpack {archive} to {folder}: {error.strerror}") from error
    return folder
