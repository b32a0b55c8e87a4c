"""What a depth file does not say of itself: its input, its unit, its focal length.

A preset has it built in (presets.py); anybody's own file has it beside it, under `depth` in
NAME.yaml or NAME.json for NAME.onnx. docs/networks.md lists the fields for people.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from doorway3ds.errors import UserError

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
INVERSE = "1/m"
RELATIVE = "relative"
RELATIVE_INVERSE = "relative-inverse"
UNITS = (*METRES, INVERSE, RELATIVE, RELATIVE_INVERSE)

MAX_ASPECT = 2.0  # a longer image is squeezed: short_side must not make inputs without bound
MAX_SIDE = 4096
MAX_PIXELS = 2048 * 2048

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class DepthSpec:
    """How to feed a depth network and how to read its answer.

    unit: of its output times `factor`: "m", "cm", "mm"; "1/m"; "relative", depth up to an unknown
        scale; "relative-inverse", 1 / depth up to an unknown scale and shift.
    width, height: of the input in pixels, where the file leaves them open.
    short_side, multiple: instead: the image's aspect is kept, its shorter side becomes
        `short_side` pixels, both sides multiples of `multiple`.
    white: value of a white pixel before `mean` is taken off and divided by `std`, by channel.
    channels: "rgb" or "bgr". layout: "nchw" or "nhwc"; None: as the file's shape tells.
    input, output: their names; None: the file's only ones.
    focal_px: focal length in pixels of the input that metres belong to; another camera's are
        longer in proportion to its focal length. None: metres are taken as they come.
    depth_error: relative standard deviation, as `3ds eval depth` measures it.
    """

    unit: str
    factor: float = 1.0
    width: int | None = None
    height: int | None = None
    short_side: int | None = None
    multiple: int = 1
    white: float = 1.0
    mean: Triple = (0.0, 0.0, 0.0)
    std: Triple = (1.0, 1.0, 1.0)
    channels: str = "rgb"
    layout: str | None = None
    input: str | None = None
    output: str | None = None
    focal_px: float | None = None
    depth_error: float = 0.15

    @property
    def relative(self) -> bool:
        return self.unit in (RELATIVE, RELATIVE_INVERSE)

    def size_for(self, width: int, height: int) -> tuple[int, int]:
        """(width, height) of the input for an image of width x height pixels.

        For specs with a size of their own: `width` and `height`, or `short_side`.
        """
        if self.width is not None and self.height is not None:
            return self.width, self.height
        if self.short_side is None:
            raise ValueError("this input's size is the file's own")
        aspect = min(max(width / height, 1 / MAX_ASPECT), MAX_ASPECT)

        def side(ratio: float) -> int:
            return max(1, round((self.short_side or 1) * ratio / self.multiple)) * self.multiple

        return side(max(1.0, aspect)), side(max(1.0, 1 / aspect))


def parse(data: Any, source: Path) -> DepthSpec:
    """The spec that a sidecar's `depth` holds.

    Raises UserError for the first field that is unknown, out of range, or fits no other.
    """

    def wrong(expected: str, got: object) -> UserError:
        return UserError(f"{source}: depth expects {expected}, got {got!r}; see docs/networks.md")

    if not isinstance(data, Mapping):
        raise wrong("a mapping of fields, at least unit", data)
    known = [field.name for field in fields(DepthSpec)]
    for key in data:
        if key not in known:
            raise wrong(f"only the fields {', '.join(known)}", key)
    given: dict[str, Any] = {key: value for key, value in data.items() if value is not None}

    def choice(key: str, options: tuple[str, ...]) -> None:
        if key in given and given[key] not in options:
            raise wrong(f"{key} to be one of {', '.join(options)}", given[key])

    def number(key: str, above: float = 0.0, most: float = math.inf) -> None:
        if key in given:
            if not (_number(given[key]) and above < given[key] <= most):
                limit = "" if math.isinf(most) else f" and at most {most:g}"
                raise wrong(f"{key} to be a number above {above:g}{limit}", given[key])
            given[key] = float(given[key])

    if "unit" not in given:
        raise wrong(f"unit: one of {', '.join(UNITS)}", dict(data))
    choice("unit", UNITS)
    choice("channels", ("rgb", "bgr"))
    choice("layout", ("nchw", "nhwc"))
    for key in ("factor", "white", "focal_px"):
        number(key)
    number("depth_error", most=1.0)
    for key in ("width", "height", "short_side", "multiple"):
        if key in given and not (type(given[key]) is int and 1 <= given[key] <= MAX_SIDE):
            raise wrong(f"{key} to be a whole number from 1 to {MAX_SIDE}", given[key])
    for key in ("mean", "std"):
        if key in given:
            given[key] = _triple(given[key])
            if given[key] is None or (key == "std" and min(given[key]) <= 0):
                positive = " above 0" if key == "std" else ""
                raise wrong(f"{key} to be one number{positive} or three, in RGB", data[key])
    for key in ("input", "output"):
        if key in given and not (isinstance(given[key], str) and given[key]):
            raise wrong(f"{key} to be a name", given[key])

    spec = DepthSpec(**given)
    if (spec.width is None) != (spec.height is None):
        raise wrong("width and height together", given)
    if spec.width is not None and spec.short_side is not None:
        raise wrong("either width and height or short_side", given)
    longest = MAX_ASPECT if spec.short_side else 1.0
    pixels = (spec.width or spec.short_side or 1) * (spec.height or spec.short_side or 1) * longest
    if pixels > MAX_PIXELS:
        raise wrong(f"an input of at most {MAX_PIXELS} pixels", given)
    if spec.relative and spec.focal_px is not None:
        raise wrong(f"no focal_px with unit {spec.unit}, whose scale is unknown", spec.focal_px)
    return spec


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _triple(value: Any) -> Triple | None:
    values = value if isinstance(value, list | tuple) else [value] * 3
    if len(values) != 3 or not all(_number(v) for v in values):
        return None
    red, green, blue = (float(v) for v in values)
    return red, green, blue
