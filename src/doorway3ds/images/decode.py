"""The bytes of an image file to pixels, by Pillow and libjpeg-turbo: whole or not at all.

libjpeg fills up what it cannot decode and only remarks on it, so that half an image may be
invented; simplejpeg makes each remark an error. Pillow fills up nothing unless told to.
"""

from __future__ import annotations

import contextlib
import io
import re
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFile, features

from doorway3ds.errors import UserError

KINDS = ("JPEG", "PNG", "WebP", "TIFF", "BMP", "PNM", "AVIF", "HEIC")

_HEIF_BRANDS = rb"....ftyp(hei[cxms]|hev[cx]|mif1)"
# What begins so is read by which plugin of Pillow's, or by that of pillow-heif.
_PLUGINS = (
    (rb"\xff\xd8\xff", "JPEG", "PIL.JpegImagePlugin", "JpegImageFile"),
    (rb"\x89PNG\r\n\x1a\n", "PNG", "PIL.PngImagePlugin", "PngImageFile"),
    (rb"RIFF....WEBP", "WebP", "PIL.WebPImagePlugin", "WebPImageFile"),
    (rb"II\x2a\0|MM\0\x2a", "TIFF", "PIL.TiffImagePlugin", "TiffImageFile"),
    (rb"BM", "BMP", "PIL.BmpImagePlugin", "BmpImageFile"),
    (rb"P[1-6][\s#]", "PNM", "PIL.PpmImagePlugin", "PpmImageFile"),
    (rb"....ftypavif", "AVIF", "PIL.AvifImagePlugin", "AvifImageFile"),
    (_HEIF_BRANDS, "HEIC", "pillow_heif", "HeifImageFile"),
)
# Formats that people do send, and that are not read.
_FOREIGN = (
    (rb"GIF8", "a GIF"),
    (rb"....ftyp|\x1aE\xdf\xa3", "a video"),
    (rb"%PDF", "a PDF"),
    (rb"8BPS", "a Photoshop"),
    (rb"\xff\x0a|\0\0\0\x0cJXL ", "a JPEG XL"),
    (rb"\0\0\0\x0cjP  ", "a JPEG 2000"),
    (rb"II\x2b\0|MM\0\x2b", "a BigTIFF"),
)
_PNG_END = b"IEND\xaeB`\x82"
_ORIENTATION, _EXIF_IFD, _FOCAL_35MM = 0x0112, 0x8769, 0xA405


class DecodeError(UserError):
    """The bytes are no whole image that is read; the message goes on after its name."""


@dataclass(frozen=True)
class Decoded:
    """An image as stored, and what its EXIF says.

    orientation: EXIF 1 to 8, by which `image` is still to be turned; of `stored_orientation` the
        decoder may have taken care already. focal_35mm: millimetres, None if absent or 0.
    """

    image: NDArray[np.uint8]
    orientation: int
    stored_orientation: int
    focal_35mm: float | None


def kind_of(head: bytes) -> str | None:
    """The kind of image, one of KINDS, that a file begins with; None for anything else."""
    return next((p[1] for p in _PLUGINS if re.match(p[0], head, re.DOTALL)), None)


def decode(data: bytes, max_pixels: int) -> Decoded:
    """Decodes one image file of KINDS.

    Raises DecodeError for anything else, an image that is cut, damaged or without pixels, and one
    of more than `max_pixels`, before it is decoded.
    """
    picture, kind = _open(data)
    width, height = picture.size
    _check_size(width, height, max_pixels)
    # TIFF's and HEIC's plugins turn the image themselves, and forget that it was turned.
    stored = picture.info.get("original_orientation") or _exif(picture)[0]
    try:
        image = _pixels_of_jpeg(data) if kind == "JPEG" else _pixels(picture, data)
    except Exception as error:  # decoders raise what they like
        raise _refusal(kind, error) from error
    orientation, focal_35mm = _exif(picture)
    own = kind in ("TIFF", "HEIC")
    return Decoded(image, 1 if own else orientation, stored, focal_35mm)


def size_of(data: bytes) -> tuple[int, int]:
    """Width and height of an image file, upright, by its header. Raises DecodeError as above."""
    picture, kind = _open(data)
    turned = kind not in ("TIFF", "HEIC") and _exif(picture)[0] >= 5
    return picture.size[::-1] if turned else picture.size


