"""Any image file to (H, W, 3) uint8 RGB, and back to a file."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.errors import UserError
from doorway3ds.files import write_bytes
from doorway3ds.images.decode import DecodeError, decode, kind_of, size_of

MAX_PIXELS = 120_000_000  # the largest phone sensors in use give 108 million
MAX_BYTES = 512 * 1024 * 1024
SUFFIXES = frozenset(
    {".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp", ".ppm", ".pgm", ".pbm", ".pnm"}
    | {".avif", ".heic", ".heif"}
)


@dataclass(frozen=True)
class Picture:
    """A decoded image.

    image: (H, W, 3) uint8 RGB, turned upright as its EXIF orientation says.
    focal_35mm: EXIF focal length as on 35 mm film, in millimetres, or None.
    orientation: EXIF 1 to 8, by which the sensor's image was turned; `Camera.turned` takes it.
    """

    image: NDArray[np.uint8]
    focal_35mm: float | None = None
    orientation: int = 1


def read_image(
    source: str | os.PathLike[str] | bytes,
    *,
    name: str | None = None,
    max_pixels: int = MAX_PIXELS,
) -> Picture:
    """Decodes a JPEG, PNG, WebP, TIFF, BMP, PNM, AVIF or (extra heic) HEIC file.

    Grey becomes three equal channels, an alpha channel is dropped, 16 bits a channel become 8,
    CMYK becomes RGB, EXIF orientation is applied.

    source: path, or the file's bytes.
    name: what error messages call it; default: the path, "image" for bytes.

    Raises UserError, its one line beginning with `name`: missing, unreadable, not an image,
    truncated, damaged (even if a decoder would make up the rest), without pixels, or over
    `max_pixels` by its header, before decoding.
    """
    if isinstance(source, bytes):
        data, name = source, name or "image"
    else:
        name = name or os.fspath(source)
        data = _read_bytes(Path(source), name)
    try:
        decoded = decode(data, max_pixels)
    except DecodeError as error:
        raise UserError(f"{name} {error}") from error
    image = upright(decoded.image, decoded.orientation)
    return Picture(image, decoded.focal_35mm, decoded.stored_orientation)


def image_size(path: str | os.PathLike[str]) -> tuple[int, int]:
    """Width and height of an image file, upright, without decoding it. Raises UserError."""
    name = os.fspath(path)
    try:
        return size_of(_read_bytes(Path(path), name))
    except DecodeError as error:
        raise UserError(f"{name} {error}") from error


def is_image(path: Path) -> bool:
    """Whether a file begins as an image that is read, whatever it is called."""
    try:
        with path.open("rb") as file:
            return kind_of(file.read(32)) is not None
    except OSError:
        return False


def _read_bytes(path: Path, name: str) -> bytes:
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise UserError(f"{name} is a folder; expected an image file")
        if not (stat.S_ISREG(mode) or stat.S_ISFIFO(mode)):
            raise UserError(f"{name} is a device; expected an image file")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError as error:
        raise UserError(f"{name} does not exist; expected an image file") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(f"{name} cannot be read: {reason}") from error
    if len(data) > MAX_BYTES:
        raise UserError(f"{name} is too large: over {MAX_BYTES >> 20} MiB; scale it down")
    return data


def upright(image: NDArray[np.uint8], orientation: int) -> NDArray[np.uint8]:
    """Undoes EXIF orientation 1 to 8 (TIFF 6.0, tag 274)."""
    if orientation in (5, 6, 7, 8):
        image = image.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    return np.ascontiguousarray(image)


def as_stored(picture: Picture) -> NDArray[np.uint8]:
    """The image as the sensor delivered it, before its EXIF orientation turned it upright."""
    return upright(picture.image, {6: 8, 8: 6}.get(picture.orientation, picture.orientation))


def write_image(path: str | os.PathLike[str], image: NDArray[np.uint8], quality: int = 92) -> Path:
    """Writes (H, W, 3) uint8 RGB as the suffix says (.jpg or .png), whole or not at all.

    Raises UserError for another suffix, or where the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".jpg", ".jpeg", ".png"):
        raise UserError(f"cannot write {path}: expected .jpg or .png, got {suffix or 'no suffix'}")
    return write_bytes(path, _encode(suffix, image, quality))


def encode_jpeg(image: NDArray[np.uint8], quality: int = 88) -> bytes:
    """(H, W, 3) uint8 RGB as a JPEG file."""
    return _encode(".jpg", image, quality)


def _encode(suffix: str, image: NDArray[np.uint8], quality: int) -> bytes:
    jpeg = [cv2.IMWRITE_JPEG_QUALITY, quality]
    options = [cv2.IMWRITE_PNG_COMPRESSION, 3] if suffix == ".png" else jpeg
    done, data = cv2.imencode(suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise UserError(f"an image of shape {image.shape} cannot be written as {suffix}")
    return data.tobytes()
