from __future__ import annotations

from pathlib import Path

from doorway3ds.images.folder import images_in, natural


def test_numbers_sort_as_numbers_folder_by_folder() -> None:
    names = [
        "b/2.jpg",
        "a/10.jpg",
        "a/9.jpg",
        "1.jpg",
        "01.jpg",
        "a b/3.jpg",
        "a10b2.jpg",
        "a9.jpg",
    ]
    assert sorted(names, key=natural) == [
        "01.jpg", "1.jpg", "a/9.jpg", "a/10.jpg", "a9.jpg", "a10b2.jpg", "a b/3.jpg", "b/2.jpg",
    ]  # fmt: skip


def test_images_are_found_by_name_and_none_is_left_out_in_silence(tmp_path: Path) -> None:
    for name in (
        "10.jpg", "2.JPG", "IMG_1.HEIC", "old.gif", "notes.txt", ".hidden.jpg",
        "more/3.png", ".ipynb_checkpoints/4.png",
    ):  # fmt: skip
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()

    def found(recursive: bool) -> list[str]:
        return [p.relative_to(tmp_path).as_posix() for p in images_in(tmp_path, recursive)]

    top = ["2.JPG", "10.jpg", "IMG_1.HEIC", "old.gif"]
    assert found(False) == top
    assert found(True) == [*top[:3], "more/3.png", top[3]]
