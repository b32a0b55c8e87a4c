from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from tests import factories


@pytest.fixture(scope="session", autouse=True)
def domain() -> Iterator[None]:
    """The tests' own ROS domain, which does not leave this machine."""
    import os

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        patch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
        yield


@pytest.fixture
def peer() -> Iterator[Any]:
    """A node beside the one under test; skips without the extra `ros`."""
    if find_spec("rclpy") is None:
        pytest.skip("needs the extra 'ros': pip install 'doorway3ds[ros]'")
    from tests.ros.bus import Peer

    found = Peer("peer")
    yield found
    found.close()


@pytest.fixture
def node(tmp_path: Path, peer: Any) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts nodes: node(*parameters, name=None); each must end by Ctrl-C, without a traceback."""
    from tests.ros.bus import ended, start_node

    factories.doornet(tmp_path / "net.onnx", left=0.2, right=0.4)
    running: list[subprocess.Popen[str]] = []

    def start(*parameters: str, name: str | None = None) -> subprocess.Popen[str]:
        running.append(start_node(tmp_path, *parameters, name=name))
        return running[-1]

    yield start
    for process in running:
        already = process.poll() is not None
        status, said = (process.returncode, "") if already else ended(process)
        assert already or status == 130, said
        assert "Traceback" not in said, said
