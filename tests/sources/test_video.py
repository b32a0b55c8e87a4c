from __future__ import annotations

import re
import struct
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from doorway3ds.camera.model import Camera
from doorway3ds.errors import UserError
from doorway3ds.sources import SourceLost, clock, open_source
from tests.factories import film, number, patched

KINDS = [("avi", "MJPG"), ("mp4", "mp4v"), ("webm", "VP80")]


@pytest.mark.parametrize(("suffix", "fourcc"), KINDS)
def test_every_frame_with_its_time(tmp_path: Path, suffix: str, fourcc: str) -> None:
    path = film(tmp_path / f"film.{suffix}", 12, 20, fourcc)
    with open_source(str(path)) as source:
        seen = [(number(frame.image), frame.stamp_s) for frame in source]
        assert source.frame_name == f"{path}#12"
    assert [index for index, _ in seen] == pytest.approx(range(12), abs=1)
    assert [stamp for _, stamp in seen] == pytest.approx([i / 20 for i in range(12)], abs=1e-3)
    assert source.skipped == 0 and source.ended and not source.live


def test_colours_are_rgb(tmp_path: Path) -> None:
    import cv2

    path = tmp_path / "red.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    writer.write(np.full((48, 64, 3), (0, 0, 220), np.uint8))
    writer.release()
    (frame,) = open_source(str(path))
    assert frame.image[20, 30, 0] > 200 and frame.image[20, 30, 2] < 30


def test_paced_it_takes_the_films_time_and_skips_what_is_over(tmp_path: Path) -> None:
    path = film(tmp_path / "film.avi", 30, 30)
    start = time.monotonic()
    with open_source(str(path), pace=True) as source:
        stamps = []
        for frame in source:
            stamps.append(frame.stamp_s)
            time.sleep(0.1)
    assert time.monotonic() - start > 0.9
    assert source.skipped + len(stamps) == 30
    assert len(stamps) <= 11 and source.skipped >= 15
    assert stamps[-1] == pytest.approx(29 / 30, abs=0.01)


def test_paced_a_quick_reader_gets_all_and_may_wait_briefly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = 0.0

    class Waits(threading.Event):
        """Time passes in waiting alone, however busy the machine is."""

        def wait(self, timeout: float | None = None) -> bool:
            nonlocal now_s
            now_s += timeout or 0.0
            return self.is_set()

    monkeypatch.setattr(clock, "time", SimpleNamespace(monotonic=lambda: now_s))
    monkeypatch.setattr(clock, "threading", SimpleNamespace(Event=Waits))
    path = film(tmp_path / "film.avi", 6, 10)
    with open_source(str(path), pace=True) as source:
        assert source.read(0.0) is not None
        assert source.read(0.01) is None
        assert now_s == pytest.approx(0.01)
        assert len(list(source)) == 5
    assert now_s == pytest.approx(0.5)
    assert source.skipped == 0


def test_a_damaged_frame_of_motion_jpeg_is_left_out_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20, (160, 120))
    rng = np.random.default_rng(1)
    for _ in range(8):
        writer.write(rng.integers(0, 255, (120, 160, 3), dtype=np.uint8))
    writer.release()
    data = bytearray(path.read_bytes())
    starts = [at.start() for at in re.finditer(b"\xff\xd8\xff", data)]
    middle = (starts[5] + starts[6]) // 2
    data[middle : middle + 30] = b"\xff\x4e" * 15
    path.write_bytes(bytes(data))
    said: list[str] = []
    with open_source(str(path)) as source:
        source.notice = said.append
        stamps = [round(frame.stamp_s * 20) for frame in source]
    assert stamps == [0, 1, 2, 3, 4, 6, 7]
    assert source.damaged == len(said) == 1
    assert said[0].startswith(f"{path}: frame 6 ")


def test_looped_the_stamps_go_on(tmp_path: Path) -> None:
    path = film(tmp_path / "film.avi", 5, 10)
    with open_source(str(path), loop=True) as source:
        stamps = [next(source).stamp_s for _ in range(12)]
    assert np.diff(stamps) == pytest.approx([0.1] * 11, abs=1e-3)


@pytest.mark.parametrize(("suffix", "fourcc"), [("avi", "MJPG"), ("webm", "VP80")])
def test_a_film_cut_short_gives_what_it_has_and_says_so(
    tmp_path: Path, suffix: str, fourcc: str
) -> None:
    path = film(tmp_path / f"film.{suffix}", 40, 20, fourcc, width=160)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    seen = []
    with open_source(str(path)) as source, pytest.raises(SourceLost) as caught:
        for frame in source:
            seen.append(frame.stamp_s)
    assert 10 < len(seen) < 30
    assert f"{len(seen)} of about 40 frames" in str(caught.value)
    assert source.ended and source.read() is None


