"""Kind, size and EXIF of a picture from its first bytes, before anything is decoded.

Decoders allocate what a header promises and fill up what a cut file lacks, so the pixel limit
and the test for a whole file come first, here, and by the formats' own rules.
"""

from __future__ import annotations

import contextlib
import re
import struct
import zlib
from dataclasses import dataclass

from doorway3ds.errors import UserError

KINDS = ("JPEG", "PNG", "WebP", "TIFF", "BMP", "PNM")

# Formats that people do send, and which OpenCV does not read in every build.
_FOREIGN = (
    (0, b"GIF8", "a GIF"),
    (4, b"ftypheic", "a HEIC"),
    (4, b"ftypheix", "a HEIC"),
    (4, b"ftypmif1", "a HEIF"),
    (4, b"ftypavif", "an AVIF"),
    (4, b"ftyp", "a video"),
    (0, b"\x1aE\xdf\xa3", "a video"),
    (0, b"%PDF", "a PDF"),
    (0, b"8BPS", "a Photoshop"),
    (0, b"\xff\x0a", "a JPEG XL"),
    (0, b"\x00\x00\x00\x0cJXL ", "a JPEG XL"),
    (0, b"\x00\x00\x00\x0cjP  ", "a JPEG 2000"),
    (0, b"II\x2b\x00", "a BigTIFF"),
    (0, b"MM\x00\x2b", "a BigTIFF"),
)


class HeaderError(UserError):
    """The bytes are no whole picture; the message goes on after "NAME: "."""


@dataclass(frozen=True)
class Header:
    """What a picture file says of itself.

    width, height: as stored, before `orientation` (EXIF 1..8) turns the picture.
    focal_35mm: EXIF FocalLengthIn35mmFilm in millimetres, None where absent or 0.
    orientation_at: byte offset of the orientation value in a TIFF file, else None.
    """

    kind: str
    width: int
    height: int
    orientation: int = 1
    focal_35mm: float | None = None
    orientation_at: int | None = None


def read_header(data: bytes) -> Header:
    """Header of a JPEG, PNG, WebP, TIFF, BMP or PNM file held in `data`.

    Raises HeaderError where `data` is none of these, or ends before the picture does.
    """
    if not data:
        raise HeaderError("is empty (0 bytes); expected a picture")
    for matches, parse in (
        (data.startswith(b"\xff\xd8"), _jpeg),
        (data.startswith(b"\x89PNG\r\n\x1a\n"), _png),
        (data.startswith(b"RIFF") and data[8:12] == b"WEBP", _webp),
        (data.startswith((b"II\x2a\x00", b"MM\x00\x2a")), _tiff),
        (data.startswith(b"BM"), _bmp),
        (re.match(rb"P[1-6][\s#]", data) is not None, _pnm),
    ):
        if matches:
            try:
                return parse(data)
            except (struct.error, IndexError) as error:
                raise HeaderError(
                    "is truncated: the file ends inside its header; copy it again"
                ) from error
    for offset, magic, name in _FOREIGN:
        if data.startswith(magic, offset):
            raise HeaderError(
                f"is {name} file; save it as JPEG or PNG ({', '.join(KINDS)} are read)"
            )
    raise HeaderError(f"is not an image; expected one of {', '.join(KINDS)}")


def _truncated(kind: str) -> HeaderError:
    return HeaderError(f"is truncated: the {kind} ends before its picture does; copy it again")


def _damaged(kind: str, what: str) -> HeaderError:
    return HeaderError(f"is damaged: {what} in the {kind}; copy it again")


