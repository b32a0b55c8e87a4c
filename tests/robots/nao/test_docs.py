"""docs/naoqi.md lists the services and calls that a virtual NAO's session has, and no others."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.nao
PAGE = Path(__file__).parents[3] / "docs" / "naoqi.md"
FIRST_OWN = 100  # numbers below are libqi's own, of every object


def test_the_table_of_services_is_the_sessions_own_list(virtual: Any) -> None:
    import qi

    _, where = virtual()
    session = qi.Session()
    session.connect(f"tcp://{where}")
    page = PAGE.read_text()
    shared = set(re.search(r"Each also answers `([^`]+)`", page)[1].split(", "))  # type: ignore[index]
    groups = {
        f"*{name}*": calls
        for name, calls in re.findall(r"\*(\w+)\*\s(?:stands )?for\s`([^`]+)`", page)
    }
    table = {}
    for name, calls in re.findall(r"^\| (AL\w+) \| (.+) \|$", page, re.MULTILINE):
        for group, meant in groups.items():
            calls = calls.replace(group, meant)
        table[name] = set(calls.replace("`", "").split(", "))
    names = [s["name"] for s in session.services() if s["name"].startswith("AL")]
    answers = {}
    for name in names:
        methods = session.service(name).metaObject()["methods"].items()
        answers[name] = {m["name"] for number, m in methods if number >= FIRST_OWN} - shared
    session.close()
    assert sorted(names) == sorted(table)
    assert answers == table
