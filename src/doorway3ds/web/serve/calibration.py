"""A guided calibration of the server's own source."""

from __future__ import annotations

import asyncio
import logging
from typing import Any, Literal

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from doorway3ds.camera.board import Board, charuco_of
from doorway3ds.camera.calibration import MIN_PICTURES, Calibration, calibrate_views
from doorway3ds.camera.guide import COLUMNS, FEWEST, ROWS, SPREAD, TILTS, Guide, incomplete
from doorway3ds.camera.info import check_lens
from doorway3ds.camera.options import BoardOptions
from doorway3ds.errors import UserError
from doorway3ds.types import Reason
from doorway3ds.web.base.errors import ApiError
from doorway3ds.web.serve.fields import Number, of_option
from doorway3ds.web.serve.live import Live, Snapshot

State = Literal["none", "taking", "computing", "done", "failed"]
_LENS = ("width", "height", "fx", "fy", "cx", "cy", "hfov_deg", "vfov_deg")
_BEAT_S = 0.5  # after which a wish to finish is heard, if no frame comes

log = logging.getLogger(__name__)


class BoardFields(BaseModel):
    """The board; each field has the meaning of the option of `3ds calibrate`."""

    model_config = ConfigDict(extra="forbid")

    board: str = of_option(
        BoardOptions, "board", "9x6", BoardOptions.board, pattern=r"^[0-9]{1,2}x[0-9]{1,2}$"
    )
    square_mm: Number = of_option(BoardOptions, "square_mm", 25.0, BoardOptions.square_mm)
    charuco: bool = Field(default=False, description="A ChArUco board.")
    marker_mm: Number | None = of_option(BoardOptions, "marker_mm", 18.0)
    dictionary: str = of_option(
        BoardOptions, "dictionary", "DICT_4X4_50", BoardOptions.dictionary, max_length=40
    )

    @model_validator(mode="after")
    def _marker_of_a_charuco_board(self) -> BoardFields:
        if self.marker_mm is not None and not self.charuco:
            raise ValueError("marker_mm belongs to a ChArUco board; add charuco")
        return self

    @property
    def options(self) -> BoardOptions:
        return BoardOptions(
            self.board, self.square_mm, self.charuco, self.marker_mm, self.dictionary
        )

    def pattern(self) -> Board:
        """The board; ApiError 422 if there is none like that."""
        try:
            board = self.options.pattern()
            if self.charuco:
                charuco_of(board)
        except UserError as error:
            raise ApiError(422, "invalid_field", str(error)) from error
        return board


class CalibrationFields(BoardFields):
    """Body of POST /v1/calibration, as JSON."""

    model_config = ConfigDict(extra="forbid", strict=True)

    name: str = Field(
        default="camera",
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$",
        description="Name of the camera, and of its file.",
    )


class _Dropped(Exception):
    """The calibration was cancelled."""


class CalibrationRun:
    """Takes frames of a source until they suffice or `finish`, then computes the camera.

    Make it in the event loop that waits for the source's frames. The source goes on deciding.

    Raises ApiError if there is no such board.
    """

    def __init__(self, live: Live, fields: CalibrationFields) -> None:
        self.fields = fields
        self.state: State = "taking"
        self.problem: str | None = None
        self.found: Calibration | None = None
        self._live = live
        self._guide = Guide(fields.pattern())
        self._frame: int | None = None
        self._enough = self._dropped = False
        self._task = asyncio.create_task(self._run())

    @property
    def running(self) -> bool:
        return self.state in ("taking", "computing")

    def finish(self) -> None:
        """Computes with the frames there are; ApiError 409 if they are too few."""
        if len(self._guide.views) < MIN_PICTURES:
            raise ApiError(
                409,
                "too_few_frames",
                f"{len(self._guide.views)} frames with the board were taken, at least "
                f"{MIN_PICTURES} are needed",
            )
        self._enough = True

    def cancel(self) -> None:
        """Ends it: its thread ends after the fit it is at, and its result is dropped."""
        # Cancelling alone is not heard by a wait that ends at the same moment.
        self._dropped = True
        self._task.cancel()

    def to_dict(self) -> dict[str, Any]:
        guide = self._guide
        return {
            "state": self.state,
            "problem": self.problem or (self._live.problem if self.state == "taking" else None),
            "fields": self.fields.model_dump(exclude_none=True),
            "frame": self._frame,
            "size": list(guide.size) if guide.size else None,
            "seen": _outline(guide),
            "verdict": guide.verdict,
            "next": guide.missing or None,
            "frames": {"taken": len(guide.views), "fewest": MIN_PICTURES, "wanted": FEWEST},
            "zones": {"columns": COLUMNS, "rows": ROWS, "covered": sorted(guide.zones)},
            "tilts": {side: side in guide.tilts for side in TILTS},
            "distances": {"spread": round(guide.spread, 2), "wanted": SPREAD},
            "result": _result(self.found, guide.missing) if self.found else None,
        }

    async def _run(self) -> None:
        try:
            await self._take()
            if self._dropped:
                return
            self.state = "computing"
            self.found = await asyncio.to_thread(self._compute)
            self.state = "done"
        except _Dropped:
            pass
        except UserError as error:
            self.state, self.problem = "failed", str(error)
        except Exception:
            log.exception("the calibration failed")
            self.state, self.problem = "failed", "the server failed; see its log"

    async def _take(self) -> None:
        live, seen = self._live, self._live.frames
        while not (self._guide.done or self._enough or self._dropped):
            await live.change((seen, live.state), _BEAT_S)
            newest = live.newest
            if newest is not None and newest.number != seen:
                seen = newest.number
                await asyncio.to_thread(self._look, newest)

    def _look(self, newest: Snapshot) -> None:
        if newest.decision.reason is Reason.LOST:  # no frame of its own
            return
        if self._live.source is not None:
            self._live.source.require_sensor()
        frame = newest.decision.frame
        self._guide.look(f"frame {newest.number}", frame.image, frame.stamp_s)
        self._frame = newest.number

    def _compute(self) -> Calibration:
        guide, name = self._guide, self.fields.name
        assert guide.size is not None  # as there are frames
        found = calibrate_views(guide.views, guide.size, name, go_on=self._go_on)
        self._go_on()
        check_lens(found.camera, name)
        return found

    def _go_on(self) -> None:
        if self._dropped:
            raise _Dropped


def _outline(guide: Guide) -> list[list[float]] | None:
    """The board's outline in the last frame, pixels."""
    if guide.seen is None:
        return None
    hull = np.asarray(cv2.convexHull(guide.seen), float).reshape(-1, 2)
    return [[round(float(v), 1) for v in point] for point in hull]


def _result(found: Calibration, missing: str) -> dict[str, Any]:
    camera = found.camera
    return {
        "rms_px": found.rms_px,
        "frames": len(found.errors_px),
        "coverage": found.coverage,
        "doubts": [*([incomplete(missing)] if missing else []), *found.doubts],
        "held_out_px": found.held_out_px,
        "name": camera.name,
        "model": camera.distortion_model,
        **{name: getattr(camera, name) for name in _LENS},
    }
