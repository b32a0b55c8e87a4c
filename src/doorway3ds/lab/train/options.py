"""What a user may say of a training and of the images that it learns from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from doorway3ds.errors import CallError
from doorway3ds.options import MANY, SEED, THREADS, Options
from doorway3ds.options import setting as option

if TYPE_CHECKING:
    from doorway3ds.lab.datasets.places import Choice

PRECISIONS = ("auto", "float32", "bfloat16")


@dataclass(frozen=True)
class GroupOptions(Options):
    """Which images are never split between training and held out."""

    panel: ClassVar[str] = "Images"

    group: str = option(
        "auto",
        "Groups that stay whole: auto (places named by the data, else near-duplicates), near or "
        "folder.",
        choices=("auto", "near", "folder"),
    )
    group_pattern: str | None = option(
        None, "Pattern whose first group in the file's name is the place.", metavar="REGEX"
    )

    def choice(self, seed: int) -> Choice:
        """The same as the readers take it."""
        from doorway3ds.lab.datasets.places import Choice

        half_open = getattr(self, "half_open", "leave-out")
        limit = getattr(self, "limit", None)
        return Choice(self.group, self.group_pattern, half_open, limit, seed)


@dataclass(frozen=True)
class PairOptions(GroupOptions):
    """The same of images with depth."""

    limit: int | None = option(None, "Largest number of images.", low=2, high=MANY)


@dataclass(frozen=True)
class SiteOptions(GroupOptions):
    """The same of images with and without an open doorway."""

    places: Path | None = option(None, "CSV with columns image, place.", metavar="FILE")
    half_open: str = option(
        "leave-out",
        "Class of half-open doors: leave-out, open or not-open.",
        choices=("leave-out", "open", "not-open"),
    )

    def read_places(self) -> dict[str, str] | None:
        """The place of each image by name; None unless a file says it."""
        from doorway3ds.lab.datasets.readers import read_places

        return None if self.places is None else read_places(self.places)


@dataclass(frozen=True)
class ClassOptions(SiteOptions):
    """The same of a data set in classes."""

    layout: str | None = option(
        None, "Layout, as in `3ds eval`; default: recognised from the files."
    )
    limit: int | None = option(None, "Largest number of images per class.", low=1, high=MANY)


@dataclass(frozen=True)
class StartOptions(Options):
    """What a training begins with."""

    panel: ClassVar[str] = "Training"

    weights: str = option(
        "imagenet",
        "Initial weights: imagenet (Keras' download), none (random), or an HDF5 file of Keras 1 "
        "or 2.",
        metavar="WEIGHTS",
    )
    validation: float = option(0.2, "Share held out.", low=0.01, high=0.9)
    seed: int = option(0, "Seed of everything drawn at random.", **SEED)

    @property
    def first_weights(self) -> str | Path:
        """`weights` with a file as a path."""
        return self.weights if self.weights in ("imagenet", "none") else Path(self.weights)


@dataclass(frozen=True)
class TrainOptions(StartOptions):
    """How a network is trained."""

    epochs: int = option(20, "Passes over the training images.", low=1, high=MANY)
    learning_rate: float = option(1e-3, "Learning rate of Adam.", low=1e-12, high=10)
    batch: int = option(32, "Images per step.", low=1, high=MANY)
    patience: int = option(
        0,
        "Stop after N epochs without gain and keep the best; 0: never.",
        low=0,
        high=MANY,
    )
    precision: str = option(
        "auto", "Arithmetic: auto (bfloat16 on a GPU), float32 or bfloat16.", choices=PRECISIONS
    )


@dataclass(frozen=True)
class SrinOptions(TrainOptions):
    """How CNN-SRIN is trained."""

    copies: int = option(0, "Augmented copies of each training image.", low=0, high=MANY)
    fine_tune: int = option(
        0, "Epochs that then train VGG16's top block, too.", low=0, high=MANY, metavar="EPOCHS"
    )


@dataclass(frozen=True)
class DepthOptions(TrainOptions):
    """How DenseDepth is trained."""

    learning_rate: float = option(1e-4, "Learning rate of Adam.", low=1e-12, high=10)
    batch: int = option(4, "Images per step.", low=1, high=MANY)
    validation: float = option(0.1, "Share held out.", low=0.01, high=0.9)
    setting: str = option(
        "nyu",
        "Size and range: nyu, 480x640 and 0.1 to 10 m; kitti, 384x1280 and 1 to 80 m.",
        choices=("nyu", "kitti"),
    )
    freeze_encoder: bool = option(
        False, "Keep the encoder fixed, as in the paper's text; its code trains it."
    )
    augment: bool = option(
        True, "Mirror images and swap colour channels at random.", names=("--augment/--no-augment",)
    )
    half_decoder: bool = option(
        False, "Halve the number of filters: the default of the paper's code."
    )


@dataclass(frozen=True)
class DoornetOptions(Options):
    """What doornet learns from, and what is kept from its training.

    unmarked: what the networks of `labeller` see in them; none may have learned from the places
    held out.
    """

    panel: ClassVar[str] = "Training"

    recipe: Path | None = option(None, "Recipe, a YAML file; default: the packaged one.")
    hold_out: str | None = option(
        None, "Keep fold K of N of the places for calibration.", metavar="K/N"
    )
    report: int | None = option(
        None,
        "Keep fold K out of both training and calibration.",
        metavar="K",
        low=1,
        high=MANY,
    )
    marks: Path | None = option(
        None, "CSV with exact openings for images that lack them.", metavar="FILE"
    )
    calibration: Path | None = option(
        None,
        "Take the calibration of a held-out run's doornet.json, to train on everything.",
        metavar="CARD",
    )
    init: Path | None = option(None, "Weights of an earlier run to start from.", metavar="FILE")
    unmarked: list[Path] | None = option(
        None, "Learn from unmarked photographs, too; repeatable.", metavar="FOLDER"
    )
    labeller: list[str] | None = option(
        None,
        "Network that labels the unmarked photographs; repeatable, for the mean of several; "
        "default: the packaged one.",
        metavar="NETWORK",
    )
    seed: int | None = option(None, "Seed, instead of the recipe's.", **SEED)
    patience: int | None = option(
        None,
        "End a stage after N epochs without gain on held-out places and keep the best; "
        "0: never; default: the recipe's.",
        low=0,
        high=MANY,
    )
    precision: str = option(
        "auto", "Arithmetic: auto (bfloat16 on a GPU), float32 or bfloat16.", choices=PRECISIONS
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.report is not None and (
            self.fold is None or self.report - 1 not in {*range(self.fold[1])} - {self.fold[0]}
        ):
            raise CallError("--report must be another fold than K of --hold-out K/N, from 1 to N")

    @property
    def fold(self) -> tuple[int, int] | None:
        """Number, from 0, of the fold held out, and how many there are."""
        from doorway3ds.lab.datasets.samples import parse_split

        return parse_split(self.hold_out) if self.hold_out else None


@dataclass(frozen=True)
class TuneOptions(Options):
    """How a network is fine-tuned for a site."""

    panel: ClassVar[str] = "Training"
    patience: ClassVar[int] = 3  # epochs without gain after which a stage ends

    epochs: int = option(
        12, "Largest number of epochs of each of the two stages.", low=1, high=MANY
    )
    learning_rate: float = option(
        3e-4, "Learning rate of the heads; the decoder's is a third.", low=1e-12, high=10
    )
    batch: int = option(8, "Images per step.", low=1, high=MANY)
    seed: int = option(0, "Seed of everything drawn at random.", **SEED)


@dataclass(frozen=True)
class RunOptions(Options):
    """How a training is run."""

    panel: ClassVar[str] = "Run"

    resume: bool = option(False, "Continue from the checkpoint in --out.")
    tensorboard: bool = option(False, "Write OUT/tensorboard in addition to the CSV logs.")
    threads: int | None = option(None, "CPU threads; default: all.", **THREADS)


@dataclass(frozen=True)
class FileOptions(RunOptions):
    """The same of a network that `--network` finds by its name."""

    licence: str | None = option(None, "Licence of the images, noted on the card.")
    install: bool = option(
        True, "Let `--network` find the file by name.", names=("--install/--no-install",)
    )
