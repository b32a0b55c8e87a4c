"""The paper's experiments as far as data allow, beside what it prints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from doorway3ds.camera.choice import FitCamera
from doorway3ds.camera.model import pixel_to_ray, rotation
from doorway3ds.camera.presets import preset
from doorway3ds.decide.paper import COLUMNS, FREE_BELOW_ROW, ROWS, UNIT_M, pixel_to_angle
from doorway3ds.errors import UserError
from doorway3ds.images.folder import images_in
from doorway3ds.lab.datasets.places import Seen, unseen
from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.lab.datasets.samples import Sample, load_frame
from doorway3ds.lab.evaluate.classifier import ClassifierMetrics
from doorway3ds.lab.evaluate.intervals import plain, wilson
from doorway3ds.lab.evaluate.metrics import Confusion, confusion
from doorway3ds.lab.evaluate.paper import printed
from doorway3ds.lab.evaluate.report.html import Table, cell
from doorway3ds.types import Decision, Frame

STAND_DEG = 9.7  # by which NAO's posture Stand raises its head
_MARKS = ("doorways.csv", "boxes.csv")
_HALF_A_DIGIT = 0.005  # of a printed depth


@dataclass(frozen=True)
class Recomputed:
    """A printed row and what follows from its pixels.

    free: from the Trigger-Pixel's row, as printed where the table has none. angle_deg: unrounded,
    None where the gates hold it back. text_deg: by the text's 0.19 degrees a column.
    """

    row: printed.Row
    free: bool | None
    angle_deg: float | None
    text_deg: float | None

    @property
    def difference_deg(self) -> float | None:
        """Recomputed minus printed; None where either has no angle."""
        if self.angle_deg is None or self.row.angle_deg is None:
            return None
        return self.angle_deg - self.row.angle_deg

    @property
    def agrees(self) -> bool:
        """Whether path and angle are those printed, to the printed digit."""
        return self.free == self.row.free and self._rounds_to(self.angle_deg)

    @property
    def text_agrees(self) -> bool:
        return self._rounds_to(self.text_deg)

    def _rounds_to(self, angle_deg: float | None) -> bool:
        if angle_deg is None or self.row.angle_deg is None:
            return angle_deg is self.row.angle_deg
        # a half may go either way: the paper does not say how it rounds
        half = 0.5 * 10.0**-self.row.digits
        return abs(angle_deg - self.row.angle_deg) <= half + 1e-9

    def to_dict(self) -> dict[str, Any]:
        row = self.row
        return {
            "table": row.table,
            "row": row.number,
            "called_open": row.called_open,
            "best_pixel": None if row.best_pixel is None else list(row.best_pixel),
            "trigger_row": row.trigger_row,
            "printed": {"free": row.free, "angle_deg": row.angle_deg},
            "recomputed": {"free": self.free, "angle_deg": self.angle_deg},
            "difference_deg": self.difference_deg,
            "agrees": self.agrees,
            "by_the_text_deg": self.text_deg,
            "text_agrees": self.text_agrees,
        }


def recompute(row: printed.Row) -> Recomputed:
    """Path and angle of a printed row, by the published rules."""
    free = row.free if row.trigger_row is None else row.trigger_row > FREE_BELOW_ROW
    angle = text = None
    if row.called_open and free and row.best_pixel is not None:
        column = row.best_pixel[1]
        angle = pixel_to_angle(column, COLUMNS, printed.FOV_DEG)
        text = (COLUMNS / 2 - column) * printed.TEXT_STEP_DEG
    return Recomputed(row, free, angle, text)


def angle_table(rows: Sequence[Recomputed]) -> Table:
    """Tables 3 and 4, printed and recomputed side by side."""
    columns = ["Best-Pixel", "path", "printed", "recomputed", "difference", "by 0.19° a pixel"]
    cells = []
    for found in rows:
        row = found.row
        if not row.called_open:
            cells.append((str(row), "no door: other modules held back", ["–"] * len(columns)))
            continue
        text = _degrees(found.text_deg)
        cells.append(
            (
                str(row),
                "" if found.agrees else "contradicts the formula",
                [
                    "–" if row.best_pixel is None else f"{row.best_pixel[0]}, {row.best_pixel[1]}",
                    {True: "free", False: "not free", None: "–"}[found.free],
                    _degrees(row.angle_deg, row.digits),
                    _degrees(found.angle_deg),
                    _degrees(found.difference_deg),
                    text if found.text_agrees else f"{text} (not as printed)",
                ],
            )
        )
    return Table("Tables 3 and 4: from pixel to angle", columns, cells)


def verdict(rows: Sequence[Recomputed]) -> str:
    """Which rows contradict which formula, in words."""
    wrong = [str(r.row) for r in rows if not r.agrees]
    text = [str(r.row) for r in rows if not r.text_agrees]
    said = "; ".join(wrong) if wrong else "none"
    return (
        f"Rows that contradict (160 - column) x 60.9 / 320, unrounded: {said}. "
        f"Rows that contradict the text's 0.19 degrees a pixel: {'; '.join(text) or 'none'}."
    )


def behind_floor(row: printed.Row, raised_deg: float) -> bool:
    """Whether a printed depth is larger than that of the floor under its pixel.

    For the NAO's top camera 0.52 m up, on a level head or one raised by so many degrees.
    """
    camera, pose = preset("nao-v5-top", COLUMNS, ROWS)
    turn = rotation(replace(pose, pitch_deg=pose.pitch_deg + raised_deg))
    for pixel, depth in ((row.max_pixel, row.max_depth), (row.best_pixel, row.best_depth)):
        if pixel is None or depth is None:
            continue
        sinks = -(turn @ pixel_to_ray(camera, (pixel[1], pixel[0])))[2]  # per metre of depth
        if sinks * UNIT_M * (depth - _HALF_A_DIGIT) > (pose.height_m or 0):
            return True
    return False


def floor_verdict(rows: Sequence[printed.Row]) -> str:
    """How many printed depths contradict the floor, with the head level and as in "Stand"."""
    known = [row for row in rows if row.best_pixel is not None]
    level, stand = (
        [str(r) for r in known if behind_floor(r, raised)] for raised in (0.0, STAND_DEG)
    )
    return (
        f"Rows whose depth lies behind the floor, seen by a NAO with its head level: {len(level)} "
        f"of {len(known)} ({'; '.join(level) or 'none'}). With its head raised by {STAND_DEG} "
        f"degrees, as in its posture Stand: {'; '.join(stand) or 'none'}."
    )


@dataclass(frozen=True)
class Answer:
    """The paper's method on one image; is_open None: nobody said."""

    name: str
    is_open: bool | None
    decision: Decision


