"""One training of doornet from data sets to the ONNX file, its calibration and its card."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from doorway3ds.decide.options import PACKAGED
from doorway3ds.errors import UserError
from doorway3ds.files import digest, read_text, write_bytes
from doorway3ds.lab.datasets.csvfile import csv_bytes
from doorway3ds.lab.datasets.readers import guess_layout
from doorway3ds.lab.datasets.samples import place_folds
from doorway3ds.lab.evaluate.report.html import Report
from doorway3ds.lab.train.doornet.data.augment import view
from doorway3ds.lab.train.doornet.data.compose import compose
from doorway3ds.lab.train.doornet.data.marks import apply_marks, read_marks
from doorway3ds.lab.train.doornet.data.samples import (
    Sample,
    cluster_places,
    read_samples,
)
from doorway3ds.lab.train.doornet.data.teachers import add_depth, add_segments, describe
from doorway3ds.lab.train.doornet.data.unmarked import read_unmarked
from doorway3ds.lab.train.doornet.export import Calibration, export_onnx
from doorway3ds.lab.train.doornet.fit import collate, fit, plain_shape, save_weights
from doorway3ds.lab.train.doornet.model import DoorNet, build_doornet
from doorway3ds.lab.train.doornet.recipe import Recipe
from doorway3ds.lab.train.doornet.report import add_answers
from doorway3ds.lab.train.engine import outcome
from doorway3ds.lab.train.engine.backend import wants_half
from doorway3ds.lab.train.engine.calibrate import best_strips, platt, relative_depth_error
from doorway3ds.lab.train.engine.loop import Row
from doorway3ds.lab.train.engine.training import Run, Training
from doorway3ds.lab.train.options import DoornetOptions
from doorway3ds.networks import registry
from doorway3ds.networks.averaged import Averaged, Mirrored

# what the network's file says of itself; the card beside it says the rest
_SHOWN = ("name", "date", "depth_error", "held_out", "pictures", "thresholds", "presets", "costs")
_DEPTH_ERROR = 0.2  # relative, if no held-out image has measured depth
_SEEN_BY_CALIBRATION = (
    "Scores are of the held-out places. The calibration of p_open has been fitted on them, and "
    "early stopping, where asked for, looks at them: --report K keeps a further fold from both."
)
_SEEN_BY_NOTHING = (
    "Scores are of the fold given by --report, which neither training nor calibration has seen."
)


@dataclass(frozen=True)
class Teachers:
    """ONNX files that training starts from and distils.

    semantic: DeepLabv3+ on MobileNetV2 with ADE20K's 31 classes: first weights of the encoder, and
    pseudo-segments. depth: FastDepth: pseudo-depth. places: MobileNetV2 on ImageNet: tells which
    photographs show one place.
    """

    semantic: Path
    depth: Path
    places: Path

    @classmethod
    def in_folder(cls, folder: Path) -> Teachers:
        """The three files by their usual names; UserError names the first that is missing."""
        names = (
            "deeplabv3_mnv2_ade20k_512.onnx",
            "fastdepth_nyu_224.onnx",
            "mobilenet_v2_imagenet_224.onnx",
        )
        for name in names:
            if not (folder / name).is_file():
                raise UserError(f"{folder} holds no {name}; --teachers needs {', '.join(names)}")
        return cls(*(folder / name for name in names))


def read_all(folders: Sequence[Path], teachers: Teachers, recipe: Recipe) -> list[Sample]:
    """Samples of all data sets, each told by its files, with pseudo-labels where they have none."""
    samples: list[Sample] = []
    for folder in folders:
        found = read_samples(folder, closed_weight=recipe.closed_weight)
        if guess_layout(folder) == "boxes":
            places = cluster_places(describe(found, teachers.places), recipe.same_place)
            found = [
                replace(sample, place=f"{folder.name}-{place:04d}")
                for sample, place in zip(found, places, strict=True)
            ]
        samples += found
    return with_pseudo_labels(samples, teachers, recipe)


def with_pseudo_labels(samples: list[Sample], teachers: Teachers, recipe: Recipe) -> list[Sample]:
    """Samples with the teachers' depth and segments where they have none of their own."""
    samples = add_depth(samples, teachers.depth, recipe.pseudo.depth)
    return add_segments(samples, teachers.semantic, recipe.pseudo.segments)


def split(
    samples: Sequence[Sample], fold: int, folds: int, report: int | None = None
) -> tuple[list[Sample], list[Sample]]:
    """Training and held-out samples: one fold of the places of each source.

    report: a further fold that goes into neither.
    """
    kept: list[Sample] = []
    held: list[Sample] = []
    for source in sorted({sample.source for sample in samples}):
        own = [sample for sample in samples if sample.source == source]
        of_place = place_folds((sample.place for sample in own), folds)
        for sample in own:
            if of_place[sample.place] != report:
                (held if of_place[sample.place] == fold else kept).append(sample)
    return kept, held


