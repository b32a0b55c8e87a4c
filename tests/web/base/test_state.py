"""The files of the pages: what pages share is written once."""

from __future__ import annotations

from collections import Counter
from importlib.resources import files

import pytest

from doorway3ds.web.base.state import Assets

PAGES = ("index.html", "label.html", "docs.html", "login.html")


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_whole(name: str) -> None:
    page = Assets()[name].data.decode()
    assert "#include" not in page
    head = page.partition("</head>")[0]
    assert head.count('<meta charset="utf-8">') == head.count("/static/app.css") == 1
    assert page.count('id="theme"') == (name in PAGES[:2])


def test_what_pages_share_is_no_file_of_its_own() -> None:
    assert Assets().get("_head.html") is None


def test_pages_repeat_no_line_of_the_head() -> None:
    static = files("doorway3ds.web").joinpath("static")
    heads = [static.joinpath(name).read_text("utf-8").partition("</head>")[0] for name in PAGES]
    lines = Counter(line.strip() for head in heads for line in set(head.splitlines()))
    del lines["<!doctype html>"], lines['<html lang="en">'], lines["<head>"], lines[""]
    assert {line for line, count in lines.items() if count > 1} == {
        "<!--#include _head.html-->",
        '<link rel="stylesheet" href="/static/marks.css">',
    }