def read_pictures(path: Path, fit: FitCamera) -> tuple[Sample, ...]:
    """The 12 images of a folder: lying in it, or marked as `3ds eval` reads them.

    fit: the camera of those that bring none. Raises UserError for another number, and for marks
    that are neither open nor not.
    """
    if path.is_dir() and not any((path / name).is_file() for name in _MARKS):
        files = images_in(path)
    else:
        files = []
    if files:
        samples = [Sample(file.name, file.name, file, None) for file in files]
    else:
        samples = list(read_dataset(path).samples)
        half = [s.name for s in samples if s.is_open is None]
        if half:
            raise UserError(f"{path}: {half[0]} is half open; the paper's classes are open or not")
    if len(samples) != printed.PICTURES:
        raise UserError(
            f"expected {printed.PICTURES} images in {path}, as in the paper's Tables 1 and 2, "
            f"got {len(samples)}"
        )
    return tuple(replace(s, fit=fit) if s.camera is None else s for s in samples)


def answer_pictures(
    samples: Sequence[Sample],
    decide: Callable[[Frame], Decision],
    seen: Seen = unseen,
) -> list[Answer]:
    """The decision on each image. Raises UserError where one cannot be read."""
    answers = []
    for done, sample in enumerate(samples):
        seen(done, len(samples))
        answers.append(Answer(sample.name, sample.is_open, decide(load_frame(sample))))
    seen(len(samples), len(samples))
    return answers


