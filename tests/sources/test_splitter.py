from __future__ import annotations

import cv2
import numpy as np
import pytest

from doorway3ds.sources.splitter import Splitter
from tests.factories import encode, scene


def jpegs() -> list[bytes]:
    image = scene()
    noise = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)
    restart = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_RST_INTERVAL, 1])[1].tobytes()
    thumbnail = encode(scene(16, 12))
    return [
        encode(image),
        encode(noise, progressive=True),
        restart,
        encode(image, exif=b"Exif\x00\x00" + thumbnail),
    ]


@pytest.mark.parametrize("size", [1, 7, 1000, 10**6])
def test_pictures_come_out_whole_however_the_stream_is_cut(size: int) -> None:
    pictures = [*jpegs(), encode(scene(), "PNG")]
    between = b"\r\n--frame\r\nContent-Type: image/jpeg\r\n\r\n"
    data = b"".join(between + picture for picture in pictures) + between
    splitter = Splitter()
    found = []
    for start in range(0, len(data), size):
        found += splitter.feed(data[start : start + size])
    assert found == pictures
    assert splitter.rest() == []


def test_a_picture_that_breaks_off_does_not_spoil_the_next() -> None:
    one, other = jpegs()[0], jpegs()[2]
    short = one[:-20]
    assert Splitter().feed(short + other + one) == [short, other, one]


def test_what_is_too_large_is_given_up_and_the_rest_goes_on() -> None:
    splitter = Splitter(largest=4000)
    assert splitter.feed(b"\xff\xd8\xff\xda\x00\x02" + bytes(10_000)) == []
    picture = encode(scene(16, 12))
    assert splitter.feed(picture) == [picture]


def test_the_rest_is_a_picture_cut_short_or_nothing() -> None:
    picture = jpegs()[0]
    splitter = Splitter()
    assert splitter.feed(picture + picture[:200]) == [picture]
    assert splitter.rest() == [picture[:200]]
    assert splitter.rest() == []


def test_noise_never_blocks_and_is_not_kept() -> None:
    rng = np.random.default_rng(4)
    splitter = Splitter(largest=10_000)
    picture = encode(scene(16, 12))
    for _ in range(200):
        splitter.feed(rng.bytes(500) + b"\xff\xd8\xff" + rng.bytes(200))
    assert len(splitter._data) <= 11_000
    # A false start swallows what follows until its size shows that it is none.
    assert picture in [p for _ in range(80) for p in splitter.feed(picture)]