def predict(network: Path, samples: Sequence[Sample]) -> list[dict[str, Any]]:
    """An exported network's outputs and the targets of the plain view of each sample."""
    import onnxruntime

    session = onnxruntime.InferenceSession(str(network), providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]
    found = []
    for sample in samples:
        target = view(sample, plain_shape(sample), None)
        values = session.run(None, {"image": collate([target])[0]})
        outputs = {name: value[0] for name, value in zip(names, values, strict=True)}
        found.append({"sample": sample, "target": target} | outputs)
    return found


def calibrate(answers: Sequence[dict[str, Any]]) -> tuple[Calibration, dict[str, Any]]:
    """Scales and shifts of the logits, and the depth's error, on held-out images.

    Every source counts alike for p_open. answers: of a file without calibration (`predict`).
    """
    told = [a for a in answers if a["sample"].open is not None]
    sizes = Counter(a["sample"].source for a in told)
    p_open = platt(
        np.array([[a["p_open"], a["score"].max()] for a in told]),
        np.array([a["sample"].open for a in told]),
        np.array([1 / sizes[a["sample"].source] for a in told]),
    )
    # a strip's score is read at the best strip: is there an opening in that place?
    rooms = [a for a in told if a["sample"].source != "doors"] or told
    score = platt(*best_strips((a["score"], a["target"].score) for a in rooms))
    # rendered depth is no camera's
    photographs = [a for a in answers if a["sample"].source != "rendered"] or answers
    measured = [a for a in photographs if a["target"].depth_weight == 1 and a["target"].depth.any()]
    errors = {}
    if measured:
        errors["depth_error"] = relative_depth_error(
            [a["depth"] for a in measured], [a["target"].depth for a in measured]
        )
    return Calibration(*p_open, *score), errors


class DoorNetTraining(Training):
    """Trains, calibrates and exports doornet.

    Of the places held out the first fold is for calibration, limits and early stopping, a further
    one for the report alone.
    """

    name = "doornet"

    def __init__(
        self,
        folders: Sequence[Path],
        teachers: Teachers,
        recipe: Recipe,
        run: Run,
        options: DoornetOptions,
    ) -> None:
        hold_out, report = options.fold, options.report
        if recipe.fit.patience and hold_out is None:
            raise UserError(
                "stopping early needs places that are not trained on: give --hold-out K/N, or "
                "leave --patience and the recipe's patience out"
            )
        if recipe.init_share and options.init is None:
            raise UserError("the recipe's init_share needs weights to start from: give --init FILE")
        self.teachers, self.recipe, self.run, self.options = teachers, recipe, run, options
        samples = read_all(folders, teachers, recipe)
        if options.marks is not None:
            samples = apply_marks(samples, read_marks(options.marks))
        further = None if report is None else report - 1
        kept, self.held = split(samples, *hold_out, further) if hold_out else (samples, [])
        self.kept = kept + compose(kept, recipe.compose, recipe.fit.seed)
        self.labelled_by: str | None = None
        if options.unmarked:
            names = options.labeller or [PACKAGED]
            network = Averaged([Mirrored(registry.load(name)) for name in names])
            self.labelled_by = network.name
            for folder in options.unmarked:
                self.kept += with_pseudo_labels(read_unmarked(folder, network), teachers, recipe)
        self.unseen, self.about = self.held, _SEEN_BY_CALIBRATION
        if hold_out and further is not None:
            self.unseen, self.about = split(samples, further, hold_out[1])[1], _SEEN_BY_NOTHING
        self._halves = halves_of(self.held)

    def fit(self) -> list[Row]:
        import keras

        recipe, teachers, init, run = self.recipe, self.teachers, self.options.init, self.run
        if run.team.leads and self.held:
            write_held(run.out / "held-out.csv", self.held, self._halves)
        keras.utils.set_random_seed(recipe.fit.seed)
        self.net = build_doornet(teachers.semantic, recipe.network)
        if init is not None:
            load_weights(self.net, init)
        first = [teachers.semantic, teachers.depth, *([init] if init else [])]
        history = fit(
            self.net,
            self.kept,
            recipe.fit,
            run,
            augment=recipe.augment,
            weights=recipe.losses,
            held=self.held,
            half=wants_half(self.options.precision),
            identity=outcome.identity(
                [digest(path) for path in first],
                asdict(recipe.network),
                asdict(recipe.pseudo),
                asdict(recipe.compose),
                recipe.closed_weight,
            ),
        )
        if run.team.leads:
            if len(recipe.fit.stages) > 1:
                self._blend(run.out / "stage-0.weights.h5", recipe.first_share)
            if init is not None:
                self._blend(init, recipe.init_share)
        return history

    def _blend(self, first: Path, share: float) -> None:
        if share:
            blend(self.net, first, share)
            save_weights(self.net, self.run.out / "blend.weights.h5")

    def describe(self) -> dict[str, Any]:
        found, measured = Calibration(), dict[str, Any]()
        self._for_half: dict[int, Calibration] = {}
        if self.held:
            path = self.run.out / f"{self.name}.onnx"
            export_onnx(self.net.whole, path, metadata={})
            answers = predict(path, self.held)
            found, measured = calibrate(answers)
            for half in (1, 2):
                other = [
                    a
                    for a in answers
                    if self._halves[a["sample"].source, a["sample"].place] != half
                ]
                self._for_half[half] = calibrate(other)[0] if other else found
        elif self.options.calibration is not None:
            found, measured = read_calibration(self.options.calibration)
        self._found = found
        fold, folds = self.options.fold or (0, 0)
        marks, report = self.options.marks, self.options.report
        return {
            "licence": "Apache-2.0",
            "source": "trained by this project; data and first weights are named below",
            "pictures": dict(sorted(Counter(s.source for s in self.kept).items())),
            "places": len({s.place for s in self.kept}),
            "held_out": f"{fold + 1}/{folds}" if folds else None,
            "kept_for_report": f"{report}/{folds}" if report is not None else None,
            "held_out_places": sorted({s.place for s in self.held}),
            "marks": None if marks is None else digest(marks),
            "initialised_from": {"semantic": digest(self.teachers.semantic)},
            "labelled_by": {
                "depth": digest(self.teachers.depth),
                "segments": digest(self.teachers.semantic),
                "unmarked": self.labelled_by,
            },
            "calibration": asdict(found),
            "depth_error": measured.get("depth_error", _DEPTH_ERROR),
            "thresholds": measured.get("thresholds", {}),
            "presets": measured.get("presets", {}),
            "costs": asdict(self.recipe.costs),
            "recipe": self.recipe.text,
        }

    def export(self, path: Path, card: Mapping[str, Any]) -> float:
        shown = {key: card[key] for key in _SHOWN}
        # the file for a half of the held-out places has seen nothing of it: calibrated on the other
        for half, found in self._for_half.items():
            other = path.with_name(f"half-{half}.onnx")
            export_onnx(self.net.whole, other, calibration=found, metadata=shown)
        return export_onnx(self.net.whole, path, calibration=self._found, metadata=shown)

    def page(self, card: Mapping[str, Any]) -> Report:
        report = outcome.training_report(card, self.history)
        answers = predict(self.run.out / f"{self.name}.onnx", self.unseen)
        add_answers(report, answers, self.about)
        return report