@pytest.mark.parametrize("paced", [False, True])
def test_a_film_damaged_in_the_middle_never_hangs_or_crashes(tmp_path: Path, paced: bool) -> None:
    rng = np.random.default_rng(7)
    for suffix, fourcc in KINDS:
        path = film(tmp_path / f"film.{suffix}", 30, 100, fourcc, width=160)
        whole = path.read_bytes()
        for _ in range(4):
            data = bytearray(whole)
            start = int(rng.integers(0, len(data)))
            end = min(start + int(rng.integers(1, len(data) // 2)), len(data))
            data[start:end] = rng.bytes(end - start)
            path.write_bytes(bytes(data))
            try:
                with open_source(str(path), pace=paced) as source:
                    frames = sum(1 for _ in source)
                assert frames + source.skipped + source.damaged >= 25
            except UserError as error:
                assert path.name in str(error) and "\n" not in str(error)


def test_a_film_of_variable_rate_is_read_to_its_end_by_its_own_times(tmp_path: Path) -> None:
    path = film(tmp_path / "film.mp4", 40, 20, "mp4v")

    def slower(body: bytes) -> bytes:
        """The last ten frames come ten times as slowly."""
        delta = struct.unpack_from(">I", body, 12)[0]
        return struct.pack(">IIIIII", 0, 2, 30, delta, 10, 10 * delta)

    patched(path, "moov/trak/mdia/minf/stbl/stts", slower)
    path.write_bytes(path.read_bytes().replace(b"edts", b"free"))  # which says its former length
    with open_source(str(path)) as source:
        stamps = [frame.stamp_s for frame in source]
    assert np.diff(stamps) == pytest.approx([0.05] * 30 + [0.5] * 9, abs=2e-3)


class Announced:
    """A film of ten frames, 0.1 s apart, that says of itself what a test wants."""

    def __init__(self, said: dict[int, float]) -> None:
        self.said, self.at = said, 0

    def isOpened(self) -> bool:
        return True

    def get(self, prop: int) -> float:
        return self.at / 10 * 1e3 if prop == cv2.CAP_PROP_POS_MSEC else self.said.get(prop, 0.0)

    def grab(self) -> bool:
        self.at += 1
        return self.at <= 10

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, np.zeros((48, 64, 3), np.uint8)

    def release(self) -> None:
        pass


@pytest.mark.parametrize(
    ("fps", "count", "rate"),
    [
        (1000.0, -9.2e18, 10),  # a browser's recording: ticks of a clock, and no length
        (0.0, 0.0, 10),
        (float("nan"), 1e12, 10),
        (30.0, 30.0, 30),  # length times rate
        (10.0, 10.0, 10),
    ],
)
def test_what_a_film_announces_is_not_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fps: float, count: float, rate: float
) -> None:
    said = {cv2.CAP_PROP_FPS: fps, cv2.CAP_PROP_FRAME_COUNT: count}
    monkeypatch.setattr(cv2, "VideoCapture", lambda *_: Announced(said))
    (tmp_path / "film.webm").touch()
    with open_source(str(tmp_path / "film.webm")) as source:
        assert source.fps == pytest.approx(rate)
        assert len(list(source)) == 10


@pytest.mark.parametrize("turned", [False, True])
def test_pixels_become_square_and_the_camera_turns_with_the_film(
    tmp_path: Path, turned: bool
) -> None:
    path = film(tmp_path / "film.mp4", 3, 20, "mp4v")
    aspect = struct.pack(">I4sII", 16, b"pasp", 2, 1)
    patched(path, "moov/trak/mdia/minf/stbl/stsd/mp4v", lambda body: body + aspect)
    if turned:  # by 180 degrees: a phone held the other way
        matrix = struct.pack(">9i", -1 << 16, 0, 0, 0, -1 << 16, 0, 64 << 16, 48 << 16, 1 << 30)
        patched(path, "moov/trak/tkhd", lambda body: body[:40] + matrix + body[76:])
    for camera in (
        Camera("shown", 128, 48, 56.0, 56.0, 70.5, 22.0),
        Camera("stored", 64, 48, 28.0, 56.0, 35.0, 22.0),
    ):
        with open_source(str(path), camera=camera) as source:
            frame = next(source)
        assert frame.image.shape == (48, 128, 3)
        used = frame.camera
        assert (used.fx, used.fy) == (56, 56)
        assert (used.cx, used.cy) == ((56.5, 25) if turned else (70.5, 22))


def test_a_codec_that_is_not_decoded_is_named(tmp_path: Path) -> None:
    path = film(tmp_path / "film.mp4", 3, 20, "mp4v")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2] + b"stsd....av01")
    with pytest.raises(UserError, match=r"film\.mp4 is AV1, .* ffmpeg -i film\.mp4"):
        open_source(str(path))


@pytest.mark.parametrize("data", [b"", b"no film at all" * 100])
def test_a_file_that_is_no_film_is_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "film.mp4"
    path.write_bytes(data)
    with pytest.raises(UserError, match="cannot be opened as a video"):
        open_source(str(path))


def test_closing_ends_a_wait_and_twice_does_no_harm(tmp_path: Path) -> None:
    import threading

    path = film(tmp_path / "film.avi", 3, 0.2)
    source = open_source(str(path), pace=True)
    assert source.read() is not None
    threading.Timer(0.1, source.close).start()
    start = time.monotonic()
    assert list(source) == []
    assert time.monotonic() - start < 2
    source.close()
