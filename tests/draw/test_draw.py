"""Annotated pictures: what is drawn, where, and that every case draws at all."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from doorway3ds.camera.model import Camera, Pose, bearing_of_pixel
from doorway3ds.draw import annotate, overlay
from doorway3ds.draw.canvas import AZURE, GREEN, VERMILLION, View
from doorway3ds.draw.panels import STATUS, depth_colors, depth_limit, draw_dial, draw_scale
from doorway3ds.draw.scene import paint_best
from doorway3ds.draw.words import facts, headline, sentence
from doorway3ds.types import Decision, Frame, Opening, Perception, Reason, Selection

WIDTH, HEIGHT = 320, 240


def opening(camera: Camera, left: float, right: float, cut: str | None = None) -> Opening:
    row = (camera.height - 1) / 2
    bearings = bearing_of_pixel(
        camera, Pose(), [(left, row), (right, row), ((left + right) / 2, row)]
    )
    left_deg, right_deg, middle = (float(angle) for angle in bearings)
    return Opening(left, right, left_deg, right_deg, middle, 2.5, 0.9, cut)


def decision(
    reason: Reason = Reason.TURN,
    size: tuple[int, int] = (WIDTH, HEIGHT),
    spans: tuple[tuple[float, float, str | None], ...] = ((0.2, 0.4, None),),
    **perceived: Any,
) -> Decision:
    """A decision over a grey picture; spans are fractions of the width, best first."""
    width, height = size
    camera = Camera.from_fov(width, height, 60.0, name="assumed 60.9 deg", assumed=True)
    image = np.full((height, width, 3), 128, np.uint8)
    openings = tuple(
        opening(camera, low * width - 0.5, high * width - 0.5, cut) for low, high, cut in spans
    )
    is_open = reason is not Reason.NO_DOOR
    best = openings[0] if openings else None
    bearing = best.bearing_deg if best else None
    turn = {Reason.TURN: bearing, Reason.ALIGNED: 0.0}.get(reason)
    middle = 0.0 if best is None else (best.left_px + best.right_px) / 2
    corridor = [
        (middle + dx * width, y * height)
        for dx, y in ((-0.2, 1.4), (0.2, 1.4), (0.04, 0.8), (-0.04, 0.8))
    ]
    selection = Selection(
        bearing_deg=bearing,
        range_m=None if best is None else best.range_m,
        pixel=None if best is None else (height // 2, round(middle)),
        clear={Reason.BLOCKED: False, Reason.UNSURE: None}.get(reason, True),
        floor_from_m=1.1,
        openings=openings,
        unsure="the opening is cut by the image's left edge" if reason is Reason.UNSURE else None,
        look="left" if reason is Reason.UNSURE else None,
        evidence={"corridor_px": corridor, "obstacle_px": None},
    )
    depth = np.linspace(1, 6, 48 * 64, dtype=np.float32).reshape(48, 64)
    seen: dict[str, Any] = {"depth_m": depth, "floor": None, "network": "truth", **perceived}
    perception = Perception(0.9 if is_open else 0.1, **seen)
    return Decision(
        reason,
        turn,
        perception.p_open,
        is_open,
        selection,
        perception,
        Frame(image, camera),
        "opening",
    )


def paper_decision(clear: bool) -> Decision:
    made = decision(Reason.TURN if clear else Reason.BLOCKED, spans=())
    pixels = {"max_pixel": (130, 200), "best_pixel": (130, 240), "trigger_pixel": (238, 240)}
    selection = replace(
        made.selection, bearing_deg=-15.2, pixel=(130, 240), clear=clear, evidence=pixels
    )
    turn = -15.2 if clear else None
    return replace(made, selection=selection, turn_deg=turn, method="paper")


def mirrored(made: Decision) -> Decision:
    """The same scene seen in a mirror: camera, openings and turn swap sides."""
    camera = made.frame.camera.mirrored()
    width = camera.width
    other = {"left": "right", "right": "left"}
    openings = tuple(
        replace(
            o,
            left_px=width - 1 - o.right_px,
            right_px=width - 1 - o.left_px,
            left_deg=-o.right_deg,
            right_deg=-o.left_deg,
            bearing_deg=-o.bearing_deg,
            cut=other.get(o.cut or "", o.cut),
        )
        for o in made.selection.openings
    )
    assert made.selection.bearing_deg is not None
    selection = replace(made.selection, openings=openings, bearing_deg=-made.selection.bearing_deg)
    frame = Frame(np.ascontiguousarray(made.frame.image[:, ::-1]), camera)
    turn = None if made.turn_deg is None else -made.turn_deg
    return replace(made, turn_deg=turn, selection=selection, frame=frame)


def columns_of(image: np.ndarray, color: tuple[int, int, int]) -> np.ndarray:
    """Columns in which a colour fills at least a third of the height."""
    near = (np.abs(image.astype(int) - color).max(axis=2) < 40).mean(axis=0)
    return np.flatnonzero(near > 1 / 3)


@pytest.mark.parametrize("reason", list(Reason))
@pytest.mark.parametrize("width", [400, 1600])
def test_every_reason_draws_a_page_of_the_asked_width(reason: Reason, width: int) -> None:
    page = annotate(decision(reason), width)
    assert page.dtype == np.uint8
    assert page.shape[1:] == (width, 3)
    assert 0.6 * width < page.shape[0] < 1.2 * width
    # The icon in the corner carries the reason's own colour.
    corner = page[: page.shape[0] // 6, : width // 8].reshape(-1, 3)
    assert (corner == STATUS[reason]).all(axis=1).mean() > 0.1


@pytest.mark.parametrize(
    "size",
    [(1, 1), (16, 12), (640, 480), (480, 640), (1600, 200), (50, 1000), (3000, 20), (500, 500)],
)
def test_any_aspect_draws(size: tuple[int, int]) -> None:
    made = decision(size=size, spans=((0.2, 0.4, None), (0.6, 0.7, None)))
    page = annotate(made, 800)
    assert page.shape[1:] == (800, 3)
    # Nothing runs out of the page: a margin stays paper on all four sides.
    edges = np.concatenate([page[:8].reshape(-1, 3), page[-8:].reshape(-1, 3)])
    sides = np.concatenate([page[:, :8].reshape(-1, 3), page[:, -8:].reshape(-1, 3)])
    assert (np.concatenate([edges, sides]) == page[0, 0]).all()
    assert overlay(made).shape == (size[1], size[0], 3)


@pytest.mark.parametrize("size", [(390, 200), (380, 200), (500, 500), (300, 400)])
def test_long_words_stay_on_the_page(size: tuple[int, int]) -> None:
    made = decision(Reason.UNSURE, size, network="a-network-with-a-very-long-name-" * 6)
    made = replace(made, selection=replace(made.selection, unsure="it is not known " * 40))
    page = annotate(made, 800)
    edges = np.concatenate([page[-8:].reshape(-1, 3), page[:, -8:].reshape(-1, 3)])
    assert (edges == page[0, 0]).all()


UNKNOWN = np.full((48, 64), np.nan, np.float32)


@pytest.mark.parametrize(
    ("perceived", "spans"),
    [
        ({"depth_m": None}, ((0.2, 0.4, None),)),
        ({"depth_m": UNKNOWN}, ((0.2, 0.4, None),)),
        ({"floor": np.ones((3, 5), np.float32)}, ((0.2, 0.4, None),)),
        ({"floor": UNKNOWN}, ((0.2, 0.4, None),)),
        ({}, ()),
    ],
)
@pytest.mark.parametrize("reason", [Reason.UNSURE, Reason.NO_DOOR, Reason.LOST])
def test_missing_parts_draw(reason: Reason, perceived: dict[str, Any], spans: Any) -> None:
    made = decision(reason, spans=spans, **perceived)
    assert annotate(made, 800).shape[1] == 800
    assert overlay(made).shape == (HEIGHT, WIDTH, 3)


def test_too_narrow_a_page_is_refused() -> None:
    with pytest.raises(ValueError, match="width must be a whole number from 400"):
        annotate(decision(), 100)


def test_input_is_left_alone_and_the_picture_is_deterministic() -> None:
    made = decision(floor=np.ones((6, 8), np.float32))
    before = made.frame.image.copy()
    first, again = annotate(made), annotate(made)
    assert np.array_equal(first, again)
    assert np.array_equal(overlay(made), overlay(made))
    assert np.array_equal(made.frame.image, before)


def test_jambs_stand_at_the_columns_of_the_opening() -> None:
    made = decision(size=(640, 480), spans=((0.25, 0.5, None),))
    columns = columns_of(overlay(made), AZURE)
    expected = made.selection.openings[0]
    assert abs(columns[columns < 240].mean() - expected.left_px) <= 1
    assert abs(columns[columns >= 240].mean() - expected.right_px) <= 1


@pytest.mark.parametrize(("cut", "span"), [("left", (0.0, 0.3)), ("right", (0.7, 1.0))])
def test_a_cut_opening_has_no_jamb_on_the_cut_side(cut: str, span: tuple[float, float]) -> None:
    made = decision(size=(640, 480), spans=((*span, cut),))
    image = overlay(made)
    columns = columns_of(image, AZURE)
    jamb = (
        made.selection.openings[0].right_px if cut == "left" else made.selection.openings[0].left_px
    )
    assert abs(columns.mean() - jamb) <= 1
    # Its rails run out of the picture instead.
    edge = image[:, 0 if cut == "left" else -1].astype(int)
    assert (np.abs(edge - AZURE).max(axis=1) < 40).any()


def test_an_opening_below_the_gate_is_not_drawn_as_the_aim() -> None:
    assert columns_of(overlay(decision(Reason.TURN, size=(640, 480))), AZURE).size
    assert not columns_of(overlay(decision(Reason.NO_DOOR, size=(640, 480))), AZURE).size


def test_the_way_is_green_when_free_and_vermillion_when_blocked() -> None:
    below = {}
    for reason in (Reason.TURN, Reason.BLOCKED):
        made = decision(reason, size=(640, 480))
        middle = round(640 * 0.3)
        patch = overlay(made)[394:420, middle - 15 : middle + 15].reshape(-1, 3).mean(axis=0)
        below[reason] = patch - 128
    for reason, color in ((Reason.TURN, GREEN), (Reason.BLOCKED, VERMILLION)):
        toward = np.array(color) - 128.0
        cosine = below[reason] @ toward / np.linalg.norm(below[reason]) / np.linalg.norm(toward)
        assert cosine > 0.95


def test_obstacle_points_are_marked_where_they_are() -> None:
    made = decision(Reason.BLOCKED, size=(640, 480))
    points = np.stack(np.meshgrid(np.arange(500, 541, 4), np.arange(300, 341, 4)), -1)
    evidence = {**made.selection.evidence, "obstacle_px": points.reshape(-1, 2)}
    marked = overlay(replace(made, selection=replace(made.selection, evidence=evidence)))
    rows, columns = np.nonzero((marked != overlay(made)).any(axis=2))
    assert abs(columns.mean() - 520) < 5
    assert abs(rows.mean() - 320) < 5
    assert np.ptp(columns) < 70


@pytest.mark.parametrize("reason", [Reason.TURN, Reason.BLOCKED, Reason.UNSURE])
@pytest.mark.parametrize("span", [(0.2, 0.4, None), (0.7, 1.0, "right")])
def test_a_mirrored_decision_mirrors_the_dial(reason: Reason, span: Any) -> None:
    made = decision(reason, spans=(span, (0.5, 0.6, None)))
    dial = draw_dial(made, 401, 280, 1.0)[60:].astype(int)
    other = draw_dial(mirrored(made), 401, 280, 1.0)[60:, ::-1].astype(int)
    # The figures round the arc are above row 60; what is below is shapes alone.
    assert np.abs(dial - other).mean() < 1.5
    assert np.abs(dial - other[:, ::-1]).mean() > 4


@pytest.mark.parametrize("turn", [6.0, -20.0, 75.0, -120.0, 170.0])
def test_the_dial_points_to_the_side_of_the_turn(turn: float) -> None:
    made = decision(spans=())
    made = replace(made, turn_deg=turn, selection=replace(made.selection, bearing_deg=turn))
    dial = draw_dial(made, 480, 300, 1.0).astype(int)
    blue = np.abs(dial - STATUS[Reason.TURN]).max(axis=2) < 30
    offset = np.nonzero(blue)[1].mean() - 239.5
    assert np.sign(offset) == -np.sign(turn)


@pytest.mark.parametrize("clear", [True, False])
def test_the_paper_pixels_are_marked_on_their_240_by_320_map(clear: bool) -> None:
    made = paper_decision(clear)
    image = overlay(made).astype(int)
    color = GREEN if clear else VERMILLION
    way = np.abs(image - color).max(axis=2) < 30
    columns = np.nonzero(way[140:225, 225:])[1] + 225
    assert abs(columns.mean() - 240) < 1
    # Solid where free, dashed where not.
    assert (way[145:220, 240].mean() > 0.95) == clear
    assert annotate(made, 800).shape[1] == 800
    assert any("Best-Pixel" in fact.label and fact.value == "(130, 240)" for fact in facts(made))


def test_paint_scales_with_the_canvas_by_pixel_centres() -> None:
    view = View(np.full((480, 640, 3), 128, np.uint8), (320, 240), 1.0)
    paint_best(view, Opening(99.5, 199.5, 0, 0, 0, None, 1, None), 400, shade=False)
    columns = columns_of(view.canvas, AZURE)
    assert abs(columns[columns < 300].mean() - 199.5) <= 1
    assert abs(columns[columns > 300].mean() - 399.5) <= 1


def test_depth_colours_follow_the_scale_and_leave_the_unknown_grey() -> None:
    depth = np.array([[1.0, 4.0], [np.nan, 8.0]], np.float32).repeat(8, 0).repeat(8, 1)
    limit = depth_limit(depth)
    assert limit == 8
    colors = depth_colors(depth, limit, 16, 16)
    scale = draw_scale(limit, 161, 1.0)
    for (row, column), metres in {(3, 3): 1.0, (3, 12): 4.0, (12, 12): 8.0}.items():
        assert np.abs(colors[row, column].astype(int) - scale[2, round(metres * 20)]).max() <= 4
    grey = colors[12, 3].astype(int)
    assert np.ptp(grey) == 0
    assert depth_limit(UNKNOWN) is None


def test_words_say_what_to_do_and_why() -> None:
    made = decision()
    assert made.turn_deg is not None
    assert headline(made) == f"Turn left {made.turn_deg:.1f}°"
    assert headline(mirrored(made)) == f"Turn right {made.turn_deg:.1f}°"
    assert headline(decision(Reason.UNSURE)) == "Look left first"
    assert "cut by the image's left edge" in sentence(decision(Reason.UNSURE))
    assert "0.10" in sentence(decision(Reason.NO_DOOR))
    assert len({headline(decision(reason)) for reason in Reason}) == len(Reason)
    labels = {fact.label: fact for fact in facts(made)}
    assert labels["Camera, assumed"].value == "60.9° over the longer side"
    assert labels["Method"].value == "opening"
    assert labels["Network"].value == "truth"
    assert {fact.value for fact in facts(decision(Reason.NO_DOOR))} >= {"none", "not judged"}
