"""Where a test lies: in the folder that mirrors the code that it is about; commands in cli/."""

from __future__ import annotations

from pathlib import Path

import doorway3ds

TESTS = Path(__file__).parent
PACKAGE = Path(doorway3ds.__file__).parent


def test_every_folder_of_tests_is_one_of_the_package() -> None:
    folders = {file.parent.relative_to(TESTS) for file in TESTS.rglob("test_*.py")}
    assert [str(f) for f in sorted(folders) if not (PACKAGE / f / "__init__.py").is_file()] == []
