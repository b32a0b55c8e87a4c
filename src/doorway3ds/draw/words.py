"""A decision in words: headline, sentence and facts, as images and pages show them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from doorway3ds.camera.model import Camera
from doorway3ds.types import Decision, Reason


@dataclass(frozen=True)
class Fact:
    label: str
    value: str
    note: str = ""


def signed(bearing_deg: float) -> str:
    """A bearing in words: 12.4° left."""
    size = f"{abs(bearing_deg):.1f}"
    if size == "0.0":
        return "0.0°"
    return f"{size}° {'left' if bearing_deg > 0 else 'right'}"


def counted(number: int, thing: str) -> str:
    """1 look, 2 looks."""
    return f"{number} {thing}{'' if number == 1 else 's'}"


def help_page(reason: Reason | None = None) -> str:
    """Where the documentation explains a reason, or all of them."""
    return "docs/reasons.md" + _anchor(reason)


def help_link(reason: Reason | None = None) -> str:
    """Address of the same page as installed."""
    return help_file().as_uri() + _anchor(reason)


def help_file() -> Path:
    """The same page as a file: of the wheel, or of the clone."""
    package = Path(__file__).resolve().parent.parent
    page = package / "reasons.md"
    return page if page.is_file() else package.parents[1] / "docs" / "reasons.md"


def _anchor(reason: Reason | None) -> str:
    return "" if reason is None else f"#{reason}"


def _metres(distance_m: float | None) -> str | None:
    if distance_m is None or not math.isfinite(distance_m):
        return None
    return f"{distance_m:.1f}\u00a0m"


def headline(decision: Decision) -> str:
    """What to do, in two to four words."""
    reason, look = decision.reason, decision.selection.look
    if reason is Reason.TURN and decision.turn_deg is not None:
        side = "left" if decision.turn_deg > 0 else "right"
        return f"Turn {side} {abs(decision.turn_deg):.1f}°"
    if reason is Reason.UNSURE and look is not None:
        return f"Look {look} first"
    return {
        Reason.TURN: "Turn",
        Reason.ALIGNED: "Facing the doorway",
        Reason.BLOCKED: "Stay: way blocked",
        Reason.UNSURE: "Stay: not sure",
        Reason.NO_DOOR: "Stay: no open doorway",
        Reason.LOST: "Stay: doorway lost",
    }[reason]


def sentence(decision: Decision) -> str:
    """Why, in one or two sentences."""
    selection = decision.selection
    where = _where(decision)
    if decision.reason is Reason.NO_DOOR:
        return f"The probability of an open doorway, {decision.p_open:.2f}, is too low."
    if decision.reason is Reason.LOST:
        return "The doorway that was followed, or the camera's image, is gone."
    if decision.reason is Reason.BLOCKED:
        return f"An open doorway {where}, but something stands in the way."
    if decision.reason is Reason.UNSURE:
        why = (selection.unsure or "what is seen does not suffice to turn by").strip().rstrip(".")
        return f"Probably an open doorway {where}, but {why}."
    way = {
        True: "The way to it is free.",
        False: "Something stands in the way to it.",
        None: "The floor on the way is not seen.",
    }[selection.clear]
    if decision.reason is Reason.ALIGNED:
        distance = _metres(selection.range_m)
        ahead = "straight ahead" if distance is None else f"straight ahead, {distance} away"
        return f"The open doorway is {ahead}. {way}"
    return f"An open doorway {where}. {way}"


def _where(decision: Decision) -> str:
    bearing, distance = decision.selection.bearing_deg, _metres(decision.selection.range_m)
    if bearing is None:
        return "in the image" if distance is None else f"{distance} away"
    side = signed(bearing)
    place = "straight ahead" if side == "0.0°" else side.replace("°", "° to the")
    return place if distance is None else f"{place}, {distance} away"


def facts(decision: Decision) -> list[Fact]:
    """Numbers behind the answer, each with its name, in the order of reading."""
    selection = decision.selection
    if decision.open:
        bearing = "none" if selection.bearing_deg is None else signed(selection.bearing_deg)
        way = {True: "free", False: "blocked", None: "not seen"}[selection.clear]
        distance = _metres(selection.range_m) or "unknown"
        off_deg, seen = decision.perception.bearing_error_deg, decision.perception
        told = off_deg is not None and bearing != "none" and decision.method != "paper"
        off_m = _metres(seen.range_error_m(selection.range_m))
        floor = _metres(selection.floor_from_m)
        found = [
            Fact("Bearing", bearing, f"measured error ± {off_deg:.1f}°" if told else ""),
            Fact("Distance", distance, f"measured error ± {off_m}" if off_m else ""),
            Fact("Way", way, f"floor in view from {floor} on" if floor else ""),
        ]
    else:
        found = [Fact("Bearing", "none"), Fact("Distance", "none"), Fact("Way", "not judged")]
    found.append(_paper(decision) or _openings(decision))
    camera = decision.frame.camera
    view = f"{camera.hfov_deg:.1f}° × {camera.vfov_deg:.1f}°"
    label = "Camera, assumed" if camera.assumed else "Camera"
    found += [
        Fact("Method", decision.method),
        Fact("Network", decision.perception.network),
        Fact(label, _camera_name(camera), f"field of view {view}"),
        Fact("Camera pose", *_pose(decision)),
    ]
    return found


def _camera_name(camera: Camera) -> str:
    name = camera.name.replace(" deg", "°")
    if camera.assumed and name.startswith("assumed "):
        return f"{name.removeprefix('assumed ')} over the longer side"
    return name


def _openings(decision: Decision) -> Fact:
    openings = decision.selection.openings
    if not openings:
        return Fact("Openings", "none")
    best = openings[0]
    cut = {None: "", "left": ", cut at the left", "right": ", cut at the right"}.get(
        best.cut, ", cut on both sides"
    )
    return Fact(
        "Openings", counted(len(openings), "candidate"), f"best score {best.score:.2f}{cut}"
    )


def _paper(decision: Decision) -> Fact | None:
    evidence = decision.selection.evidence
    best = evidence.get("best_pixel")
    if best is None:
        return None
    parts = [
        f"{name} {tuple(int(i) for i in evidence[key])}"
        for name, key in (("max", "max_pixel"), ("trigger", "trigger_pixel"))
        if evidence.get(key) is not None
    ]
    return Fact("Best-Pixel (row, column)", f"{tuple(int(i) for i in best)}", " · ".join(parts))


def _pose(decision: Decision) -> tuple[str, str]:
    pose = decision.frame.pose
    angles = [
        f"{name} {value:+.1f}°".replace("-", "−")
        for name, value in (
            ("pitch", pose.pitch_deg),
            ("yaw", pose.yaw_deg),
            ("roll", pose.roll_deg),
        )
        if abs(value) >= 0.05
    ]
    height = _metres(pose.height_m)
    if pose.height_m is not None:
        height = f"{pose.height_m:.2f}\u00a0m"
    return " · ".join(angles) or "level", f"height {height or 'unknown'}"
