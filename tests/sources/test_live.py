"""Live sources against cameras that a test plugs, unplugs and stalls."""

from __future__ import annotations

import base64
import itertools
import socket
import struct
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from doorway3ds.camera.model import Pose
from doorway3ds.errors import UserError
from doorway3ds.sources import Shot, SourceLost, View, open_source
from doorway3ds.sources import live as live_module
from doorway3ds.sources.capture import OpenCvCapture
from doorway3ds.sources.live import LiveSource
from tests.factories import encode, number, scene
from tests.sources.servers import MjpegServer


def wait_until(true: Callable[[], object], seconds: float = 5.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


class Webcam:
    """Stands for cv2.VideoCapture: grey BGR pictures that count up."""

    def __init__(self, gap_s: float = 0.01, lasts: int | None = None, there: bool = True) -> None:
        self.gap_s, self.lasts, self.there = gap_s, lasts, there
        self.count = 0
        self.released = 0
        self.settings: dict[int, float] = {}
        self.hang = threading.Event()
        self.hang.set()

    def isOpened(self) -> bool:
        return self.there

    def read(self) -> tuple[bool, NDArray[np.uint8] | None]:
        time.sleep(self.gap_s)
        self.hang.wait()
        if not self.there or self.count == self.lasts:
            return False, None
        self.count += 1
        image = np.full((48, 64, 3), self.count % 60 * 4, np.uint8)
        image[..., 0] = 7  # blue
        return True, image

    def set(self, prop: int, value: float) -> bool:
        self.settings[prop] = value
        return True

    def get(self, prop: int, /) -> float:
        return self.settings.get(prop, 0.0)

    def release(self) -> None:
        self.released += 1


@pytest.fixture(autouse=True)
def quick_back_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_module, "FIRST_WAIT_S", 0.02)
    monkeypatch.setattr(live_module, "LONGEST_WAIT_S", 0.1)


