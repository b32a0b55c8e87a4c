"""One HTML page, its plots and sheets as PNG files, and the same numbers as JSON."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.draw.reasons import reasons_html
from doorway3ds.files import write_bytes, write_json
from doorway3ds.lab.evaluate.intervals import Interval, plain


@dataclass(frozen=True)
class Table:
    """rows: (title, what it is about, one cell per column of `columns`)."""

    title: str
    columns: Sequence[str]
    rows: Sequence[tuple[str, str, Sequence[str]]]


@dataclass
class Report:
    """What a page holds, in order: facts, tables, plots, sheets, notes, reasons.

    facts: name -> text (data set, command, date). pictures: file stem -> (title, PNG bytes,
    whether it is a sheet, shown at full width). reasons: whether it explains those of decisions.
    """

    title: str
    facts: Mapping[str, str]
    tables: list[Table] = field(default_factory=list)
    pictures: dict[str, tuple[str, bytes, bool]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    reasons: bool = False

    def add_sheet(self, stem: str, title: str, image: NDArray[np.uint8]) -> None:
        """Add a contact sheet, (H, W, 3) uint8 RGB."""
        _, encoded = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        self.pictures[stem] = (title, encoded.tobytes(), True)

    def add_plot(self, stem: str, title: str, png: bytes) -> None:
        self.pictures[stem] = (title, png, False)


def cell(
    value: Interval, unit: str, *, to: str = "–", digits: int | None = None, signed: bool = False
) -> str:
    """ "62.1 % (55.0–68.9)"; a dash where the value is unknown.

    unit: as `direction.Metric`'s. to: between the interval's ends.
    """
    if not math.isfinite(value.value):
        return "–"
    factor, usual, suffix = {
        "share": (100, 1, " %"),
        "deg": (1, 1, "°"),
        "m": (1, 2, " m"),
    }.get(unit, (1, 3, ""))
    form = f"{'+' if signed else ''}.{usual if digits is None else digits}f"
    text = f"{value.value * factor:{form}}{suffix}"
    if math.isfinite(value.low):
        text += f" ({value.low * factor:{form}}{to}{value.high * factor:{form}})"
    return text


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)]) + "\n"


def write_report(report: Report, folder: Path, data: Mapping[str, Any]) -> Path:
    """Writes report.html, report.json and one PNG per picture; gives the page's path."""
    for stem, (_, png, _) in report.pictures.items():
        write_bytes(folder / f"{stem}.png", png)
    write_json(folder / "report.json", plain(data))
    return write_bytes(folder / "report.html", render(report).encode())


def render(report: Report) -> str:
    """The page; pictures are inside it, so that it can be sent on alone."""
    text = html.escape
    style = files("doorway3ds.lab.evaluate").joinpath("report/report.css").read_text("utf-8")
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{text(report.title)}</title><style>{style}</style></head><body>",
        f"<h1>{text(report.title)}</h1><table>",
    ]
    parts += [
        f"<tr><th>{text(name)}</th><td><code>{text(value)}</code></td></tr>"
        for name, value in report.facts.items()
    ]
    if report.reasons:
        link = '<a href="#reasons">what each asks you to do</a>'
        parts.append(f"<tr><th>reasons</th><td>{link}</td></tr>")
    parts.append("</table>")
    for table in report.tables:
        parts.append(f'<h2>{text(table.title)}</h2><div class="scroll"><table><tr><th></th>')
        parts += [f"<th>{text(column)}</th>" for column in table.columns]
        parts.append("</tr>")
        for title, about, cells in table.rows:
            parts.append(f'<tr><td>{text(title)}<br><span class="about">{text(about)}</span></td>')
            parts += [f'<td class="number">{text(value)}</td>' for value in cells]
            parts.append("</tr>")
        parts.append("</table></div>")
    plots = [(title, png) for title, png, sheet in report.pictures.values() if not sheet]
    if plots:
        parts.append('<h2>Plots</h2><div class="plots">')
        parts += [f"<figure>{_img(title, png)}</figure>" for title, png in plots]
        parts.append("</div>")
    for title, png, sheet in report.pictures.values():
        if sheet:
            parts.append(f"<h2>{text(title)}</h2>{_img(title, png)}")
    if report.notes:
        parts.append("<h2>Notes</h2>")
        parts += [f"<p>{text(note)}</p>" for note in report.notes]
    if report.reasons:
        parts.append(reasons_html(level=2))
    parts.append("</body></html>\n")
    return "\n".join(parts)


def _img(title: str, png: bytes) -> str:
    data = base64.b64encode(png).decode()
    return f'<img alt="{html.escape(title)}" src="data:image/png;base64,{data}">'
