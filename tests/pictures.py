"""Small picture files for tests, made here."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

FORMATS = ("JPEG", "PNG", "TIFF", "BMP", "WEBP")


def scene(width: int = 64, height: int = 48) -> NDArray[np.uint8]:
    """A grey ramp with a red square in the top-left corner and a blue one at the top right."""
    image = np.empty((height, width, 3), np.uint8)
    image[:] = np.linspace(20, 235, width)[None, :, None]
    image[: height // 3, : width // 4] = (230, 20, 20)
    image[: height // 3, -(width // 4) :] = (20, 20, 230)
    return image


def encode(
    image: NDArray[np.uint8] | Image.Image,
    kind: str = "JPEG",
    *,
    orientation: int | None = None,
    focal_35mm: int | None = None,
    **options: object,
) -> bytes:
    """`image` as a file of `kind` (a Pillow format name), with EXIF where asked for."""
    if not isinstance(image, Image.Image):
        image = Image.fromarray(image)
    exif = Image.Exif()
    if orientation is not None or focal_35mm is not None:
        exif[0x0112] = orientation or 1
        options["exif"] = exif
    if focal_35mm is not None:
        exif.get_ifd(0x8769)[0xA405] = focal_35mm
    if kind == "JPEG":
        options.setdefault("quality", 95)
        options.setdefault("subsampling", 0)
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()
