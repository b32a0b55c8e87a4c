"""Every kind of picture decodes to what it shows; everything else is refused in one line."""

from __future__ import annotations

import io
import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from doorway3ds.errors import UserError
from doorway3ds.images.codec import image_size, is_image, read_image, write_image
from tests.factories import FORMATS, encode, scene

RED, BLUE = (230, 20, 20), (20, 20, 230)


def refused(source: bytes | Path, *parts: str, **options: int) -> None:
    """`source` is refused in one line that holds `parts`."""
    with pytest.raises(UserError) as caught:
        read_image(source, **options)
    message = str(caught.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


@pytest.mark.parametrize("kind", [*FORMATS, "PPM"])
def test_formats_decode_to_the_same_picture(kind: str) -> None:
    image = read_image(encode(scene(), kind)).image
    assert image.dtype == np.uint8
    assert image.shape == (48, 64, 3)
    assert np.abs(image.astype(int) - scene()).mean() < 2


@pytest.mark.parametrize(
    ("mode", "kind", "red"),
    [
        ("RGBA", "PNG", RED),
        ("RGBA", "WEBP", RED),
        ("RGBA", "TIFF", RED),
        ("CMYK", "JPEG", RED),  # Adobe's inverted inks
        ("CMYK", "TIFF", RED),
        ("P", "PNG", RED),
        ("L", "JPEG", (83, 83, 83)),  # 0.299 R + 0.587 G + 0.114 B
        ("LA", "PNG", (83, 83, 83)),
        ("L", "BMP", (83, 83, 83)),
    ],
)
def test_channels(mode: str, kind: str, red: tuple[int, int, int]) -> None:
    source = Image.fromarray(scene()).convert(mode, palette=Image.Palette.ADAPTIVE)
    image = read_image(encode(source, kind)).image
    assert image.shape == (48, 64, 3)
    assert np.abs(image[4, 4].astype(int) - red).max() <= 4
    assert image[0, 0].tolist() != image[40, 60].tolist()


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_16_bit_becomes_8(suffix: str, channels: int) -> None:
    deep = np.full((20, 30, channels), 0x40FF, np.uint16)
    deep[:, 15:] = 0xC001
    done, data = cv2.imencode(suffix, deep)
    assert done
    image = read_image(data.tobytes()).image
    assert np.abs(image[5, 5].astype(int) - 0x40).max() <= 1
    assert np.abs(image[5, 25].astype(int) - 0xC0).max() <= 1


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF", "WEBP"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation(kind: str, orientation: int) -> None:
    stored = {
        1: lambda a: a,
        2: np.fliplr,
        3: lambda a: np.rot90(a, 2),
        4: np.flipud,
        5: lambda a: a.swapaxes(0, 1),
        6: lambda a: np.rot90(a, 1),
        7: lambda a: np.rot90(a, 2).swapaxes(0, 1),
        8: lambda a: np.rot90(a, -1),
    }[orientation](scene())
    picture = read_image(encode(np.ascontiguousarray(stored), kind, orientation=orientation))
    assert picture.image.shape == (48, 64, 3)
    assert np.abs(picture.image.astype(int) - scene()).mean() < 2


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "WEBP"])
def test_exif_focal_length(kind: str) -> None:
    assert read_image(encode(scene(), kind, focal_35mm=27)).focal_35mm == 27.0
    turned = read_image(encode(scene(), kind, orientation=6))
    assert (turned.focal_35mm, turned.orientation) == (None, 6)
    assert read_image(encode(scene(), kind, focal_35mm=0)).focal_35mm is None


@pytest.mark.parametrize("size", [(1, 1), (1, 700), (700, 1), (3, 5), (1921, 1081)])
def test_any_size(size: tuple[int, int]) -> None:
    width, height = size
    image = read_image(encode(np.zeros((height, width, 3), np.uint8), "PNG")).image
    assert image.shape == (height, width, 3)


