"""What a user may say of a camera, and of the board that it is calibrated by."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from doorway3ds.errors import CallError, UserError
from doorway3ds.options import Options, setting

if TYPE_CHECKING:
    from doorway3ds.camera.board import Board


@dataclass(frozen=True)
class LensOptions(Options):
    """Which camera took the images."""

    panel: ClassVar[str] = "Camera"

    camera: str | None = setting(
        None,
        "nao-v5-top, nao-v6-top, pepper-top, or a ROS camera_info YAML file.",
        metavar="PRESET|FILE",
    )
    fov_deg: float | None = setting(
        None, "Horizontal field of view, instead of a camera.", low=1, high=179
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.camera is not None and self.fov_deg is not None:
            raise CallError("--camera and --fov-deg both set the field of view; give one of them")


@dataclass(frozen=True)
class CameraOptions(LensOptions):
    """Which camera took the images, and where it sits on the robot."""

    height_m: float | None = setting(None, "Height of the lens above the floor.", low=0.01, high=10)
    pitch_deg: float | None = setting(None, "Pitch of the camera, + up.", low=-90, high=90)
    roll_deg: float | None = setting(
        None, "Roll of the camera, + right side down.", low=-180, high=180
    )


@dataclass(frozen=True)
class BoardOptions(Options):
    """The board that is printed or seen."""

    panel: ClassVar[str] = "Board"

    board: str = setting(
        "9x6",
        "Columns x rows: inner corners of a chessboard, squares of a ChArUco board.",
    )
    square_mm: float = setting(25.0, "Side of a square.", low=0.1, high=10_000)
    charuco: bool = setting(False, "Look for a ChArUco board.")
    marker_mm: float | None = setting(
        None, "Side of a ChArUco marker; default: 0.75 of the square.", low=0.1, high=10_000
    )
    dictionary: str = setting("DICT_4X4_50", "OpenCV's name of the ChArUco markers' dictionary.")

    def pattern(self) -> Board:
        """The board; CallError if there is none like that."""
        from doorway3ds.camera.board import Board

        size = re.fullmatch(r"(\d+)x(\d+)", self.board)
        if size is None:
            raise CallError(f"--board must be columns x rows, as in 9x6, got '{self.board}'")
        if not self.charuco and self.marker_mm is not None:
            raise CallError("--marker-mm belongs to a ChArUco board; add --charuco")
        marker_mm = 0.75 * self.square_mm if self.marker_mm is None else self.marker_mm
        try:
            return Board(
                int(size[1]),
                int(size[2]),
                self.square_mm / 1e3,
                marker_mm / 1e3 if self.charuco else None,
                self.dictionary,
            )
        except UserError as error:
            raise CallError(str(error)) from error

    def given(self) -> str:
        """The options that a call needs for this board, as typed."""
        words = f"--board {self.board} --square-mm {self.square_mm:g}"
        if self.charuco:
            words += " --charuco"
            words += "" if self.marker_mm is None else f" --marker-mm {self.marker_mm:g}"
            if self.dictionary != BoardOptions.dictionary:
                words += f" --dictionary {self.dictionary}"
        return words