def _jpeg(data: bytes) -> Header:
    position = 2
    size: tuple[int, int] | None = None
    exif = b""
    while True:
        position = data.find(b"\xff", position)
        if position < 0:
            raise _truncated("JPEG")
        while data[position] == 0xFF:
            position += 1
        marker = data[position]
        position += 1
        if marker == 0x00 or marker == 0x01 or 0xD0 <= marker <= 0xD8:
            continue
        if marker == 0xD9:
            raise _damaged("JPEG", "no picture data")
        (length,) = struct.unpack_from(">H", data, position)
        if length < 2:
            raise _damaged("JPEG", "a segment of no length")
        if position + length > len(data):
            raise _truncated("JPEG")
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            if size is not None:
                raise _damaged("JPEG", "two frame headers")
            height, width = struct.unpack_from(">HH", data, position + 3)
            size = (width, height)
        elif marker == 0xE1 and data.startswith(b"Exif\0\0", position + 2):
            exif = exif or data[position + 8 : position + length]
        elif marker == 0xDA:
            break
        position += length
    if size is None:
        raise _damaged("JPEG", "no frame header")
    # The entropy-coded data cannot hold ff d9 by accident: ff is always followed by 00 there.
    if data.find(b"\xff\xd9", position) < 0:
        raise _truncated("JPEG")
    return Header("JPEG", *size, *_exif(exif))


def _png(data: bytes) -> Header:
    position = 8
    size: tuple[int, int] | None = None
    exif = b""
    while True:
        if position + 12 > len(data):
            raise _truncated("PNG")
        length, kind = struct.unpack_from(">I4s", data, position)
        end = position + 12 + length
        if end > len(data):
            raise _truncated("PNG")
        body = memoryview(data)[position + 4 : end - 4]
        critical = not kind[0] & 0x20
        if critical and zlib.crc32(body) != struct.unpack_from(">I", data, end - 4)[0]:
            raise _damaged("PNG", f"a wrong checksum of chunk {kind.decode('latin-1')!r}")
        if size is None:
            if kind != b"IHDR" or length != 13:
                raise _damaged("PNG", "no header chunk")
            width, height = struct.unpack_from(">II", data, position + 8)
            size = (width, height)
        elif kind == b"eXIf":
            exif = bytes(body[4:])
        elif kind == b"IEND":
            return Header("PNG", *size, *_exif(exif))
        position = end


def _webp(data: bytes) -> Header:
    end = struct.unpack_from("<I", data, 4)[0] + 8
    if end > len(data):
        raise _truncated("WebP")
    position = 12
    size: tuple[int, int] | None = None
    exif = b""
    while position + 8 <= end:
        kind, length = struct.unpack_from("<4sI", data, position)
        start = position + 8
        if start + length > end:
            raise _truncated("WebP")
        if kind == b"VP8X" and size is None:
            raw = data[start + 4 : start + 10]
            size = (int.from_bytes(raw[:3], "little") + 1, int.from_bytes(raw[3:], "little") + 1)
        elif kind == b"VP8 " and size is None:
            width, height = struct.unpack_from("<HH", data, start + 6)
            size = (width & 0x3FFF, height & 0x3FFF)
        elif kind == b"VP8L" and size is None:
            (bits,) = struct.unpack_from("<I", data, start + 1)
            size = ((bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1)
        elif kind == b"EXIF":
            exif = data[start : start + length].removeprefix(b"Exif\0\0")
        position = start + length + (length & 1)
    if size is None:
        raise _damaged("WebP", "no picture")
    return Header("WebP", *size, *_exif(exif))


def _bmp(data: bytes) -> Header:
    pixels_at, header_size = struct.unpack_from("<II", data, 10)
    if header_size == 12:
        width, height, _, bits = struct.unpack_from("<HHHH", data, 18)
        compression = 0
    else:
        width, height, _, bits, compression = struct.unpack_from("<iiHHI", data, 18)
        height = abs(height)  # negative: rows from the top
    row_bytes = (max(width, 0) * bits + 31) // 32 * 4
    if compression in (0, 3) and pixels_at + row_bytes * height > len(data):
        raise _truncated("BMP")
    return Header("BMP", width, height)


def _pnm(data: bytes) -> Header:
    kind = data[1] - ord("0")
    # Numbers apart by white space or comments: width, height and, but for bitmaps, the maximum.
    count = 2 if kind in (1, 4) else 3
    gap = rb"(?:\s|#[^\n]*\n)+"
    match = re.match(rb"P[1-6]" + (gap + rb"(\d{1,10})") * count + rb"\s", data[:4096])
    if match is None:
        raise _damaged("PNM", "no size")
    numbers = [int(group) for group in match.groups()]
    width, height = numbers[:2]
    if kind == 4:
        need = (width + 7) // 8 * height
    elif kind in (5, 6):
        need = width * height * (3 if kind == 6 else 1) * (2 if numbers[2] > 255 else 1)
    else:
        need = width * height  # plain text: at least a digit each
    if match.end() + need > len(data):
        raise _truncated("PNM")
    return Header("PNM", width, height)


_TIFF_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8}


