"""Tables of a report on the terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from doorway3ds.lab.evaluate.report.html import Table


def print_tables(console: Console, tables: Iterable[Table]) -> None:
    """Each table with its title, one row a line where the terminal is wide enough."""
    from rich.table import Table as RichTable

    for table in tables:
        # as a line of its own, as Rich wraps a title to its table's width
        console.print(table.title, style="italic", highlight=False, markup=False)
        shown = RichTable(box=None, pad_edge=False)
        shown.add_column("")
        for column in table.columns:
            shown.add_column(column)
        for name, _, cells in table.rows:
            shown.add_row(name, *cells)
        console.print(shown)
