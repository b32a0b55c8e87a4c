from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.lab.datasets.readers import folder_camera
from doorway3ds.networks import load
from tests import factories
from tests.factories import encode, scene

_NEEDED = ("fastapi", "uvicorn", "python_multipart", "httpx", "segno", "cryptography")
collect_ignore_glob = [] if all(find_spec(name) for name in _NEEDED) else ["test_*.py"]

if not collect_ignore_glob:
    from doorway3ds.web.label.app import create_label_app, label_settings
    from doorway3ds.web.label.guess import guesser
    from doorway3ds.web.label.pictures import Guesser, Pictures
    from doorway3ds.web.label.table import Table
    from tests.web.conftest import Served, answering

Desk = Callable[..., "Served"]


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """Five pictures of several sizes: a.jpg, b.png, hall/c.jpg, hall/d.jpg (on its side), e.jpg."""
    folder = tmp_path / "site"
    (folder / "hall").mkdir(parents=True)
    (folder / "a.jpg").write_bytes(encode(scene(320, 240)))
    (folder / "b.png").write_bytes(encode(scene(200, 100), "PNG"))
    (folder / "e.jpg").write_bytes(encode(scene(96, 128)))
    (folder / "hall" / "c.jpg").write_bytes(encode(scene(320, 240)[:, ::-1].copy()))
    (folder / "hall" / "d.jpg").write_bytes(encode(scene(240, 180), orientation=6))
    return folder


@pytest.fixture(scope="session")
def guess(tmp_path_factory: pytest.TempPathFactory) -> Guesser:
    """A door from 0.25 to 0.5 of every picture's width."""
    path = tmp_path_factory.mktemp("nets") / "net.onnx"
    net = load(str(factories.doornet(path, left=0.25, right=0.5)))
    return guesser(Pipeline(net), folder_camera(path.parent))


@pytest.fixture
def desk(guess: Guesser) -> Iterator[Desk]:
    """Serves folders for labelling; all servers are stopped at the end."""
    with contextlib.ExitStack() as stack:

        def start(folder: Path, guesses: bool = True, token: str | None = None) -> Served:
            pictures = Pictures(folder, guess if guesses else None)
            app = create_label_app(label_settings(token, None), pictures, Table(folder))
            return stack.enter_context(answering(app))

        yield start
