"""What stands in which kind of room: (maker, how often, whether with its back to a wall)."""

from __future__ import annotations

from doorway3ds.lab.sim.homes.appliances import basin, bathtub, fridge, kitchen, toilet, washer
from doorway3ds.lab.sim.homes.furniture import (
    Maker,
    armchair,
    bed,
    bookshelf,
    chair,
    coffee_table,
    desk,
    dining,
    dresser,
    sofa,
    tv_unit,
    wardrobe,
)

ROOMS: dict[str, tuple[tuple[Maker, float, bool], ...]] = {
    "living": (
        (sofa, 1.0, True),
        (tv_unit, 0.85, True),
        (bookshelf, 0.7, True),
        (armchair, 0.6, True),
        (dresser, 0.5, True),
        (coffee_table, 0.75, False),
        (bookshelf, 0.3, True),
        (desk, 0.2, True),
    ),
    "bedroom": (
        (bed, 1.0, True),
        (wardrobe, 0.9, True),
        (dresser, 0.7, True),
        (dresser, 0.5, True),
        (desk, 0.35, True),
        (chair, 0.4, True),
        (bookshelf, 0.3, True),
    ),
    "kitchen": (
        (kitchen, 1.0, True),
        (fridge, 0.9, True),
        (dining, 0.55, False),
        (washer, 0.3, True),
        (kitchen, 0.3, True),
        (bookshelf, 0.15, True),
    ),
    "bath": ((basin, 1.0, True), (toilet, 0.9, True), (bathtub, 0.6, True), (washer, 0.5, True)),
    "office": (
        (desk, 1.0, True),
        (bookshelf, 0.9, True),
        (bookshelf, 0.5, True),
        (dresser, 0.4, True),
        (armchair, 0.35, True),
        (desk, 0.3, True),
        (wardrobe, 0.2, True),
    ),
    "dining": ((dining, 1.0, False), (dresser, 0.8, True), (bookshelf, 0.4, True)),
    "corridor": ((dresser, 0.35, True), (bookshelf, 0.2, True)),
    "store": ((bookshelf, 0.9, True), (washer, 0.4, True), (wardrobe, 0.3, True)),
}
