"""The API's answers as OpenAPI describes them; `Decision.to_dict` makes them."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from doorway3ds.web.base.routes import SourceState
from doorway3ds.web.serve.fields import DecideFields

EXAMPLE: dict[str, Any] = {
    "image": "hall.jpg",
    "method": "opening",
    "network": "doornet",
    "camera": {"name": "nao-v6-top", "assumed": False},
    "p_open": 0.94,
    "open": True,
    "reason": "turn",
    "turn_deg": 12.4,
    "bearing_deg": 12.4,
    "range_m": 2.8,
    "clear": True,
    "floor_from_m": 0.9,
    "look": None,
    "openings": [
        {
            "left_deg": 20.1,
            "right_deg": 4.6,
            "bearing_deg": 12.4,
            "range_m": 2.8,
            "score": 0.91,
            "cut": None,
            "left_px": 98.5,
            "right_px": 277.1,
        }
    ],
    "pixel": [241, 190],
    "timings_ms": {
        "decode": 3.1,
        "prepare": 0.6,
        "network": 8.2,
        "selection": 1.6,
        "decision": 0.01,
    },
}


class CameraAnswer(BaseModel):
    name: str
    assumed: bool = Field(description="Neither given nor calibrated.")


class OpeningAnswer(BaseModel):
    left_deg: float
    right_deg: float
    bearing_deg: float
    range_m: float | None
    score: float
    cut: Literal["left", "right", "both"] | None
    left_px: float = Field(description="Columns of the upright image at its mid-height.")
    right_px: float


class DecisionAnswer(BaseModel):
    """What `3ds look --json` prints; docs/json.md says what each key means."""

    model_config = ConfigDict(json_schema_extra={"examples": [EXAMPLE]})

    image: str | None = Field(description="The image's name as it was given.")
    method: Literal["opening", "paper"]
    network: str
    camera: CameraAnswer
    p_open: float = Field(description="Calibrated probability of an open doorway.")
    open: bool
    reason: Literal["no_door", "blocked", "unsure", "aligned", "turn", "lost"]
    turn_deg: float | None = Field(description="What to turn by, + left; null: do not turn.")
    bearing_deg: float | None
    range_m: float | None
    clear: bool | None
    floor_from_m: float | None
    look: Literal["left", "right"] | None
    openings: list[OpeningAnswer]
    pixel: list[int] | None = Field(description="[row, column] aimed at.")
    timings_ms: dict[str, float]
    max_pixel: list[int] | None = Field(default=None, description="Only with method paper.")
    best_pixel: list[int] | None = Field(default=None, description="Only with method paper.")
    trigger_pixel: list[int] | None = Field(default=None, description="Only with method paper.")
    max_depth: float | None = Field(default=None, description="Only with method paper; 1.0 = 10 m.")
    best_depth: float | None = Field(
        default=None, description="Only with method paper; 1.0 = 10 m."
    )
    view: dict[str, Any] | None = Field(default=None, description="Only if `view` was asked for.")


class FramesAnswer(BaseModel):
    taken: int
    fewest: int = Field(description="From which number on it may be finished.")
    wanted: int


class ZonesAnswer(BaseModel):
    columns: int
    rows: int
    covered: list[int] = Field(description="Zones of the image, row by row from 0.")


class DistancesAnswer(BaseModel):
    spread: float = Field(description="The farthest board's distance over the nearest one's.")
    wanted: float


class CalibratedAnswer(BaseModel):
    rms_px: float = Field(description="Reprojection error over all corners.")
    frames: int
    coverage: float = Field(description="Fraction of the image inside all corners together.")
    doubts: list[str] = Field(description="Why not to rely on it.")
    held_out_px: dict[str, float] = Field(
        description="By lens model, the error in frames that it was not fitted to."
    )
    name: str
    model: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    hfov_deg: float
    vfov_deg: float


class CalibrationAnswer(BaseModel):
    """A guided calibration; with `state` none, nothing but that."""

    state: Literal["none", "taking", "computing", "done", "failed"]
    problem: str | None = Field(default=None, description="Why it failed, or no frame comes.")
    fields: dict[str, Any] = Field(default_factory=dict, description="The board and the name.")
    frame: int | None = Field(default=None, description="The last one looked at.")
    size: list[int] | None = Field(default=None, description="Width and height of the frames.")
    seen: list[list[float]] | None = Field(
        default=None, description="Outline of the board in that frame, [x, y] in pixels."
    )
    verdict: str | None = Field(default=None, description="What became of that frame.")
    next: str | None = Field(default=None, description="What to show next; null: nothing.")
    frames: FramesAnswer | None = None
    zones: ZonesAnswer | None = None
    tilts: dict[str, bool] | None = Field(default=None, description="Which ones were seen.")
    distances: DistancesAnswer | None = None
    result: CalibratedAnswer | None = None


class NetworkAnswer(BaseModel):
    name: str
    methods: list[str]


class PresetAnswer(BaseModel):
    name: str
    hfov_deg: float
    vfov_deg: float


class SourceAnswer(BaseModel):
    name: str
    state: SourceState
    problem: str | None
    warning: str | None = Field(description="Why the camera's focal length is in doubt.")
    frames: int
    skipped: int
    fields: dict[str, Any] = Field(description="Its settings, if they are not the server's.")


class InfoAnswer(BaseModel):
    version: str
    method: str
    network: str
    methods: list[str]
    networks: list[NetworkAnswer]
    cameras: list[PresetAnswer]
    camera_given: bool = Field(description="The server was started with a camera.")
    limits: dict[str, float]
    source: SourceAnswer | None
    calibrating: bool = Field(description="/v1/calibration has something to say.")
    link: str | None = Field(description="Where other devices reach the page, if they can.")


def upload_body() -> dict[str, Any]:
    """`openapi_extra` of the routes that take an image."""
    form = DecideFields.model_json_schema()
    for name, field in form["properties"].items():
        # A form's empty field is text, never null.
        kinds = [kind for kind in field.pop("anyOf", []) if kind.get("type") != "null"]
        if kinds:
            form["properties"][name] = {**field, **kinds[0]}
        form["properties"][name].pop("default", None)
    form["properties"]["image"] = {"type": "string", "format": "binary"}
    form["required"] = ["image"]
    form["title"] = "Image and fields"
    binary = {"schema": {"type": "string", "format": "binary"}}
    kinds_of_file = ("image/jpeg", "image/png", "application/octet-stream")
    content: dict[str, Any] = dict.fromkeys(kinds_of_file, binary)
    content["multipart/form-data"] = {"schema": form}
    return {"requestBody": {"required": True, "content": content}}
