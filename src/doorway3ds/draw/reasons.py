"""docs/reasons.md as HTML, for pages whose answers lead there."""

from __future__ import annotations

import html
import re

from doorway3ds.draw.words import help_file
from doorway3ds.files import read_text

_INLINE = (
    (re.compile(r"`([^`]+)`"), r"<code>\1</code>"),
    (re.compile(r"\[([^]]+)\]\([^)]+\)"), r"\1"),  # its neighbours are not on the page
)


def reasons_html(level: int = 1) -> str:
    """The page below its title's heading of this level, each section with its reason as id."""
    parts = []
    for block in re.split(r"\n{2,}", read_text(help_file()).strip()):
        marks, _, title = block.partition(" ")
        if set(marks) == {"#"}:
            depth = level - 1 + len(marks)
            parts.append(f'<h{depth} id="{title.lower()}">{title}</h{depth}>')
        else:
            words = html.escape(block, quote=False)
            for found, instead in _INLINE:
                words = found.sub(instead, words)
            parts.append(f"<p>{words}</p>")
    return "\n".join(parts)
