"""`from naoqi import ALProxy, ALBroker, ALModule` against a virtual NAO on a real libqi session."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.nao


@pytest.fixture
def at(virtual: Callable[..., Any]) -> tuple[Any, str, int]:
    nao, where = virtual()
    ip, port = where.split(":")
    return nao, ip, int(port)


@pytest.fixture
def broker(at: tuple[Any, str, int]) -> Iterator[Any]:
    from naoqi import ALBroker

    made = ALBroker("broker", "0.0.0.0", 0, at[1], at[2])
    yield made
    made.shutdown()


def wait_for(what: Callable[[], Any]) -> None:
    deadline = time.monotonic() + 5
    while not what() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert what()


def test_a_proxy_calls_and_hands_back_lists(at: tuple[Any, str, int]) -> None:
    from naoqi import ALProxy

    motion = ALProxy("ALMotion", at[1], at[2])
    motion.wakeUp()
    assert motion.moveTo(0.0, 0.0, 0.3) is True
    assert motion.getRobotPosition(True)[2] == pytest.approx(0.3)
    video = ALProxy("ALVideoDevice", at[1], at[2])
    image = video.getImageRemote(video.subscribeCamera("proxy", 0, 1, 11, 10))
    assert (type(image), type(image[6]), len(image[6])) == (list, bytes, 320 * 240 * 3)


def test_post_starts_a_call_that_can_be_waited_for(at: tuple[Any, str, int]) -> None:
    from naoqi import ALProxy

    motion = ALProxy("ALMotion", at[1], at[2])
    motion.wakeUp()
    number = motion.post.moveTo(0.0, 0.0, 1.0)
    assert isinstance(number, int)
    assert motion.isRunning(number)
    assert motion.wait(number, 50) is True  # the time ran out
    assert motion.wait(number, 0) is False
    assert not motion.isRunning(number)
    assert at[0].body.odometry()[2] == pytest.approx(57.2958)


def test_what_the_robot_refuses_is_a_runtime_error(at: tuple[Any, str, int]) -> None:
    from naoqi import ALProxy

    with pytest.raises(RuntimeError, match="no service ALNothing"):
        ALProxy("ALNothing", at[1], at[2])
    motion = ALProxy("ALMotion", at[1], at[2])
    with pytest.raises(RuntimeError, match=r"^ALMotion\.getAngles: ALMotion: unknown joint Nose"):
        motion.getAngles("Nose", True)
    with pytest.raises(RuntimeError, match=r"has no ALMotion\.dance"):
        motion.dance()
    with pytest.raises(RuntimeError, match="is the robot on"):
        ALProxy("ALMotion", "127.0.0.1", 9)


def test_without_a_broker_an_address_is_needed() -> None:
    from naoqi import ALModule, ALProxy

    with pytest.raises(RuntimeError, match="ALBroker"):
        ALProxy("ALMotion")
    with pytest.raises(RuntimeError, match="ALBroker"):
        ALModule("Listener")


def test_modules_are_called_with_what_they_take(at: tuple[Any, str, int], broker: Any) -> None:
    from naoqi import ALModule, ALProxy

    heard: list[Any] = []

    class Listener(ALModule):
        def onAll(self, key: str, value: Any, message: str) -> None:
            heard.append((key, value, message))

        def onTwo(self, key: str, value: Any) -> None:
            heard.append((key, value))

        def onAny(self, *event: Any) -> None:
            heard.append(event)

    listener = Listener("Listener")
    memory = ALProxy("ALMemory")
    memory.subscribeToEvent("A", "Listener", "onAll")
    memory.subscribeToEvent("B", "Listener", "hint", "onTwo")
    memory.subscribeToMicroEvent("C", "Listener", "hint", "onAny")
    memory.raiseEvent("A", [1, 2.5, "x"])
    memory.raiseEvent("B", True)
    memory.raiseMicroEvent("C", "hi")
    wait_for(lambda: len(heard) == 3)
    assert heard == [("A", [1, 2.5, "x"], "Listener"), ("B", True), ("C", "hi", "hint")]
    assert memory.getSubscribers("A") == ["Listener"]
    memory.unsubscribeToEvent("A", "Listener")
    memory.raiseEvent("A", 1)
    listener.exit()
    memory.raiseEvent("B", False)  # nobody is there to hear it, and nobody minds
    wait_for(lambda: memory.getSubscribers("B") == [])
    assert len(heard) == 3


def test_it_listens_on_no_other_address_than_the_one_that_faces_the_robot(broker: Any) -> None:
    endpoints = broker.naoqi._session.endpoints()
    assert endpoints
    assert all(url.startswith("tcp://127.0.0.1:") for url in endpoints)


def test_a_script_ends_with_status_zero_even_if_it_leaves_all_open(
    at: tuple[Any, str, int],
) -> None:
    script = f"""
from naoqi import ALBroker, ALModule, ALProxy
broker = ALBroker("b", "0.0.0.0", 0, "{at[1]}", {at[2]})
module = ALModule("Left")
motion = ALProxy("ALMotion", "{at[1]}", {at[2]})
motion.wakeUp()
motion.post.moveTo(0, 0, 3.0)
"""
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=30)
    assert (ran.returncode, ran.stderr) == (0, "")


def test_naoqis_own_module_is_taken_where_there_is_one(tmp_path: Path) -> None:
    (tmp_path / "naoqi").mkdir()
    (tmp_path / "naoqi" / "__init__.py").write_text("ALProxy = 'the real one'\n")
    script = "import sys; sys.path.append(sys.argv[1]); import naoqi; print(naoqi.ALProxy)"
    ran = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, timeout=30
    )
    assert (ran.stdout, ran.stderr) == ("the real one\n", "")


def test_two_copies_do_not_look_for_each_other(tmp_path: Path) -> None:
    import naoqi

    (tmp_path / "naoqi.py").write_text(Path(naoqi.__file__).read_text())
    script = "import sys; sys.path.insert(0, sys.argv[1]); import naoqi; print(naoqi.ALProxy)"
    ran = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, timeout=30
    )
    assert (ran.stdout, ran.stderr) == ("<class 'doorway3ds.robots.nao.proxies.ALProxy'>\n", "")