def pictures_table(answers: Sequence[Answer]) -> Table:
    """Each image: truth, p_open, and what the other modules say where they are let run."""
    rows = []
    for answer in answers:
        decision, said = answer.decision, answer.decision.to_dict()
        called = "open" if decision.open else "no door"
        if answer.is_open is not None and answer.is_open != decision.open:
            called += " (wrong)"
        path = {True: "free", False: "not free", None: "–"}[said["clear"]]
        rows.append(
            (
                answer.name,
                "",
                [
                    {True: "open", False: "no door", None: "–"}[answer.is_open],
                    f"{decision.p_open:.3f}",
                    called,
                    _pixel(said["max_pixel"], said["max_depth"]),
                    _pixel(said["best_pixel"], said["best_depth"]),
                    _pixel(said["trigger_pixel"]),
                    path,
                    _degrees(decision.turn_deg),
                ],
            )
        )
    columns = ["truth", "p_open", "called", "Max-Pixel", "Best-Pixel", "Trigger", "path", "angle"]
    return Table("Twelve images, each with what the paper's modules say", columns, rows)


def count(answers: Sequence[Answer]) -> Confusion | None:
    """Counts of the answers; None where the truth is not known."""
    truth = [a.is_open for a in answers if a.is_open is not None]
    if not answers or len(truth) < len(answers):
        return None
    return confusion(truth, [a.decision.open for a in answers])


def confusion_table(here: Confusion | None) -> Table:
    """Table 2, its swapped columns put right, beside the images pointed to."""
    both = [printed.TABLE_2, *([] if here is None else [here])]
    rows = [
        (name, about, [str(getattr(c, key)) for c in both])
        for key, name, about in (
            ("tn", "TN", "no door, called no door"),
            ("fp", "FP", "no door, called open"),
            ("tp", "TP", "open, called open"),
            ("fn", "FN", "open, called no door"),
        )
    ]
    rows.append(
        (
            "accuracy",
            "with the 95 % interval of so few images (Wilson)",
            [cell(wilson(c.tp + c.tn, c.tp + c.fp + c.tn + c.fn), "share") for c in both],
        )
    )
    columns = ["paper, 12 NAO images", *([] if here is None else ["here"])]
    return Table("Table 2: the classifier on twelve images", columns, rows)


def epochs_table(scored: Mapping[int, ClassifierMetrics] | None) -> Table:
    """CNN-SRIN after 10, 20 and 30 epochs: what is printed, and what came out here."""
    rows = []
    for epochs, accuracy in printed.VALIDATION_ACCURACY.items():
        cells = [f"{100 * accuracy:.2f} %"]
        if scored is not None:
            value = scored[epochs].metrics["accuracy"]
            difference = 100 * (value.value - accuracy)
            auc = scored[epochs].metrics["auc"]
            cells += [cell(value, "share"), f"{difference:+.1f} points", cell(auc, "")]
        adopted = "adopted by the paper" if epochs == printed.ADOPTED_EPOCHS else ""
        rows.append((f"{epochs} epochs", adopted, cells))
    columns = ["paper, validation"]
    if scored is not None:
        columns += ["here, held out", "difference", "AUC here"]
    return Table("CNN-SRIN: accuracy by epochs", columns, rows)


def result(
    rows: Sequence[Recomputed],
    answers: Sequence[Answer],
    scored: Mapping[int, ClassifierMetrics] | None,
) -> dict[str, Any]:
    """Everything as one JSON object; null for what was not run."""
    here = count(answers)
    return {
        "paper": printed.SOURCE,
        "tables_3_and_4": [row.to_dict() for row in rows],
        "verdict": [verdict(rows), floor_verdict([row.row for row in rows])],
        "tables_1_and_2": [{"truth_open": a.is_open, **a.decision.to_dict(a.name)} for a in answers]
        or None,
        "table_2": {"printed": vars(printed.TABLE_2), "here": here and vars(here)},
        "epochs": [
            {
                "epochs": epochs,
                "printed_accuracy": accuracy,
                "here": None if scored is None else plain(scored[epochs]),
            }
            for epochs, accuracy in printed.VALIDATION_ACCURACY.items()
        ],
        "not_rerun": list(printed.NOT_RERUN),
    }


def _degrees(value: float | None, digits: int = 3) -> str:
    return "–" if value is None else f"{value:+.{digits}f}°"


def _pixel(pixel: Sequence[int] | None, depth: float | None = None) -> str:
    if pixel is None:
        return "–"
    return f"{pixel[0]}, {pixel[1]}" + ("" if depth is None else f" ({depth:.2f})")
