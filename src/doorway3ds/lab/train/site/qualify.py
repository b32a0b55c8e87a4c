"""A network for one site: measured on held-out places, fine-tuned on the others, kept if better.

Three parts that share no place: images to learn from, images that stop and choose the
training, and images that nothing but the final comparison sees.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from doorway3ds.camera.choice import FitCamera
from doorway3ds.camera.model import Pose
from doorway3ds.errors import CallError, UserError
from doorway3ds.files import digest, write_bytes
from doorway3ds.lab.datasets import places as groups
from doorway3ds.lab.datasets.doors import DoorPictures, check_pictures
from doorway3ds.lab.datasets.places import ALL, Choice, Seen, unseen
from doorway3ds.lab.datasets.readers import CLASS_FOLDERS, guess_layout, in_places, read_dataset
from doorway3ds.lab.datasets.samples import Sample as Picture
from doorway3ds.lab.datasets.samples import load_frame, with_camera
from doorway3ds.lab.evaluate.direction import DirectionRecord
from doorway3ds.lab.evaluate.intervals import plain
from doorway3ds.lab.evaluate.report.html import Report
from doorway3ds.lab.evaluate.runners import match_answers, methods_on, run_direction
from doorway3ds.lab.evaluate.stored import Label, read_answers
from doorway3ds.lab.train.doornet.data.samples import (
    Sample,
    from_frame,
    read_samples,
)
from doorway3ds.lab.train.doornet.export import export_onnx
from doorway3ds.lab.train.doornet.restore import restore
from doorway3ds.lab.train.engine.loop import Row
from doorway3ds.lab.train.engine.training import Run, Training
from doorway3ds.lab.train.options import TuneOptions
from doorway3ds.lab.train.site import score
from doorway3ds.lab.train.site.fit import (
    BEFORE,
    SITE,
    depth_change,
    keep_depth,
    tune,
)
from doorway3ds.lab.train.site.report import site_page
from doorway3ds.networks import registry
from doorway3ds.networks.doornet import DoorNet as Runtime

MIN_PICTURES, MIN_PLACES = 8, 8  # images of each class, places altogether
MIN_HELD = 4  # held-out places: fewer say next to nothing of the next one
_INNER = 0.25  # of what is not held out: stops and chooses


@dataclass(frozen=True)
class Parts:
    """The site's images by use; leaks: near-copies of which only one side is held out."""

    learn: tuple[Picture, ...]
    inner: tuple[Picture, ...]
    held: tuple[Picture, ...]
    leaks: int

    def to_dict(self) -> dict[str, Any]:
        """Counts, for a card."""
        return {
            name: {"pictures": len(own), "places": len({p.place for p in own})}
            for name, own in (("learn", self.learn), ("inner", self.inner), ("held", self.held))
        }


def network_file(name: str) -> Path:
    """The ONNX file that fine-tuning starts from: doornet, or a file of its kind."""
    path = Path(name) if name.endswith(".onnx") else registry.find(name).path
    if not path.is_file():
        raise UserError(f"no network file {path}; expected an existing .onnx file")
    if registry.kind_of(path) != "doornet":
        raise CallError(f"{name} is not a doornet; `3ds qualify` can fine-tune no other network")
    return path


def read_site(
    folder: Path,
    choice: Choice = ALL,
    *,
    places: Mapping[str, str] | None = None,
    camera: tuple[FitCamera, Pose] | None = None,
    seen: Seen = unseen,
) -> DoorPictures:
    """The images of a folder per class, those that its doorways.csv marks, or both.

    Where both are there, the table's word counts for the images that it names. camera: of
    those that bring none. Raises UserError where there are too few, saying how many are needed.
    """
    if not folder.is_dir():
        raise UserError(f"expected a folder of images, got {folder}")
    layout = guess_layout(folder)
    data = read_dataset(folder, layout)
    samples, known = list(data.samples), data.places_known
    classes = any(d.name in CLASS_FOLDERS for d in folder.iterdir() if d.is_dir())
    if layout == "plain" and classes:
        files = {s.image_path.resolve() for s in samples}
        more = read_dataset(folder, "folders")
        samples += [s for s in more.samples if s.image_path.resolve() not in files]
        known = known and more.places_known
    if camera is not None:
        data = with_camera(replace(data, samples=tuple(samples)), *camera)
        samples = list(data.samples)
    if places is not None:
        samples, known = in_places(samples, places), True
    found = check_pictures(samples, folder, choice, places_known=known, seen=seen)
    for label in sorted(set(found.labels)):
        count = found.labels.count(label)
        if count < MIN_PICTURES:
            raise UserError(
                f"{folder} has {count} readable images of class {label}; at least "
                f"{MIN_PICTURES} of each class are needed"
            )
    count = len(set(found.groups))
    if count < MIN_PLACES:
        raise UserError(
            f"{folder} shows {count} places ({found.grouping}); at least {MIN_PLACES} are needed, "
            f"so that some can be held out"
        )
    return found


def part(pictures: DoorPictures, hold_out: float, seed: int) -> Parts:
    """Whole places to learn from, to choose by and held out, each with both classes."""
    named = [replace(s, place=g) for s, g in zip(pictures.samples, pictures.groups, strict=True)]
    first = pictures.split(hold_out, seed)
    held = tuple(named[i] for i in first.held)
    places = len({s.place for s in held})
    if places < MIN_HELD:
        raise UserError(
            f"only {places} places could be held out, {MIN_HELD} are needed: add images of "
            f"other places, or raise --hold-out"
        )
    rest = [named[i] for i in first.train]
    labels = [pictures.labels[i] for i in first.train]
    learn, inner = groups.split([s.place for s in rest], labels, _INNER, seed)
    return Parts(
        tuple(rest[i] for i in learn), tuple(rest[i] for i in inner), held, len(first.leaks)
    )


