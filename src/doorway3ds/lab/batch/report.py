"""What came of a batch, as one HTML page: counts, distributions, the least certain images."""

from __future__ import annotations

import heapq
from pathlib import Path
from typing import Any

import pyarrow.compute as pc

from doorway3ds.errors import UserError
from doorway3ds.images.codec import read_image
from doorway3ds.lab.batch.items import Item, find_items
from doorway3ds.lab.batch.rows import counts, read_rows
from doorway3ds.lab.evaluate.report.html import Report, Table, write_report
from doorway3ds.lab.evaluate.report.plots import figure
from doorway3ds.lab.evaluate.report.sheets import Tile, contact_sheet, picture_tile

LEAST_CERTAIN = 24


def write_batch_report(folder: Path, sources: list[str], facts: dict[str, str]) -> Path:
    """Writes report.html into the data set's folder; returns its path.

    sources: where the images of the contact sheet are read again.

    Raises UserError if the folder holds no rows or cannot be written.
    """
    by_folder = counts(folder)
    images = str(sum(c["images"] for c in by_folder.values()))
    report = Report("Batch", {**facts, "images": images}, reasons=True)
    rows = [(where, "", list(map(str, count.values()))) for where, count in by_folder.items()]
    report.tables.append(Table("Answers by folder", list(next(iter(by_folder.values()))), rows))
    columns = ["image", "occurrence", "p_open", "bearing_deg", "range_m", "reason"]
    table = read_rows(folder, columns)
    for stem, title, column, bins, span in (
        ("p_open", "Probability of an open doorway", "p_open", 20, (0.0, 1.0)),
        ("bearing", "Bearing of the best opening, degrees, + left", "bearing_deg", 36, None),
        ("range", "Distance to the sill, metres", "range_m", 30, None),
    ):
        values = pc.drop_null(table[column]).to_numpy()
        if len(values):
            with figure() as (axes, done):
                axes.hist(values, bins=bins, range=span)
                axes.set(xlabel=title, ylabel="images")
                axes.yaxis.get_major_locator().set_params(integer=True)
                report.add_plot(stem, title, done())
    known = table.filter(pc.is_valid(table["p_open"])).select(columns).to_pylist()
    doubtful = heapq.nsmallest(LEAST_CERTAIN, known, key=lambda row: abs(row["p_open"] - 0.5))
    tiles = _tiles(sources, doubtful)
    if tiles:
        report.add_sheet("least-certain", "The least certain", contact_sheet(tiles))
    return write_report(report, folder / "_report", {"folders": by_folder})


def _tiles(sources: list[str], rows: list[dict[str, Any]]) -> list[Tile]:
    wanted = {(row["image"], row["occurrence"]): row for row in rows}
    found: dict[tuple[str, int], Tile] = {}
    for item in find_items(sources):
        row = wanted.get((item.name, item.occurrence))
        if row is None:
            continue
        tile = _tile(item, row)
        if tile is not None:
            found[item.name, item.occurrence] = tile
        if len(found) == len(wanted):
            break
    return [found[key] for key in wanted if key in found]


def _tile(item: Item, row: dict[str, Any]) -> Tile | None:
    caption = f"{row['p_open']:.2f} {row['reason']} {Path(item.name).name}"
    if item.frame is not None:
        return picture_tile(item.frame.image, caption)
    try:
        return picture_tile(read_image(item.read(), name=item.name).image, caption)
    except UserError:  # gone since it was decided on
        return None