def test_reads_paths_and_names_them(tmp_path: Path) -> None:
    path = tmp_path / "photo.jpg"
    path.write_bytes(encode(scene()))
    assert read_image(path).image.shape == (48, 64, 3)
    assert read_image(str(path)).image.shape == (48, 64, 3)
    refused(tmp_path / "none.jpg", "none.jpg does not exist")
    refused(tmp_path, "is a folder")
    (tmp_path / "empty.jpg").touch()
    refused(tmp_path / "empty.jpg", "empty.jpg is empty (0 bytes)")
    refused(Path("/dev/zero"), "is a device")


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root reads every file")
def test_unreadable(tmp_path: Path) -> None:
    path = tmp_path / "photo.jpg"
    path.write_bytes(encode(scene()))
    path.chmod(0)
    refused(path, "cannot be read: Permission denied")


@pytest.mark.parametrize(
    ("data", "part"),
    [
        (b"hello, this is text", "is not an image"),
        (b"GIF89a" + bytes(20), "is a GIF file; save it as"),
        (b"\0\0\0\x18ftypisom" + bytes(20), "is a video file; save it as"),
        (b"BM" + bytes(100), "cannot be decoded"),
        (b"P5 0 4 255\n", "has no pixels"),
        (b"\xff\xd8\xff\xd9", "has no pixels"),
        (b"\xff\xd8", "is not an image"),
    ],
)
def test_not_a_picture(data: bytes, part: str) -> None:
    refused(data, f"image {part}")


