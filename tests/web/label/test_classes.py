"""A folder per class from what is marked."""

from __future__ import annotations

from pathlib import Path

import pytest

from doorway3ds.errors import UserError
from doorway3ds.lab.datasets.readers import read_dataset
from doorway3ds.web.label.classes import export_classes
from doorway3ds.web.label.pictures import Pictures


def files(folder: Path) -> list[str]:
    return sorted(
        p.relative_to(folder).as_posix()
        for p in folder.rglob("*")
        if p.is_file() and not p.name.startswith(".")
    )


def test_pictures_are_linked_into_their_classes_and_read_from_there(
    site: Path, tmp_path: Path
) -> None:
    out = tmp_path / "classes"
    states = {"a.jpg": "open", "b.png": "none", "hall/c.jpg": "closed", "hall/d.jpg": "half"}
    counts = export_classes(Pictures(site), {**states, "gone.jpg": "open"}, out)
    assert counts == {"open-door": 1, "no-door": 1, "closed-door": 1, "half-open-door": 1}
    assert files(out) == [
        "closed-door/hall/c.jpg",
        "half-open-door/hall/d.jpg",
        "no-door/b.png",
        "open-door/a.jpg",
    ]
    assert (out / "open-door/a.jpg").samefile(site / "a.jpg")
    data = read_dataset(out)
    assert data.layout == "folders"
    assert [s.is_open for s in data.samples] == [False, None, False, True]


def test_an_export_is_brought_up_to_date(site: Path, tmp_path: Path) -> None:
    out = tmp_path / "classes"
    pictures = Pictures(site)
    export_classes(pictures, {"a.jpg": "open", "hall/c.jpg": "open"}, out)
    (out / "open-door" / "mine.txt").write_text("kept")
    export_classes(pictures, {"a.jpg": "closed", "e.jpg": "open"}, out)
    assert files(out) == ["closed-door/a.jpg", "open-door/e.jpg", "open-door/mine.txt"]
    assert not (out / "open-door" / "hall").exists()
    assert files(site) == ["a.jpg", "b.png", "e.jpg", "hall/c.jpg", "hall/d.jpg"]


def test_where_no_link_can_be_made_pictures_are_copied(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise OSError(18, "Invalid cross-device link")

    monkeypatch.setattr(Path, "hardlink_to", refused)
    out = tmp_path / "classes"
    export_classes(Pictures(site), {"a.jpg": "open"}, out)
    copied = out / "open-door" / "a.jpg"
    assert not copied.samefile(site / "a.jpg")
    assert copied.read_bytes() == (site / "a.jpg").read_bytes()
    assert [p.name for p in copied.parent.iterdir()] == ["a.jpg"]


def test_folders_of_others_are_left_alone(site: Path, tmp_path: Path) -> None:
    pictures = Pictures(site)
    for inside in (site, site / "classes"):
        with pytest.raises(UserError, match="lies among the images"):
            export_classes(pictures, {"a.jpg": "open"}, inside)
    other = tmp_path / "other"
    (other / "open-door").mkdir(parents=True)
    (other / "open-door" / "a.jpg").write_text("theirs")
    with pytest.raises(UserError, match="did not put there"):
        export_classes(pictures, {"a.jpg": "open"}, other)
    assert (other / "open-door" / "a.jpg").read_text() == "theirs"
    (other / ".3ds-label.json").write_text('["open-door/../../site/a.jpg"]')
    with pytest.raises(UserError, match="not a list of an earlier export"):
        export_classes(pictures, {"b.png": "open"}, other)
    assert (site / "a.jpg").exists()
