from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from doorway3ds.errors import UserError
from doorway3ds.sources import SourceLost, open_source
from tests.factories import film, number

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


def test_paced_a_quick_reader_gets_all_and_may_wait_briefly(tmp_path: Path) -> None:
    path = film(tmp_path / "film.avi", 6, 10)
    with open_source(str(path), pace=True) as source:
        assert source.read(0.0) is not None
        assert source.read(0.01) is None
        assert len(list(source)) == 5
    assert source.skipped == 0


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
    assert f"{len(seen)} of 40 frames" in str(caught.value)
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
