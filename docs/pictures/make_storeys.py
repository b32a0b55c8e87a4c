"""Draws the rooms of the package in their storeys, by what imports what, and counts both.

    python docs/pictures/make_storeys.py docs/pictures/storeys.svg
    PYTHONPATH=OTHER/src python docs/pictures/make_storeys.py       # counts alone, of another tree

A room is a module or package directly in `doorway3ds`; an arrow is an import between two rooms,
also inside a function, but for those that only type checkers see; a floor is a step of the longest
way down the arrows; a circle is a set of modules that import each other, by whatever way. The
drawing leaves out arrows that a way over other rooms implies.
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path
from typing import Any

import grimp
import tomllib

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "doorway3ds"
EDGES, LAB = ("cli", "web", "ros"), ("lab",)
COLOURS = {"edges": "#dcebf7", "laboratory": "#e8f3e6", "runtime": "#fdf1da"}
INK = "#3b4350"
WIDE, HIGH, FLOOR = 2.7, 0.54, 0.95  # of a box, and from one floor to the next

Arrows = dict[str, set[str]]
Point = tuple[float, float]


def arrows(rooms: bool) -> Arrows:
    """What each room, or each module, imports of the others."""
    graph = grimp.build_graph(PACKAGE, exclude_type_checking_imports=True, cache_dir=None)
    if rooms:
        for room in graph.find_children(PACKAGE):
            graph.squash_module(room)
    found: Arrows = {}
    for module in graph.modules - {PACKAGE}:
        others = graph.find_modules_directly_imported_by(module) - {module, PACKAGE}
        found[module.removeprefix(f"{PACKAGE}.")] = {
            other.removeprefix(f"{PACKAGE}.") for other in others
        }
    return found


def reached(down: Arrows) -> Arrows:
    """What each room or module imports, directly or not."""
    found = {one: set(to) for one, to in down.items()}
    for by in down:
        for one in down:
            if by in found[one]:
                found[one] |= found[by]
    return found


def count() -> str:
    """How many rooms, arrows, floors and circles there are, in words."""
    rooms, ways = arrows(rooms=True), reached(arrows(rooms=False))
    circles = {frozenset(to for to in ways[one] if one in ways[to]) for one in ways}

    def depth(room: str) -> int:
        return 1 + max(map(depth, rooms[room]), default=0)

    return (
        f"{len(rooms)} rooms, {sum(map(len, rooms.values()))} arrows, "
        f"{max(map(depth, rooms))} floors, {len(circles - {frozenset()})} circles"
    )


def draw(path: Path) -> None:
    """The rooms by the layers that the import linter holds, the highest on top."""
    import matplotlib as mpl

    mpl.use("svg")
    from matplotlib import pyplot as plt
    from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Patch
    from matplotlib.path import Path as Route

    mpl.rcParams.update({"svg.hashsalt": PACKAGE, "svg.fonttype": "none", "font.size": 11})
    config = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    layers = [layer.split(" | ") for layer in config["contracts"][0]["layers"]]
    down = arrows(rooms=True)
    ways = reached(down)
    place = {
        room: ((index - (len(layer) - 1) / 2) * (3.6 if len(layer) == 2 else 3.2), -number * FLOOR)
        for number, layer in enumerate(layers)
        for index, room in enumerate(layer)
    }
    figure, axes = plt.subplots(figsize=(8.4, 9.6))
    for room, (x, y) in place.items():
        kind = "edges" if room in EDGES else "laboratory" if room in LAB else "runtime"
        box: dict[str, Any] = {"facecolor": COLOURS[kind], "edgecolor": INK, "zorder": 3}
        corner = (x - WIDE / 2, y - HIGH / 2)
        axes.add_patch(FancyBboxPatch(corner, WIDE, HIGH, "round,pad=0,rounding_size=0.08", **box))
        within = sorted(
            p.parent.name for p in (ROOT / "src" / PACKAGE / room).glob("*/__init__.py")
        )
        text: dict[str, Any] = {"ha": "center", "va": "center", "zorder": 4}
        axes.text(x, y + (0.1 if within else 0), room, weight="bold", **text)
        axes.text(x, y - 0.13, ", ".join(within), fontsize=6.5, color=INK, **text)
    lanes = {-1: 0, 1: 0}
    for room in place:
        implied = {to for by in down[room] for to in ways[by]}
        for to in sorted(down[room] - implied, key=lambda to: -place[to][1]):
            others = [at for one, at in place.items() if one not in (room, to)]
            axes.add_patch(
                FancyArrowPatch(
                    path=Route(_route(place[room], place[to], others, lanes)), arrowstyle="-|>",
                    mutation_scale=11, color="#5c6675", linewidth=1.1, zorder=2, joinstyle="round",
                )
            )  # fmt: skip
    legend = [Patch(facecolor=c, edgecolor=INK, label=kind) for kind, c in COLOURS.items()]
    axes.legend(handles=legend, loc="lower left", frameon=False)
    axes.set_xlim(-4.7, 4.7)
    axes.set_ylim(-(len(layers) - 1) * FLOOR - 0.5, 0.5)
    axes.set_aspect("equal")
    axes.set_axis_off()
    figure.savefig(path, bbox_inches="tight", metadata={"Date": None})


def _route(above: Point, below: Point, others: list[Point], lanes: dict[int, int]) -> list[Point]:
    """A way from one box down to another that runs over no box; lanes: taken so far, by side."""
    top, bottom = above[1] - HIGH / 2, below[1] + HIGH / 2
    lean = max(-0.3, min(0.3, (below[0] - above[0]) / 6)) * WIDE
    ways = [[(above[0] + lean, top), (below[0] - lean, bottom)]]
    for out, into in ((out, into) for out in (0.0, 0.25, -0.25) for into in (0.25, -0.25)):
        x, to_x = above[0] + out * WIDE, below[0] + into * WIDE
        ways.append([(x, top), (x, bottom + 0.2), (to_x, bottom + 0.2), (to_x, bottom)])
    for way in ways:
        if not any(_over(way, box) for box in others):
            return way
    side = 1 if lanes[1] <= lanes[-1] else -1
    lanes[side] += 1
    edge = side * WIDE / 2
    x = below[0] + edge + side * (0.1 + 0.17 * lanes[side])
    return [
        (above[0] + edge, above[1] - 0.1), (x, above[1] - 0.1),
        (x, below[1] + 0.1), (below[0] + edge, below[1] + 0.1),
    ]  # fmt: skip


def _over(way: list[Point], box: Point) -> bool:
    """Whether a way runs over a box."""
    for start, end in itertools.pairwise(way):
        for step in range(41):
            x, y = (a + (b - a) * step / 40 for a, b in zip(start, end, strict=True))
            if abs(x - box[0]) < WIDE / 2 + 0.05 and abs(y - box[1]) < HIGH / 2 + 0.05:
                return True
    return False


if __name__ == "__main__":
    print(count())
    if len(sys.argv) > 1:
        draw(Path(sys.argv[1]))
