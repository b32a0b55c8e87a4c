"""Decisions in Rerun, live in its viewer or as an .rrd file (extra `rerun`)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import back_project, rotation
from doorway3ds.draw.space import candidates, chosen, corridor
from doorway3ds.draw.words import headline, sentence
from doorway3ds.errors import CallError, UserError
from doorway3ds.types import Decision, Frame, Reason

_AZURE, _GREEN, _VERMILLION, _WHITE = (86, 180, 233), (0, 158, 115), (213, 94, 0), (242, 242, 242)
_CAMERA = "robot/camera"
_LONG_AGO_S = 1e9  # stamps beyond this count from 1970
_POINTS = 20_000  # at most, of a frame's depth


class Viewer:
    """A recording: image with openings, depth, points and corridor in the robot's frame, plots.

    file: an .rrd that appears whole when it is closed; None: Rerun's viewer is opened.
    """

    def __init__(self, file: Path | None = None) -> None:
        import rerun

        self._rr: Any = rerun
        self._record: Any = rerun.RecordingStream("doorway3ds")
        self._file = file
        self._partial = None if file is None else file.with_name(f".{file.name}.part")
        if file is None:
            try:
                self._record.spawn(default_blueprint=_blueprint())
            except RuntimeError as error:
                raise UserError(f"Rerun's viewer cannot be opened: {error}") from error
        else:
            if file.suffix != ".rrd":
                raise CallError(f"--rerun writes .rrd files, got {file}")
            try:
                file.parent.mkdir(parents=True, exist_ok=True)
                self._record.save(self._partial, default_blueprint=_blueprint())
            except (OSError, RuntimeError) as error:
                raise UserError(f"cannot write {file}: {error}") from error
        self._record.log("robot", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._number = 0
        self._open = True
        self._said = ""

    def add(self, decision: Decision, *, belief: float | None = None) -> None:
        """One frame. decision: with memory if there is one, and `belief` then what it believes."""
        rr, record, frame = self._rr, self._record, decision.frame
        record.set_time("frame", sequence=self._number)
        stamp_s = frame.stamp_s
        if stamp_s > _LONG_AGO_S:
            record.set_time("time", timestamp=stamp_s)
        else:
            record.set_time("time", duration=stamp_s)
        self._number += 1
        self._see(frame)
        self._paint(decision)
        depth = decision.perception.depth_m
        if depth is not None:
            record.log("depth", rr.DepthImage(depth, meter=1.0))
            record.log("robot/points", self._points(frame, depth))
        self._place(decision)
        chance = decision.p_open if belief is None else belief
        record.log("plots/belief", rr.Scalars([chance]))
        bearing = decision.bearing_deg
        record.log("plots/bearing", rr.Scalars([math.nan if bearing is None else bearing]))
        record.log("plots/latency", rr.Scalars([sum(decision.timings_ms.values())]))
        words = f"{headline(decision)}. {sentence(decision)}".replace("\u00a0", " ")
        if words != self._said:
            level = "INFO" if decision.reason in (Reason.TURN, Reason.ALIGNED) else "WARN"
            record.log("reason", rr.TextLog(words, level=level))
        self._said = words

    def close(self) -> None:
        """Ends the recording and gives the file its name; may be called twice."""
        if not self._open:
            return
        self._open = False
        self._record.flush()
        self._record.disconnect()
        if self._file is not None and self._partial is not None:
            try:
                self._partial.replace(self._file)
            except OSError as error:
                raise UserError(f"cannot write {self._file}: {error.strerror}") from error

    def _see(self, frame: Frame) -> None:
        """The image, where its camera sits."""
        rr, camera, pose = self._rr, frame.camera, frame.pose
        lens = (pose.forward_m, pose.left_m, pose.height_m or 0.0)
        self._record.log(_CAMERA, rr.Transform3D(translation=lens, mat3x3=rotation(pose)))
        lens_model = rr.Pinhole(
            focal_length=(camera.fx, camera.fy),
            principal_point=(camera.cx + 0.5, camera.cy + 0.5),
            resolution=(camera.width, camera.height),
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=0.3,
        )
        self._record.log(f"{_CAMERA}/image", lens_model)
        image = rr.Image(frame.image).compress(jpeg_quality=85)
        self._record.log(f"{_CAMERA}/image", image)

    def _paint(self, decision: Decision) -> None:
        """Openings on the image: the best one strong."""
        height = decision.frame.camera.height
        low, high = 0.93 * height, 0.07 * height
        strips, colors, labels = [], [], []
        for number, one in enumerate(decision.selection.openings):
            left, right = one.left_px, one.right_px
            strips.append([(left, low), (left, high), (right, high), (right, low)])
            colors.append(_AZURE if number == 0 and decision.open else _WHITE)
            labels.append(f"{one.bearing_deg:+.1f}° ({one.score:.2f})")
        lines = self._rr.LineStrips2D(strips, colors=colors, labels=labels, radii=-1.5)
        self._record.log(f"{_CAMERA}/image/openings", lines)

    def _points(self, frame: Frame, depth: NDArray[np.float32]) -> Any:
        """The depth as points in the robot's frame, in the image's colours."""
        step = max(1, math.ceil(math.sqrt(depth.size / _POINTS)))
        points = back_project(frame.camera, frame.pose, depth)[::step, ::step].reshape(-1, 3)
        small = cv2.resize(frame.image, depth.shape[::-1], interpolation=cv2.INTER_AREA)
        colors = small[::step, ::step].reshape(-1, 3)
        known = np.isfinite(points).all(axis=1)
        return self._rr.Points3D(points[known], colors=colors[known], radii=0.012)

    def _place(self, decision: Decision) -> None:
        """Doorway, candidates and corridor on the floor."""
        rr, record = self._rr, self._record
        door, way = chosen(decision), corridor(decision)
        frames = [one.frame for one in candidates(decision)]
        colors = [_WHITE] * len(frames)
        if door is not None:
            frames, colors = [door.frame, *frames], [_AZURE, *colors]
        record.log("robot/doorways", rr.LineStrips3D(frames, colors=colors, radii=0.02))
        outline = []
        if way is not None:
            outline = [[(*corner, 0.0) for corner in (*way, way[0])]]
        clear = decision.selection.clear
        color = {True: _GREEN, False: _VERMILLION, None: _WHITE}[clear]
        record.log("robot/corridor", rr.LineStrips3D(outline, colors=[color], radii=0.02))


def _blueprint() -> Any:
    """Image and depth beside the room, series and words below."""
    import rerun.blueprint as layout

    return layout.Blueprint(
        layout.Vertical(
            layout.Horizontal(
                layout.Spatial2DView(origin=f"{_CAMERA}/image", name="Image"),
                layout.Spatial2DView(origin="depth", name="Depth"),
                layout.Spatial3DView(origin="robot", name="Robot's frame"),
            ),
            layout.Horizontal(
                layout.TimeSeriesView(
                    origin="plots/belief", name="Belief", axis_y=layout.ScalarAxis(range=(0.0, 1.0))
                ),
                layout.TimeSeriesView(origin="plots/bearing", name="Bearing, degrees, + left"),
                layout.TimeSeriesView(origin="plots/latency", name="Latency, ms"),
                layout.TextLogView(origin="reason", name="Reason"),
            ),
            row_shares=[3, 2],
        ),
        collapse_panels=True,
    )