def halves_of(held: Sequence[Sample]) -> dict[tuple[str, str], int]:
    """Half 1 or 2 of each source's places, by source and place."""
    found: dict[tuple[str, str], int] = {}
    for source in sorted({sample.source for sample in held}):
        places = sorted({sample.place for sample in held if sample.source == source})
        found |= {(source, place): 1 + number % 2 for number, place in enumerate(places)}
    return found


def write_held(path: Path, held: Sequence[Sample], halves: Mapping[tuple[str, str], int]) -> None:
    """Which images training has not seen, for `3ds eval overview`."""
    columns = ("source", "image", "place", "half")
    values = ((s.source, s.name, s.place, halves[s.source, s.place]) for s in held)
    rows = (dict(zip(columns, own, strict=True)) for own in values)
    write_bytes(path, csv_bytes(columns, rows))


def load_weights(net: DoorNet, path: Path) -> None:
    """Weights of an earlier run; UserError where the file is none of this network's."""
    try:
        net.whole.load_weights(path)
    except Exception as error:
        # Keras raises whatever h5py or its own shape checks raise
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(f"{path} holds no weights of this network: {reason}") from error


def blend(net: DoorNet, first: Path, share: float) -> None:
    """Moves the network's weights towards those in `first`: by 0 not at all, by 1 all the way.

    What a training learned and what it began with err in different places, and their mean keeps
    most of both (Wortsman et al., "Robust fine-tuning of zero-shot models", CVPR 2022).
    """
    learned = [weight.value.detach().clone() for weight in net.whole.weights]
    load_weights(net, first)
    for weight, value in zip(net.whole.weights, learned, strict=True):
        weight.assign(value.lerp(weight.value.detach(), share))


def read_calibration(path: Path) -> tuple[Calibration, dict[str, Any]]:
    """Calibration, depth error and limits from a card; UserError where the file is none."""
    try:
        card = json.loads(read_text(path))
        measured = {key: card[key] for key in ("depth_error", "thresholds")}
        measured["presets"] = card.get("presets", {})
        return Calibration(**card["calibration"]), measured
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(f"{path} is not a card of a training with held-out places") from error