@dataclass(frozen=True)
class _Entry:
    """One directory entry: its integers and where in the file they start."""

    values: tuple[int, ...]
    at: int


def _directory(data: bytes, order: str, offset: int) -> dict[int, _Entry]:
    """Integer entries (BYTE, SHORT, LONG) of one TIFF directory."""
    entries: dict[int, _Entry] = {}
    (count,) = struct.unpack_from(order + "H", data, offset)
    for index in range(count):
        at = offset + 2 + 12 * index
        tag, kind, length = struct.unpack_from(order + "HHI", data, at)
        size = _TIFF_SIZES.get(kind, 0) * length
        at += 8
        if size > 4:
            (at,) = struct.unpack_from(order + "I", data, at)
        if kind not in (1, 3, 4) or at + size > len(data):
            continue
        code = {1: "B", 3: "H", 4: "I"}[kind]
        if tag in entries and tag in (256, 257):
            raise _damaged("TIFF", "two sizes")
        entries[tag] = _Entry(struct.unpack_from(f"{order}{length}{code}", data, at), at)
    return entries


def _first(entries: dict[int, _Entry], tag: int) -> int | None:
    entry = entries.get(tag)
    return entry.values[0] if entry and entry.values else None


def _exif_values(data: bytes, order: str, entries: dict[int, _Entry]) -> tuple[int, float | None]:
    orientation = _first(entries, 274)
    focal = _first(entries, 41989)
    exif_at = _first(entries, 34665)
    if exif_at is not None:
        # EXIF only helps; a broken block never costs the picture.
        with contextlib.suppress(struct.error):
            focal = _first(_directory(data, order, exif_at), 41989) or focal
    return (
        orientation if orientation is not None and 1 <= orientation <= 8 else 1,
        float(focal) if focal else None,
    )


def _exif(data: bytes) -> tuple[int, float | None]:
    """(orientation, focal_35mm) of an EXIF block; (1, None) where it is absent or broken."""
    order = {b"II": "<", b"MM": ">"}.get(data[:2])
    if order is None:
        return 1, None
    try:
        (offset,) = struct.unpack_from(order + "I", data, 4)
        return _exif_values(data, order, _directory(data, order, offset))
    except (struct.error, HeaderError):
        return 1, None


def _tiff(data: bytes) -> Header:
    order = "<" if data[:1] == b"I" else ">"
    (offset,) = struct.unpack_from(order + "I", data, 4)
    if offset >= len(data):
        raise _truncated("TIFF")
    entries = _directory(data, order, offset)
    width, height = _first(entries, 256), _first(entries, 257)
    if width is None or height is None:
        raise _damaged("TIFF", "no size")
    for offsets, lengths in ((273, 279), (324, 325)):
        if offsets in entries and lengths in entries:
            starts, sizes = entries[offsets].values, entries[lengths].values
            if any(a + b > len(data) for a, b in zip(starts, sizes, strict=False)):
                raise _truncated("TIFF")
    turned = entries.get(274)
    return Header(
        "TIFF",
        width,
        height,
        *_exif_values(data, order, entries),
        orientation_at=turned.at + (order == ">") if turned else None,
    )
