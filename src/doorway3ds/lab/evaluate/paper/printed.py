"""What the paper prints of its experiments, as data; nothing here is measured by doorway3ds.

Othman & Rad, Sensors 2020, 20(9), 2477. Pixels are (row, column) on the 240x320 depth map,
depths in units of 10 m, angles in degrees, + left.
"""

from __future__ import annotations

from dataclasses import dataclass

from doorway3ds.lab.evaluate.metrics import Confusion

SOURCE = "Othman & Rad, Sensors 2020, 20(9), 2477"
FOV_DEG = 60.9  # of the NAO's top camera, across
TEXT_STEP_DEG = 0.19  # what the text calls the degrees of one column

PICTURES = 12
TABLE_2 = Confusion(tp=5, fp=1, tn=5, fn=1)

VALIDATION_ACCURACY = {10: 0.9579, 20: 0.9796, 30: 0.9751}  # by epochs
ADOPTED_EPOCHS = 20


@dataclass(frozen=True)
class Row:
    """One image of Table 3 or 4; None is what the table leaves empty."""

    table: int
    number: int
    called_open: bool = True
    best_pixel: tuple[int, int] | None = None
    best_depth: float | None = None
    free: bool | None = None
    angle_deg: float | None = None
    max_pixel: tuple[int, int] | None = None
    max_depth: float | None = None
    trigger_row: int | None = None

    @property
    def digits(self) -> int:
        """Of its angle behind the point."""
        return 1 if self.table == 3 else 2

    def __str__(self) -> str:
        return f"Table {self.table}, row {self.number}"


ROWS = (
    Row(3, 1, True, (185, 255), 0.23, True, -18.1, (185, 194), 0.24, 238),
    Row(3, 2, True, (145, 201), 0.40, False, None, (145, 157), 0.46, 185),
    Row(3, 3, True, (120, 135), 0.50, True, 4.8, (120, 130), 0.50, 238),
    Row(3, 4, True, (183, 42), 0.32, True, 22.5, (183, 73), 0.37, 238),
    Row(3, 5, True, (166, 39), 0.52, True, 23.0, (166, 41), 0.52, 238),
    Row(3, 6, called_open=False),
    Row(3, 7, True, (188, 19), 0.23, True, 26.8, (188, 0), 0.27, 238),
    Row(4, 1, True, (143, 246), 0.54, True, -16.37),
    Row(4, 2, True, (152, 283), 0.78, True, -23.41),
    Row(4, 3, True, (182, 36), 0.58, True, 23.60),
    Row(4, 4, True, (177, 291), 0.64, True, -24.93),
    Row(4, 5, called_open=False),
    Row(4, 6, called_open=False),
    Row(4, 7, True, (131, 237), 0.41, False),
)

NOT_RERUN = (
    "The images and depth maps behind Tables 3 and 4 are the authors': their Max-, Best- and "
    "Trigger-Pixels and depths are taken as printed, and only what follows from them (path, angle) "
    "is recomputed.",
    "So are the 12 NAO images of Tables 1 and 2. Twelve of your own (--pictures) are another "
    "experiment, set beside theirs.",
    "The 14,494 SRIN images as the authors chose and split them do not come with this package. "
    "Training is repeated on the data set that you point to (--dataset), split by places.",
    "The NAO's turns in Table 4 need that robot in that room.",
)
