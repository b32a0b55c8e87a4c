"""From a request's fields to the pipeline and the camera that answer it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from doorway3ds.camera.choice import CameraChoice, choose_camera
from doorway3ds.camera.options import CameraOptions
from doorway3ds.camera.presets import PRESETS
from doorway3ds.decide.options import DecideOptions
from doorway3ds.decide.pipeline import NEEDS, Pipeline, build_pipeline
from doorway3ds.errors import CallError
from doorway3ds.images.codec import Picture
from doorway3ds.networks.base import (
    DEPTH,
    RELATIVE,
    Joined,
    Network,
    joint_gives,
    presets_of,
)
from doorway3ds.networks.registry import MODELS, load
from doorway3ds.options import Options, settings_of
from doorway3ds.sources.base import View
from doorway3ds.types import Frame
from doorway3ds.web.base.access import ServerSettings
from doorway3ds.web.base.errors import ApiError

AUTO = "auto"
_DECIDE = ("network", "method", "preset", "width_m", "max_unseen_m", "aligned_deg", "mirror")
_CACHED = 16  # pipelines are small; what is large, the networks, is shared between them

Number = Annotated[float, Field(allow_inf_nan=False)]


def of_option(
    kind: type[Options], name: str, example: Any, default: Any = None, **limits: Any
) -> Any:
    """A field that means what the option of that name does. limits: further ones of the field."""
    known = settings_of(kind)[name]
    return Field(
        default=default,
        ge=known.low,
        le=known.high,
        description=known.help,
        examples=[example],
        **limits,
    )


class Fields(BaseModel):
    """How to decide; each field is optional and has the meaning of the option of `3ds look`."""

    model_config = ConfigDict(extra="forbid")

    method: Literal["opening", "paper"] | None = of_option(DecideOptions, "method", "opening")
    network: str | None = Field(
        default=None,
        max_length=120,
        description="One of `networks` of /v1/info.",
        examples=["doornet"],
    )
    camera: str | None = Field(
        default=None,
        max_length=64,
        description="A preset, or `auto` for the EXIF focal length or 60.9 degrees. "
        "Default: the server's camera. Not together with `fov_deg`.",
        examples=["nao-v6-top"],
    )
    fov_deg: Number | None = of_option(CameraOptions, "fov_deg", 56.3)
    height_m: Number | None = of_option(CameraOptions, "height_m", 0.54)
    pitch_deg: Number | None = of_option(CameraOptions, "pitch_deg", -1.2)
    roll_deg: Number | None = of_option(CameraOptions, "roll_deg", 0.0)
    width_m: Number | None = of_option(DecideOptions, "width_m", 0.28)
    max_unseen_m: Number | None = of_option(DecideOptions, "max_unseen_m", 1.0)
    aligned_deg: Number | None = of_option(DecideOptions, "aligned_deg", 3.0)
    mirror: bool | None = of_option(DecideOptions, "mirror", True)
    preset: str | None = Field(
        default=None,
        max_length=64,
        description="Operating point of the network's file.",
        examples=["cautious"],
    )

    @model_validator(mode="after")
    def _one_field_of_view(self) -> Fields:
        if self.camera is not None and self.fov_deg is not None:
            raise ValueError("camera and fov_deg both set the field of view; give one of them")
        if self.camera is not None and self.camera not in (AUTO, *PRESETS):
            raise ValueError(f"camera must be {AUTO} or one of {', '.join(sorted(PRESETS))}")
        return self


class SourceFields(Fields):
    """Fields of /v1/source, as JSON: a text is no number there, nor is `true`."""

    model_config = ConfigDict(extra="forbid", strict=True)


class DecideFields(Fields):
    """Fields of /v1/decide."""

    name: str | None = Field(
        default=None,
        max_length=255,
        description="Comes back as `image`. Default: the multipart file's name.",
        examples=["hall.jpg"],
    )
    view: bool = Field(
        default=False, description="Add `view`: the words and outlines that the page draws."
    )


def _asked(fields: Fields, usual: CameraChoice) -> View:
    """The camera and pose that a request names; no camera if it names none."""
    auto = fields.camera == AUTO
    choice = choose_camera(
        CameraOptions(
            None if auto else fields.camera,
            fields.fov_deg,
            fields.height_m,
            fields.pitch_deg,
            fields.roll_deg,
        )
    )
    # A camera's pose goes with it; a pose given by itself is of whatever looks.
    own_pose = choice.camera is not None or (auto and usual.given)
    return View(
        choice.fit if auto or choice.given else None,
        lambda known: choice.pose_of(None if own_pose else known),
    )


def upload_frame(picture: Picture, fields: Fields, usual: CameraChoice) -> Frame:
    """The frame of a request's image; usual: the server's own camera."""
    asked = _asked(fields, usual)
    frame = View(asked.camera or usual.fit, usual.pose_of()).of_picture(picture)
    return View(frame.camera, asked.pose).frame(frame.image, 0.0, pose=frame.pose)


def source_frame(frame: Frame, fields: Fields, usual: CameraChoice) -> Frame:
    """A frame of the server's own source by the camera and pose that a request names."""
    asked = _asked(fields, usual)
    return asked.frame(frame.image, frame.stamp_s, camera=frame.camera, pose=frame.pose)