def read_replay(folders: Sequence[Path], unlike: Sequence[Picture]) -> tuple[list[Sample], int]:
    """Images of other data sets to learn from, without near-copies of `unlike`, and how many
    of those were left out."""
    found = [sample for folder in folders for sample in read_samples(folder)]
    if not found:
        return [], 0
    images = [load_frame(picture).image for picture in unlike] + [s.image for s in found]
    pairs = groups.near_pairs(np.stack([groups.perceptual_hash(image) for image in images]))
    count = len(unlike)
    alike = {b - count for a, b in pairs if a < count <= b}
    return [s for i, s in enumerate(found) if i not in alike], len(alike)


def compare_answers(
    pictures: DoorPictures, before: Path, after: Path, repeats: int = 2000, seed: int = 0
) -> score.Comparison:
    """Two networks on all of a site's images, by answers that `3ds batch` or `look` stored.

    Raises UserError if either cannot be read, or holds answers of several networks.
    """
    named = [replace(s, place=g) for s, g in zip(pictures.samples, pictures.groups, strict=True)]
    columns: list[dict[str, DirectionRecord]] = []
    for path in (before, after):
        runs = match_answers(named, read_answers([path]))
        if len(runs.records) > 1:
            held = ", ".join(map(str, runs.records))
            raise UserError(f"{path} holds answers of {held}; expected those of one network")
        (records,) = runs.records.values()
        columns.append({record.truth.image: record for record in records})
    first, second = columns
    both = [name for name in first if name in second]
    if not both:
        raise UserError(f"{before} and {after} answer no image of the site together")
    return score.compare(
        [first[name] for name in both], [second[name] for name in both], repeats, seed
    )


class SiteTraining(Training):
    """Fine-tunes a network on a site's images and compares both on its held-out places.

    folder: where the images are from. parts: of `part`. replay: data sets to learn from, too.
    repeats: bootstrap resamples of the comparison. tell: told which stage begins.
    """

    name = "site"

    def __init__(
        self,
        folder: Path,
        pictures: DoorPictures,
        parts: Parts,
        network: Path,
        run: Run,
        options: TuneOptions,
        *,
        replay: Sequence[Path] = (),
        hold_out: float = 0.4,
        repeats: int = 2000,
        tell: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.pictures, self.parts, self.network, self.run = pictures, parts, network, run
        self.options, self.hold_out, self.repeats, self.tell = options, hold_out, repeats, tell
        self._before = Runtime(network)
        self._restored = restore(network)
        loose = guess_layout(folder) == "boxes"
        self._learn, self._inner = (
            keep_depth([from_frame(p, load_frame(p), SITE, loose=loose) for p in own], self._before)
            for own in (parts.learn, parts.inner)
        )
        others, self._alike = read_replay(replay, [*parts.held, *parts.inner])
        self._others = keep_depth(others, self._before)

    def fit(self) -> list[Row]:
        self.tuned = tune(
            self._restored.net,
            self._restored.calibration,
            [*self._learn, *self._others],
            self._inner,
            self.options,
            self.run,
            self.tell,
        )
        return [row for rows in self.tuned.history.values() for row in rows]

    def describe(self) -> dict[str, Any]:
        others = {"pictures": len(self._others), "near_copies_left_out": self._alike}
        return {
            "source": f"{self.network.name} fine-tuned on images of one site",
            "started_from": digest(self.network),
            "parts": self.parts.to_dict(),
            "places_by": self.pictures.grouping,
            "near_copies_across_the_split": self.parts.leaks,
            "replayed": others,
            "left_out": dict(self.pictures.left_out),
            "options": {
                **asdict(self.options),
                "patience": self.options.patience,
                "hold_out": self.hold_out,
            },
            "learned": self.tuned.stage,
            "losses_of_openings": self.tuned.losses,
            "calibration": asdict(self.tuned.calibration),
            "recalibrated": list(self.tuned.recalibrated),
            "rule": score.RULE,
        }

    def export(self, path: Path, card: Mapping[str, Any]) -> float:
        if self.tuned.stage == BEFORE:
            write_bytes(path, self.network.read_bytes())
            return 0.0
        shown = {**self._restored.metadata, "name": self.name, "date": card["date"]}
        net, found = self._restored.net.whole, self.tuned.calibration
        return export_onnx(net, path, calibration=found, metadata=shown)

    def judge(self, path: Path) -> dict[str, Any]:
        answers = [
            methods_on(network, name, ["opening"])
            for network, name in ((self._before, "before"), (Runtime(path), "after"))
        ]
        changes: list[float] = []

        def both(frame: Any, depth_m: Any) -> dict[Label, Any]:
            found = {label: d for answer in answers for label, d in answer(frame, depth_m).items()}
            first, second = (decision.perception.depth_m for decision in found.values())
            if first is not None and second is not None:
                changes.append(depth_change(first, second))
            return found

        runs = run_direction(self.parts.held, both)
        self.records = {label.network: column for label, column in runs.records.items()}
        self.depth_change = float(np.mean(changes)) if changes else math.inf
        seed, repeats = self.options.seed, self.repeats
        self.comparison = score.compare(
            self.records["before"], self.records["after"], repeats, seed
        )
        self.verdict = score.judge(self.comparison, self.depth_change)
        if self.tuned.stage == BEFORE:
            why = "nothing learned fits the places set apart better than the network as it is"
            self.verdict = score.Verdict(False, why)
        return {
            **asdict(self.verdict),
            "depth_change": self.depth_change,
            "held_out": plain(self.comparison),
        }

    def page(self, card: Mapping[str, Any]) -> Report:
        return site_page(self, card)
