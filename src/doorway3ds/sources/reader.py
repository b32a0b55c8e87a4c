"""What OpenCV's readers of films and streams say of their images, and images made right by it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

_TURNED = {90: 6, 180: 3, 270: 8}  # degrees clockwise -> EXIF orientation
_MOST_STRETCHED = 4.0

# How containers name codecs that not every build of FFmpeg decodes.
_CODECS = (
    (b"av01", "AV1"),
    (b"V_AV1", "AV1"),
    (b"hvc1", "HEVC (H.265)"),
    (b"hev1", "HEVC (H.265)"),
    (b"V_MPEGH/ISO/HEVC", "HEVC (H.265)"),
    (b"vvc1", "VVC (H.266)"),
    (b"apch", "ProRes"),
)


class Properties(Protocol):
    """The part of cv2.VideoCapture that is asked."""

    def get(self, prop: int, /) -> float: ...


def pixel_aspect(reader: Properties) -> float:
    """Width of a pixel over its height, 1 if unknown."""
    across, down = reader.get(cv2.CAP_PROP_SAR_NUM), reader.get(cv2.CAP_PROP_SAR_DEN)
    aspect = across / down if across > 0 and down > 0 else 1.0
    if not (math.isfinite(aspect) and 1 / _MOST_STRETCHED <= aspect <= _MOST_STRETCHED):
        return 1.0
    # Of the stored image; the reader turns the image upright, and its pixels with it.
    return 1 / aspect if orientation(reader) > 4 else aspect


def orientation(reader: Properties) -> int:
    """EXIF 1 to 8 by which the reader turns images upright, from a film's rotation flag."""
    degrees = reader.get(cv2.CAP_PROP_ORIENTATION_META)
    return _TURNED.get(round(degrees) % 360, 1) if math.isfinite(degrees) else 1


def square(image: NDArray[np.uint8], aspect: float) -> NDArray[np.uint8]:
    """The image stretched to square pixels, as players show it; no side becomes smaller."""
    if abs(aspect - 1) < 0.005:
        return image
    height, width = image.shape[:2]
    size = (round(width * aspect), height) if aspect > 1 else (width, round(height / aspect))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8)


def rgb(image: NDArray[Any]) -> NDArray[np.uint8]:
    """(H, W, 3) RGB of what OpenCV reads: BGR or grey."""
    code = cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB
    return np.asarray(cv2.cvtColor(image, code), np.uint8)


def codec_of(path: Path) -> str | None:
    """The codec of a film that could not be decoded, if it is one that FFmpeg may lack."""
    with path.open("rb") as file:
        head = file.read(1 << 20)
        file.seek(max(path.stat().st_size - (1 << 20), 0))
        tail = file.read()
    return next((name for mark, name in _CODECS if mark in head or mark in tail), None)
