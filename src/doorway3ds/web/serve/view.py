"""A decision as the page shows it: words, and outlines in the image's pixels."""

from __future__ import annotations

import base64
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from doorway3ds.draw.panels import depth_limit, field_of_view
from doorway3ds.draw.scene import evidence_points, paper_points, patch, trusted
from doorway3ds.draw.words import facts, headline, sentence
from doorway3ds.types import Decision

_FLOOR_SIDE = 320  # floor masks are enlarged to this before they are outlined: smooth edges


def view_of(decision: Decision) -> dict[str, Any]:
    """Plain values for JSON; points are [x, y] in the image's pixels, outlines lists of them.

    depth: {"png", "limit_m"}, an image as a data URL (dark near, yellow far, clear unknown) and
    the distance at its bright end; null where there is none.
    """
    camera, selection = decision.frame.camera, decision.selection
    shown = trusted(decision)
    left, right = field_of_view(decision)
    reason = str(decision.reason)
    explained = {"label": "Reason", "value": reason, "note": "", "link": f"/reasons#{reason}"}
    return {
        "width": camera.width,
        "height": camera.height,
        "headline": headline(decision),
        "sentence": sentence(decision),
        "facts": [*(vars(fact) for fact in facts(decision)), explained],
        "field_of_view_deg": [left, right],
        "openings": [opening.to_dict() for opening in selection.openings],
        "pixel": list(selection.pixel) if shown and selection.pixel is not None else None,
        "floor": _floor(decision),
        "corridor": _rounded(evidence_points(decision, "corridor_px")) if shown else [],
        "obstacle": _patches(evidence_points(decision, "obstacle_px"), camera.width, camera.height)
        if shown
        else [],
        "clear": selection.clear if shown else None,
        "paper": (paper_points(decision) or None) if shown else None,
        "depth": _depth(decision.perception.depth_m),
    }


def _rounded(points: ArrayLike) -> list[list[float]]:
    array = np.asarray(points, float).reshape(-1, 2)
    # A corner far outside of the image must not cost the page its precision.
    return np.clip(array, -1e5, 1e5).round(1).tolist()  # type: ignore[no-any-return]


def _floor(decision: Decision) -> list[list[list[float]]]:
    floor = decision.perception.floor
    if floor is None:
        return []
    camera = decision.frame.camera
    scale = _FLOOR_SIDE / max(camera.width, camera.height)
    size = (max(2, round(camera.width * scale)), max(2, round(camera.height * scale)))
    large = cv2.resize(np.nan_to_num(floor).astype(np.float32), size)
    mask = (large >= 0.5).astype(np.uint8)
    return _outlines(mask, camera.width / size[0], camera.height / size[1], 1.0)


def _patches(points: NDArray[np.float64], width: int, height: int) -> list[list[list[float]]]:
    """Outlines round points that stand close to each other."""
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return []
    cell = max(width, height) / 128
    closed = patch(points, cell, (int(height / cell) + 2, int(width / cell) + 2))
    fine = cv2.resize(closed, None, fx=4, fy=4, interpolation=cv2.INTER_LINEAR)
    return _outlines((np.asarray(fine) > 110).astype(np.uint8), cell / 4, cell / 4, 1.0)


def _outlines(
    mask: NDArray[np.uint8], scale_x: float, scale_y: float, tolerance: float
) -> list[list[list[float]]]:
    """Outer and inner edges of a mask, scaled by pixel centres; small specks are left out."""
    edges, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    scale = np.array([scale_x, scale_y])
    return [
        _rounded((cv2.approxPolyDP(edge, tolerance, True)[:, 0] + 0.5) * scale - 0.5)
        for edge in edges
        if cv2.contourArea(edge) >= 12
    ]


def _depth(depth: NDArray[np.float32] | None) -> dict[str, Any] | None:
    limit = None if depth is None else depth_limit(depth)
    if depth is None or limit is None:
        return None
    known = np.isfinite(depth)
    levels = np.clip(np.where(known, depth, 0) / limit * 255, 0, 255).astype(np.uint8)
    colors = cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS)
    alpha = (known * 255).astype(np.uint8)
    png = cv2.imencode(".png", np.dstack([colors, alpha]), [cv2.IMWRITE_PNG_COMPRESSION, 3])[1]
    return {
        "png": "data:image/png;base64," + base64.b64encode(png.tobytes()).decode(),
        "limit_m": limit,
    }