def _open(data: bytes) -> tuple[ImageFile.ImageFile, str]:
    """The image with its header read, and its kind."""
    if not data:
        raise DecodeError("is empty (0 bytes); expected an image")
    plugin = next((p for p in _PLUGINS if re.match(p[0], data, re.DOTALL)), None)
    if plugin is None:
        foreign = next((f[1] for f in _FOREIGN if re.match(f[0], data, re.DOTALL)), None)
        read = ", ".join(KINDS)
        if foreign is None:
            raise DecodeError(f"is not an image; expected one of {read}")
        raise DecodeError(f"is {foreign} file; save it as JPEG or PNG ({read} are read)")
    _, kind, module, name = plugin
    if kind == "AVIF" and not features.check("avif"):
        raise DecodeError("is an AVIF file, which this Pillow does not read; save it as JPEG")
    # Neither is missed by its decoder.
    webp_bytes = int.from_bytes(data[4:8], "little") + 8 if kind == "WebP" else 0
    if webp_bytes > len(data) or (kind == "PNG" and _PNG_END not in data):
        raise _truncated(kind)
    try:
        # Not by Image.open, which judges the size by a limit of its own before it can be asked.
        opener = getattr(import_module(module), name)
    except ModuleNotFoundError as error:
        raise DecodeError(
            "is a HEIC file; pip install 'doorway3ds[heic]' to read those, or save it as JPEG"
        ) from error
    try:
        return opener(io.BytesIO(data)), kind
    except Image.DecompressionBombError as error:  # WebP's plugin decodes as it opens
        raise DecodeError(f"is too large ({error}); scale it down") from error
    except Exception as error:
        raise _refusal(kind, error) from error


def _check_size(width: int, height: int, max_pixels: int) -> None:
    if width <= 0 or height <= 0:
        raise DecodeError(f"has no pixels ({width}x{height}); expected at least 1x1")
    if width * height > max_pixels:
        raise DecodeError(
            f"is too large: {width}x{height} pixels, at most {max_pixels / 1e6:g} million are "
            "read; scale it down"
        )


def _truncated(kind: str) -> DecodeError:
    return DecodeError(f"is truncated: the {kind} ends before its image does; copy it again")


def _refusal(kind: str, error: Exception) -> DecodeError:
    """What a decoder's complaint means to who sent the file."""
    said = str(error).partition("\n")[0].strip().rstrip(".") or type(error).__name__
    if re.search(r"(?i)truncat|unexpected end|premature end of jpeg|\beof\b|unpack", said):
        return _truncated(kind)
    if "not identified" in said:  # Pillow's words for a header without a size
        return DecodeError(f"has no pixels by the {kind}'s header; expected at least 1x1")
    if re.search(r"(?i)corrupt|broken|checksum|damaged|invalid|bogus|not a |bad ", said):
        return DecodeError(f"is damaged ({said}); copy it again")
    return DecodeError(
        f"cannot be decoded ({said}): a damaged {kind}, or a variant of it that is not read; save "
        "it again as an 8-bit JPEG or PNG"
    )


def _pixels_of_jpeg(data: bytes) -> NDArray[np.uint8]:
    import simplejpeg

    def strictly(data: bytes) -> NDArray[np.uint8]:
        image: NDArray[np.uint8] = simplejpeg.decode_jpeg(data, colorspace="RGB", strict=True)
        return image

    try:
        return strictly(data)
    except ValueError as error:
        # Webcams put some bytes between image and end marker; without them nothing may be amiss.
        spare = re.search(r"Corrupt JPEG data: (\d{1,2}) extraneous bytes.*0xd9", str(error))
        end = data.rfind(b"\xff\xd9")
        if spare is None or end < 0:
            raise
        return strictly(data[: end - int(spare[1])] + data[end:])


def _pixels(picture: ImageFile.ImageFile, data: bytes) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB: 16 bits a channel become 8, alpha is dropped."""
    if picture.format == "PNG":
        type(picture)(io.BytesIO(data)).verify()  # the checksums, which loading does not look at
    picture.load()
    if picture.mode.startswith("I;16") or (picture.mode == "I" and picture.format == "PPM"):
        grey = (np.asarray(picture).astype(np.uint32) >> 8).astype(np.uint8)
        return np.repeat(grey[..., None], 3, axis=2)
    if picture.mode in ("I", "F"):
        raise ValueError(f"pixels of {'32-bit numbers' if picture.mode == 'I' else 'floats'}")
    return np.asarray(picture.convert("RGB"))


def _exif(picture: Image.Image) -> tuple[int, float | None]:
    """(orientation, focal_35mm); (1, None) if absent or broken, which costs no image."""
    orientation: Any = 1
    focal: Any = None
    with contextlib.suppress(Exception):
        exif = picture.getexif()
        orientation = exif.get(_ORIENTATION, 1)
        focal = exif.get(_FOCAL_35MM)
        focal = exif.get_ifd(_EXIF_IFD).get(_FOCAL_35MM) or focal
    if not isinstance(orientation, int) or not 1 <= orientation <= 8:
        orientation = 1
    return orientation, float(focal) if isinstance(focal, int | float) and focal > 0 else None