def test_a_slow_reader_gets_the_newest_picture_and_the_rest_is_counted() -> None:
    camera = Webcam()
    with open_source("webcam://0", capture=lambda device: camera) as source:
        seen = []
        for frame in itertools.islice(source, 5):
            seen.append((camera.count, int(frame.image[0, 0, 1]) // 4, frame.stamp_s))
            assert frame.image[0, 0, 0] == frame.image[0, 0, 1] and frame.image[0, 0, 2] == 7
            time.sleep(0.1)
        # one may be on its way from the camera, and one lie ready
        assert source.live and 0 <= camera.count - len(seen) - source.skipped <= 2
        assert source.skipped > 0
    assert all(newest - got <= 2 for newest, got, _ in seen)
    assert all(b > a for (_, _, a), (_, _, b) in itertools.pairwise(seen))
    assert camera.released == 1
    assert source.read() is None and list(source) == []


def test_a_webcams_size_is_asked_for_and_its_device_named() -> None:
    import cv2

    devices: list[object] = []
    camera = Webcam()

    def reader(device: object) -> Webcam:
        devices.append(device)
        return camera

    with open_source("webcam:///dev/video2?width=800&height=600&fps=15", capture=reader) as source:
        assert next(source).image.shape == (48, 64, 3)  # what the camera gives counts
    assert devices == ["/dev/video2"]
    assert camera.settings[cv2.CAP_PROP_FRAME_WIDTH] == 800
    assert camera.settings[cv2.CAP_PROP_FPS] == 15


def test_no_camera_is_said_at_once() -> None:
    camera = Webcam(there=False)
    with pytest.raises(SourceLost, match="webcam://0 cannot be opened: expected a camera"):
        open_source("webcam://0", capture=lambda device: camera)
    assert camera.released == 1


def test_unplugged_and_back() -> None:
    cameras = [Webcam(lasts=5), Webcam(there=False), Webcam(there=False), Webcam()]
    made = iter(cameras)
    lines: list[str] = []
    with open_source("webcam://0", capture=lambda device: next(made)) as source:
        source.notice = lines.append
        wait_until(lambda: cameras[3].count > 3)
        assert source.problem is None
        assert next(source).image.shape == (48, 64, 3)
    assert source.reconnects == 1
    assert [camera.released for camera in cameras] == [1, 1, 1, 1]
    assert len(lines) == 2 and "lost: no image arrives" in lines[0] and "is back" in lines[1]


def test_gone_for_good_ends_with_one_line() -> None:
    cameras = itertools.chain([Webcam(lasts=3)], (Webcam(there=False) for _ in itertools.count()))
    with open_source("webcam://0", capture=lambda device: next(cameras), patience_s=0.3) as source:
        start = time.monotonic()
        with pytest.raises(SourceLost, match=r"webcam://0 sent no image for 0\.3 s"):
            list(source)
        assert time.monotonic() - start < 2
        assert source.ended and source.read() is None


def test_a_driver_that_hangs_is_noticed_and_does_not_block_the_close() -> None:
    camera = Webcam()
    source = open_source("webcam://0", capture=lambda d: camera, patience_s=0.4, stall_s=0.2)
    assert next(source) is not None
    camera.hang.clear()
    wait_until(lambda: source.read(0.05) is None)
    wait_until(lambda: source.read(0.05) is None and source.problem is not None)
    with pytest.raises(SourceLost, match="no image arrives"):
        list(source)
    start = time.monotonic()
    source.close()
    assert time.monotonic() - start < 3
    camera.hang.set()
    wait_until(lambda: camera.released)


def test_a_picture_that_a_decoder_held_back_is_not_taken_for_new(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("doorway3ds.sources.capture._STALL_S", 0.3)
    late = Webcam(gap_s=0.0)
    capture = OpenCvCapture(late, "a camera")
    late.gap_s = 0.4
    assert capture.read() is not None  # a camera may take its time to begin
    with pytest.raises(UserError, match="no image for"):
        capture.read()


def test_a_connection_that_breaks_at_once_is_not_hammered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_module, "LONGEST_WAIT_S", 10.0)
    tries: list[float] = []

    def connect(device: object) -> Webcam:
        tries.append(time.monotonic())
        return Webcam(lasts=0)

    with open_source("webcam://0", capture=connect) as source:
        assert source.read(0.8) is None
    assert 4 <= len(tries) <= 7
    waits = np.diff(tries)
    assert waits[-1] > 4 * waits[0]


def test_a_device_that_says_where_it_looks() -> None:
    class Robot:
        def read(self) -> Shot:
            time.sleep(0.01)
            return Shot(np.zeros((48, 64, 3), np.uint8), time.monotonic(), pose=Pose(yaw_deg=5))

        def close(self) -> None:
            pass

    with LiveSource("robot", Robot) as source:
        assert next(source).pose.yaw_deg == 5
    with LiveSource("robot", Robot, View(pose=Pose(yaw_deg=1))) as source:
        assert next(source).pose.yaw_deg == 1


def test_a_bug_in_a_device_reaches_the_reader() -> None:
    class Broken:
        def read(self) -> Shot:
            raise ZeroDivisionError

        def close(self) -> None:
            pass

    with LiveSource("robot", Broken) as source, pytest.raises(ZeroDivisionError):
        next(source)


@pytest.mark.parametrize("lengths", [True, False])
def test_mjpeg(lengths: bool) -> None:
    with MjpegServer() as server:
        server.lengths = lengths
        with open_source(server.url) as source:
            seen = [number(frame.image) for frame in itertools.islice(source, 5)]
    assert seen == sorted(seen) and len(set(seen)) == 5


def test_mjpeg_behind_a_password_and_a_redirect_shows_neither() -> None:
    with MjpegServer() as server:
        server.account = "Basic " + base64.b64encode(b"me:s p").decode()
        url = server.url.replace("127.0.0.1", "me:s%20p@127.0.0.1")
        with open_source(url) as source:
            assert next(source) is not None
            assert source.name == server.url.replace("127.0.0.1", "me:***@127.0.0.1")
        with pytest.raises(SourceLost, match="401") as caught:
            open_source(url.replace("s%20p", "secret"))
        assert "secret" not in str(caught.value)
        server.account = None
        with open_source(f"http://127.0.0.1:{server.port}/moved") as source:
            assert next(source) is not None


def test_mjpeg_stalls_and_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("doorway3ds.sources.mjpeg._TIMEOUT_S", 0.3)
    with MjpegServer() as server, open_source(server.url) as source:
        assert next(source) is not None
        server.stalled = True
        wait_until(lambda: server.connections > 1)
        assert source.problem is not None
        server.stalled = False
        before = time.monotonic()
        frame = next(source)
        while frame.stamp_s < before:
            frame = next(source)
        assert source.reconnects >= 1 and source.problem is None


def test_mjpeg_server_restarts() -> None:
    first = MjpegServer()
    with open_source(first.url) as source:
        assert next(source) is not None
        first.stop()
        wait_until(lambda: source.problem is not None)
        with MjpegServer(first.port):
            before = time.monotonic()
            wait_until(lambda: next(source).stamp_s > before)
        assert source.reconnects == 1


def test_mjpeg_that_ends_after_each_few_pictures_goes_on() -> None:
    with MjpegServer() as server:
        server.after = 3
        with open_source(server.url) as source:
            assert len(list(itertools.islice(source, 10))) == 10
        assert source.reconnects >= 2


def test_mjpeg_pictures_that_are_damaged_are_left_out() -> None:
    with MjpegServer() as server, open_source(server.url) as source:
        assert next(source) is not None
        server.damage = True
        source.read(0.3)
        assert source.read(0.3) is None and source.damaged > 2
        server.damage = False
        assert next(source) is not None


def test_a_stream_of_damaged_pictures_is_lost_once_patience_ends() -> None:
    with MjpegServer() as server, open_source(server.url, patience_s=0.5) as source:
        notices: list[str] = []
        source.notice = notices.append
        assert next(source) is not None
        server.damage = True
        with pytest.raises(SourceLost, match=r"sent no image for 0\.5 s: an image of .* has no"):
            for _ in source:
                pass
    assert source.damaged > 5 and sum("left out" in line for line in notices) == 1


@pytest.mark.parametrize("kind", [None, "application/octet-stream", "multipart/x-mixed-replace"])
@pytest.mark.parametrize("end", [True, False])
def test_mjpeg_of_any_type_with_and_without_end_markers(kind: str | None, end: bool) -> None:
    with MjpegServer() as server:
        server.kind, server.end = kind, end
        with open_source(server.url) as source:
            seen = [number(frame.image) for frame in itertools.islice(source, 5)]
            assert source.damaged == 0
    assert seen == sorted(seen) and len(set(seen)) == 5


def test_mjpeg_behind_a_digest_login_and_a_redirect_on_its_host() -> None:
    with MjpegServer() as server:
        server.digest = True
        url = f"http://me:pass@127.0.0.1:{server.port}/moved"
        with open_source(url) as source:
            assert next(source) is not None
        server.account = "Basic " + base64.b64encode(b"me:pass").decode()
        server.digest = False
        with open_source(url) as source:
            assert next(source) is not None


def test_mjpeg_that_never_brings_a_picture_says_so_to_the_second() -> None:
    with MjpegServer() as server:
        server.after = 0
        start = time.monotonic()
        with (
            open_source(server.url, patience_s=1.0) as source,
            pytest.raises(SourceLost, match=r"for 1 s: the server ends the stream before any"),
        ):
            next(source)
        assert 0.9 < time.monotonic() - start < 4


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"refuse": True}, "503"),
        ({"kind": "text/html"}, "it sends text/html; expected multipart"),
    ],
)
def test_an_address_without_mjpeg_says_what_came(change: dict[str, object], expected: str) -> None:
    with MjpegServer() as server:
        for name, value in change.items():
            setattr(server, name, value)
        with pytest.raises(SourceLost, match=expected):
            open_source(server.url)