@pytest.mark.parametrize("kind", [*FORMATS, "PPM"])
def test_every_truncation_is_refused(kind: str) -> None:
    data = encode(scene(), kind)
    # A WebP's last chunk may be padded, and a TIFF may end in bytes that nothing points to.
    for length in range(0, len(data) - 1, max(1, len(data) // 97)):
        refused(data[:length])
    refused(data[: len(data) // 2], "is truncated")


@pytest.mark.parametrize("progressive", [False, True])
def test_a_jpeg_whose_decoder_makes_up_the_rest_is_refused(progressive: bool) -> None:
    data = encode(scene(640, 480), "JPEG", progressive=progressive)
    scan = data.index(b"\xff\xda") + 14
    for start in range(scan, len(data) - 400, len(data) // 7):
        lost = data[:start] + data[start + 300 :]
        refused(lost, "is damaged (")
    # Bytes between image and end marker that webcams add cost nothing.
    assert read_image(data[:-2] + b"\0\0" + data[-2:]).image.shape == (480, 640, 3)


def test_a_changed_png_is_refused_by_its_checksums() -> None:
    data = bytearray(encode(scene(), "PNG"))
    data[len(data) // 2] ^= 0x10
    refused(bytes(data), "is damaged (", "checksum")


def _png_of(width: int, height: int) -> bytes:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        )

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = zlib.compress(bytes(100))
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")
    )


def _sized(kind: str, width: int, height: int) -> bytes:
    """A small file whose header promises width x height pixels."""
    if kind == "PNG":
        return _png_of(width, height)
    data = bytearray(encode(scene(), kind))
    if kind == "JPEG":
        at = data.index(b"\xff\xc0") + 5
        data[at : at + 4] = struct.pack(">HH", height, width)
    elif kind == "BMP":
        data[18:26] = struct.pack("<ii", width, height)
        data[30:34] = struct.pack("<I", 1)  # run-length coded, so that a small file may be large
    elif kind == "WEBP":
        at = data.index(b"VP8 ") + 14
        data[at : at + 4] = struct.pack("<HH", width, height)
    return bytes(data)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "BMP", "WEBP"])
def test_bombs_are_refused_by_their_header(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def decoder(*_: object, **__: object) -> None:
        raise AssertionError("the decoder was reached")

    monkeypatch.setattr("simplejpeg.decode_jpeg", decoder)
    monkeypatch.setattr("PIL.ImageFile.ImageFile.load", decoder)
    says = "256000000 pixels" if kind == "WEBP" else "16000x16000 pixels, at most 120 million"
    refused(_sized(kind, 16000, 16000), "is too large", says)


def test_zero_sized_by_header() -> None:
    refused(_sized("PNG", 0, 480), "has no pixels")
    refused(_sized("JPEG", 640, 0), "has no pixels")


def test_the_pixel_limit_is_a_parameter() -> None:
    refused(encode(scene()), "at most 0.003 million", max_pixels=3000)
    assert read_image(encode(scene()), max_pixels=64 * 48).image.shape == (48, 64, 3)


@pytest.mark.parametrize("orientation", [1, 3, 6])
def test_phones_formats_are_read_whole_and_upright(orientation: int) -> None:
    heif = pytest.importorskip("pillow_heif")
    stored = {1: scene(), 3: np.rot90(scene(), 2), 6: np.rot90(scene(), 1)}[orientation]
    stored = np.ascontiguousarray(stored)
    exif = Image.Exif()
    exif[0x0112] = orientation
    heic, avif = io.BytesIO(), io.BytesIO()
    file = heif.from_pillow(Image.fromarray(stored))
    file.save(heic, quality=95, exif=exif.tobytes())
    Image.fromarray(stored).save(avif, "AVIF", quality=95, exif=exif.tobytes())
    for data in (heic.getvalue(), avif.getvalue()):
        picture = read_image(data)
        assert picture.image.shape == (48, 64, 3)
        assert np.abs(picture.image.astype(int) - scene()).mean() < 6
        assert picture.orientation == orientation
        refused(data[: len(data) * 2 // 3])


def test_heic_without_its_reader_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ModuleNotFoundError(name=name)

    monkeypatch.setattr("doorway3ds.images.decode.import_module", missing)
    refused(b"\0\0\0\x18ftypheic" + bytes(20), "is a HEIC file", "doorway3ds[heic]")


def test_size_and_kind_are_known_without_decoding(tmp_path: Path) -> None:
    path = tmp_path / "no-suffix"
    path.write_bytes(encode(scene(), "JPEG", orientation=6))
    assert (image_size(path), is_image(path)) == ((48, 64), True)
    path.write_bytes(b"\0\0\0\x18ftypisom" + bytes(40))
    assert not is_image(path)
    with pytest.raises(UserError, match="no-suffix is a video file"):
        image_size(path)


def test_float_tiff_is_refused() -> None:
    buffer = io.BytesIO()
    Image.fromarray(np.ones((8, 8), np.float32)).save(buffer, "TIFF")
    refused(buffer.getvalue(), "cannot be decoded", "save it again as an 8-bit JPEG or PNG")


@given(
    image=arrays(np.uint8, st.tuples(st.integers(1, 40), st.integers(1, 40), st.just(3))),
    kind=st.sampled_from(["PNG", "TIFF", "BMP", "PPM"]),
    orientation=st.integers(1, 8),
)
def test_lossless_formats_come_back_exactly(image: np.ndarray, kind: str, orientation: int) -> None:
    exif = {} if kind in ("BMP", "PPM") else {"orientation": orientation}
    decoded = read_image(encode(image, kind, **exif)).image
    turned = exif.get("orientation", 1) >= 5
    assert decoded.shape == ((image.shape[1], image.shape[0], 3) if turned else image.shape)
    assert np.array_equal(np.sort(decoded.reshape(-1)), np.sort(image.reshape(-1)))
    if exif.get("orientation", 1) == 1:
        assert np.array_equal(decoded, image)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_write_image_is_whole_and_leaves_nothing_else(tmp_path: Path, suffix: str) -> None:
    path = write_image(tmp_path / "new" / f"out{suffix}", scene())
    assert np.abs(read_image(path).image.astype(int) - scene()).mean() < 2
    assert [p.name for p in path.parent.iterdir()] == [f"out{suffix}"]


def test_write_image_keeps_the_old_file_when_the_new_one_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_image(tmp_path / "out.png", scene())
    before = path.read_bytes()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(UserError, match=r"cannot write .*out.png: No space left on device"):
        write_image(path, 255 - scene())
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["out.png"]


def test_write_image_names_what_it_can_write(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"expected \.jpg or \.png, got \.gif"):
        write_image(tmp_path / "out.gif", scene())
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match="cannot write"):
        write_image(tmp_path / "file" / "out.png", scene())
