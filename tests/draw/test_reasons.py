from __future__ import annotations

import re

import pytest

from doorway3ds.draw.reasons import reasons_html
from doorway3ds.types import Reason


@pytest.mark.parametrize("level", [1, 2])
def test_each_reason_has_a_section_under_its_name(level: int) -> None:
    page = reasons_html(level)
    assert page.startswith(f'<h{level} id="reasons">Reasons</h{level}>\n<p>')
    assert re.findall(rf'<h{level + 1} id="(\w+)">\1<', page) == list(Reason)


def test_no_mark_of_the_source_is_left() -> None:
    page = reasons_html()
    assert "<code>p_open</code> is below 0.5" in page
    assert "see\nTroubleshooting.</p>" in page
    assert not re.search(r"[`#\[\]]|<(?!/?(h[12]|p|code)\b)", page)