def test_nobody_there_is_one_line() -> None:
    server = MjpegServer()
    server.stop()
    for uri in (server.url, f"rtsp://127.0.0.1:{server.port}/stream"):
        with pytest.raises(UserError) as caught:
            open_source(uri)
        assert str(caught.value).startswith(f"{uri} cannot be opened: ")
        assert "\n" not in str(caught.value)


def test_a_connection_that_ends_with_a_redirect_is_made_anew() -> None:
    """As cameras do it: the redirect, then a reset, and never a word of `Connection: close`."""
    moved = b"HTTP/1.1 301 Moved\r\nLocation: /stream/\r\nContent-Length: 0\r\n\r\n"
    stream = b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=b\r\n\r\n"
    image = encode(scene())
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            first, _ = server.accept()
            first.recv(4096)
            first.sendall(moved)
            first.recv(1)  # of the next request, which is then reset
            first.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            first.close()
            again, _ = server.accept()
            with again:
                for answer in (moved, stream + b"--b\r\n\r\n" + image + b"\r\n--b\r\n"):
                    again.recv(4096)
                    again.sendall(answer)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        url = f"http://127.0.0.1:{server.getsockname()[1]}/stream"
        with open_source(url, patience_s=5) as source:
            frame = source.read(10)
            assert frame is not None and frame.image.shape == scene().shape
        thread.join(10)
