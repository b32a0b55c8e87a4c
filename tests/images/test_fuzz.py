"""Damaged image files end as a picture or as one line, in time: no traceback, no hang."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from doorway3ds.errors import UserError
from doorway3ds.images.codec import read_image
from tests.conftest import Cli
from tests.factories import encode, scene

NET = ("--network", "net.onnx")
LIMIT_S = 2.0
MAX_PIXELS = 4_000_000


def originals() -> dict[str, bytes]:
    """Whole files of each format and its variants."""
    image = scene(48, 36)
    grey = Image.fromarray(image).convert("L")
    return {
        "jpeg": encode(image, "JPEG"),
        "jpeg progressive": encode(image, "JPEG", progressive=True),
        "jpeg exif": encode(image, "JPEG", orientation=6, focal_35mm=27),
        "jpeg cmyk": encode(Image.fromarray(image).convert("CMYK"), "JPEG"),
        "jpeg grey": encode(grey, "JPEG"),
        "png": encode(image, "PNG"),
        "png palette": encode(Image.fromarray(image).convert("P"), "PNG"),
        "png exif": encode(image, "PNG", orientation=3, focal_35mm=35),
        "png 16 bit": encode(Image.fromarray(image[..., 0].astype(np.uint16) * 257), "PNG"),
        "tiff": encode(image, "TIFF", orientation=8),
        "tiff lzw": encode(image, "TIFF", compression="tiff_lzw"),
        "tiff deflate": encode(image, "TIFF", compression="tiff_adobe_deflate"),
        "tiff jpeg": encode(image, "TIFF", compression="jpeg"),
        "bmp": encode(image, "BMP"),
        "bmp palette": encode(grey, "BMP"),
        "webp": encode(image, "WEBP"),
        "webp lossless": encode(image, "WEBP", lossless=True),
        "webp exif": encode(image, "WEBP", orientation=5, focal_35mm=20),
        "ppm": encode(image, "PPM"),
    }


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """`data` after one to three random injuries."""
    bad = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        # Headers are where the lies that matter sit, so half of the injuries go there.
        reach = len(bad) if rng.random() < 0.5 else min(len(bad), 64)
        at = int(rng.integers(0, max(reach, 1)))
        length = int(rng.integers(1, 9))
        injury = rng.integers(0, 6)
        if injury == 0:
            bad = bad[:at]
        elif injury == 1:
            bad[at : at + length] = rng.bytes(length)
        elif injury == 2:
            bad[at : at + length] = bytes(rng.choice([0x00, 0x7F, 0x80, 0xFF], length).tolist())
        elif injury == 3:
            del bad[at : at + length]
        elif injury == 4:
            bad[at:at] = rng.bytes(length)
        else:
            start = int(rng.integers(0, max(len(bad), 1)))
            bad[at:at] = bad[start : start + 40]
    return _with_checksums(bytes(bad)) if rng.random() < 0.7 else bytes(bad)


def _with_checksums(data: bytes) -> bytes:
    """A damaged PNG with right checksums, so that the damage reaches the decoder."""
    if not data.startswith(b"\x89PNG\r\n\x1a\n"):
        return data
    fixed = bytearray(data)
    position = 8
    while position + 12 <= len(fixed):
        (length,) = struct.unpack_from(">I", fixed, position)
        end = position + 12 + length
        if end > len(fixed):
            break
        struct.pack_into(">I", fixed, end - 4, zlib.crc32(fixed[position + 4 : end - 4]))
        position = end
    return bytes(fixed)


def cases(per_file: int, seed: int) -> Iterator[tuple[str, bytes]]:
    rng = np.random.default_rng(seed)
    for name, data in originals().items():
        for number in range(per_file):
            yield f"{name} {number}", damaged(data, rng)


def check(name: str, data: bytes) -> bool:
    """Reads `data`; whether it came out as a picture."""
    start = time.perf_counter()
    try:
        image = read_image(data, name=name, max_pixels=MAX_PIXELS).image
    except UserError as error:
        assert str(error).startswith(name)
        assert "\n" not in str(error)
        return False
    finally:
        assert time.perf_counter() - start < LIMIT_S, name
    assert image.dtype == np.uint8
    assert image.ndim == 3
    assert 0 < image.size <= MAX_PIXELS * 3
    return True


def test_whole_files_are_pictures() -> None:
    assert all(check(name, data) for name, data in originals().items())


def test_3800_damaged_files() -> None:
    answered = [check(name, data) for name, data in cases(200, seed=0)]
    assert len(answered) == 3800
    # Both ends are reached: some damage leaves a picture, most does not.
    assert 100 < sum(answered) < 1900


@given(st.binary(max_size=300))
def test_any_bytes(data: bytes) -> None:
    check("bytes", data)


@given(
    st.sampled_from([b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n", b"BM", b"II*\0", b"MM\0*", b"P6 "]),
    st.binary(max_size=300),
)
def test_any_bytes_after_a_magic_number(magic: bytes, rest: bytes) -> None:
    check("bytes", magic + rest)


def test_the_command_answers_or_names_each_damaged_file(cli: Cli, tmp_path: Path) -> None:
    folder = tmp_path / "damaged"
    folder.mkdir()
    for number, (_, data) in enumerate(cases(15, seed=1)):
        (folder / f"{number:03}.jpg").write_bytes(data)
    # A process of its own, as decoders' C code might write past Python's standard error.
    done = subprocess.run(
        [sys.executable, "-m", "doorway3ds.cli.main", "look", folder, "--json", *NET],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 1
    # libtiff writes lines of its own past Python's standard error.
    *errors, summary = [line for line in done.stderr.splitlines() if not _native(line)]
    answered = done.stdout.count("\n")
    assert summary.startswith(f"{answered} of {19 * 15} answered")
    assert all(line.startswith(f"3ds: {folder}{os.sep}") for line in errors)
    assert len(errors) + answered == 19 * 15
    assert sum(" is damaged (Corrupt JPEG data" in line for line in errors) > 0


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "WEBP", "TIFF"])
def test_a_bomb_costs_no_time(kind: str) -> None:
    data = encode(np.zeros((3000, 3000, 3), np.uint8), kind, **_small(kind))
    start = time.perf_counter()
    with pytest.raises(UserError, match="is too large: 3000x3000 pixels, at most 4 million"):
        read_image(data, max_pixels=MAX_PIXELS)
    assert time.perf_counter() - start < 0.1


def _native(line: str) -> bool:
    return line.startswith(("JPEGLib: ", "LZWDecode: ", "ZIPDecode: ", "tempfile.tif: "))


def _small(kind: str) -> dict[str, object]:
    return {"TIFF": {"compression": "tiff_adobe_deflate"}, "WEBP": {"lossless": True}}.get(kind, {})