class Pipelines:
    """The pipelines of one server; each network is opened once, when it is first asked for.

    networks: the names that a request may ask for: those whose files are there.

    Raises CallError if the server's own settings do not go together.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._lock = threading.Lock()
        self._loaded: dict[str, Network] = {}
        self._made: dict[DecideOptions, Pipeline] = {}
        self.networks = tuple(dict.fromkeys([settings.decide.network, *_available()]))
        try:
            self.get(Fields())
        except ApiError as error:  # whoever starts the server is no client of it
            raise CallError(error.message) from error

    def get(self, fields: Fields) -> Pipeline:
        """The pipeline that a request asks for.

        Raises ApiError for a network or preset that is not there, UserError if the network's
        file is damaged.
        """
        given = {name: value for name in _DECIDE if (value := getattr(fields, name)) is not None}
        options = replace(self._settings.decide, **given)
        if options.network not in self.networks:
            raise ApiError(
                422, "unknown_network", f"network must be one of {', '.join(self.networks)}"
            )
        with self._lock:
            if options not in self._made:
                while len(self._made) >= _CACHED:
                    del self._made[next(iter(self._made))]
                self._made[options] = self._make(options)
            return self._made[options]

    def _make(self, options: DecideOptions) -> Pipeline:
        network = self._network(options.network)
        lacking = [need for need in NEEDS[options.method] if need not in network.gives]
        if lacking:
            raise ApiError(
                422,
                "unfit_network",
                f"method {options.method} needs {', '.join(lacking)}, which network "
                f"{options.network} lacks",
            )
        known = presets_of(network)
        if options.preset is not None and options.preset not in known:
            raise ApiError(
                422,
                "unknown_preset",
                f"preset must be one that network {options.network} has: "
                + (", ".join(known) or "none"),
            )
        return build_pipeline(options, network)

    def _network(self, name: str) -> Network:
        parts = []
        for part in name.split("+"):
            if part not in self._loaded:
                self._loaded[part] = load(part, threads=self._settings.decide.threads)
            parts.append(self._loaded[part])
        return parts[0] if len(parts) == 1 else Joined(parts)

    def methods(self, name: str) -> list[str]:
        """The methods that network `name` can be used with, by what the registry says of it."""
        parts = name.split("+")
        if not all(part in MODELS for part in parts):
            gives = self._network(name).gives
        else:
            gives = joint_gives([frozenset(MODELS[part].gives) for part in parts])
        return [method for method, needs in NEEDS.items() if gives.issuperset(needs)]


def _available() -> Iterator[str]:
    """Networks, and pairs of them, whose files are there and that some method can use."""
    there = {m.name: frozenset(m.gives) for m in MODELS.values() if m.found() is not None}
    groups = [[name] for name in there]
    groups += [[a, b] for a in there for b in there if a != b]
    for group in groups:
        parts = [there[name] for name in group]
        gives = joint_gives(parts)
        # The first of a pair must have something that the second does not replace.
        kinds = [{DEPTH if kind == RELATIVE else kind for kind in part} for part in parts]
        if any(gives.issuperset(needs) for needs in NEEDS.values()) and (
            len(group) == 1 or not kinds[1].issuperset(kinds[0])
        ):
            yield "+".join(group)


@dataclass(frozen=True, kw_only=True)
class Settings(ServerSettings):
    """How decisions are made.

    decide: used unless a request says otherwise. camera: of images that come without one.
    """

    decide: DecideOptions = field(default_factory=DecideOptions)
    camera: CameraChoice = field(default_factory=CameraChoice)
