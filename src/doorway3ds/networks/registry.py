"""The networks that have a name: where each file lies, what it is, and how to get it."""

from __future__ import annotations

import functools
import importlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from doorway3ds.arguments import require, require_number
from doorway3ds.errors import CallError, UserError
from doorway3ds.files import digest, write_bytes, write_json
from doorway3ds.networks import hub
from doorway3ds.networks.base import DEPTH, FLOOR, RELATIVE, Joined, Network
from doorway3ds.networks.depth import presets
from doorway3ds.networks.depth.spec import parse
from doorway3ds.networks.session import signature

WEIGHTS = Path(__file__).resolve().parent.parent / "weights"
FOLDER_VARIABLE = "DOORWAY3DS_MODELS"
CARDS = (".json", ".yaml", ".yml")


@dataclass(frozen=True)
class Model:
    """One network with a name.

    gives: in words. contract: what its ONNX file takes, in words.
    make: the command that makes or fetches the file.
    hub or url, sha256: where `3ds models fetch` finds it without being told, if anywhere.
    licence: of the published weights; a card beside the file says it of the file itself.
    """

    name: str
    about: str
    gives: tuple[str, ...]
    contract: str
    make: str
    licence: str
    packaged: bool = False
    hub: hub.HubFile | None = None
    url: str | None = None
    sha256: str | None = None

    @property
    def path(self) -> Path:
        """Where the file lies once it is fetched or imported, or in the package."""
        folder = WEIGHTS if self.packaged else models_folder()
        return folder / f"{self.name}.onnx"

    def found(self) -> Path | None:
        """Where the file lies, in the hub's cache if not at `path`; None if it is missing."""
        if self.path.is_file():
            return self.path
        return None if self.hub is None else hub.cached(self.hub)


@dataclass(frozen=True)
class Card:
    """What is known of one file, beside it: NAME.json or NAME.yaml for NAME.onnx."""

    sha256: str | None = None
    licence: str | None = None
    source: str | None = None
    more: Mapping[str, Any] = field(default_factory=dict)
    file: Path | None = None


_FILE_OPTIONS = (
    "`3ds models import {0} FILE` (.onnx, or its authors' Keras .h5) or "
    "`3ds models fetch {0} --url URL --sha256 HEX`"
)

MODELS: Mapping[str, Model] = {
    model.name: model
    for model in (
        Model(
            name="doornet",
            about="one small network for everything, packaged",
            gives=("p_open", "columns", "depth", "floor"),
            contract="RGB 0..255, 1x3xHxW, H and W multiples of 32",
            make="it comes with the package: pip install --force-reinstall doorway3ds",
            licence="Apache-2.0",
            packaged=True,
        ),
        Model(
            name="cnn-srin",
            about="the paper's classifier (VGG16)",
            gives=("p_open",),
            contract="RGB 0..255, 1x224x224x3 or 1x3x224x224",
            make="`3ds train cnn-srin DATASET`, " + _FILE_OPTIONS.format("cnn-srin"),
            licence="of its training images",
        ),
        Model(
            name="densedepth",
            about="the paper's depth network (DenseNet-169)",
            gives=("depth",),
            contract="RGB 0..1, 1x480x640x3 or 1x3x480x640",
            make="`3ds train densedepth DATASET`, " + _FILE_OPTIONS.format("densedepth"),
            licence="of its training images",
        ),
        Model(
            name=presets.METRIC,
            about="Depth Anything V2, small, fine-tuned for metres indoors (Hypersim)",
            gives=(DEPTH,),
            contract="RGB, ImageNet mean and deviation, 1x3xHxW, H and W multiples of 14",
            make=f"`3ds models fetch {presets.METRIC}`",
            licence="Apache-2.0",
            # Its authors' files on the hub are PyTorch weights; this is the usual ONNX export.
            url="https://github.com/fabio-sim/Depth-Anything-ONNX/releases/download/v2.0.0/"
            "depth_anything_v2_vits_indoor_dynamic.onnx",
            sha256="2e25a3f332b34d885a1b3059cab471f7916a36099325810821b2d6e0471f74ad",
        ),
        Model(
            name=presets.RELATIVE,
            about="Depth Anything V2, small, without metres: needs a floor and the lens height",
            gives=(RELATIVE,),
            contract="RGB, ImageNet mean and deviation, 1x3xHxW, H and W multiples of 14",
            make=f"`3ds models fetch {presets.RELATIVE}` ({hub.INSTALL})",
            licence="Apache-2.0",
            hub=hub.HubFile(
                "onnx-community/depth-anything-v2-small",
                "onnx/model.onnx",
                "4472b7362082ad9968fee890ca0f1e5aca36b93d",
            ),
            sha256="afb6a5c28f3b6bf1618c6e43f02073ef9dfdc70e937502d51603e57b0a1df10c",
        ),
    )
}


def models_folder() -> Path:
    """Where fetched and imported networks lie: $DOORWAY3DS_MODELS or the user's cache folder."""
    if folder := os.environ.get(FOLDER_VARIABLE):
        return Path(folder)
    import pooch

    return Path(pooch.os_cache("doorway3ds"))


def find(name: str) -> Model:
    """The model called `name`; CallError names those there are."""
    if name not in MODELS:
        raise CallError(
            f"no network {name!r}; expected {', '.join(MODELS)}, two joined by '+', "
            f"or the path of an .onnx file"
        )
    return MODELS[name]


def read_card(path: Path) -> Card:
    """The card beside the ONNX file `path`; an empty one where there is none.

    Raises UserError if there are two, or the card is no mapping.
    """
    import yaml

    cards = [card for end in CARDS if (card := path.with_suffix(end)).is_file()]
    if not cards:
        return Card()
    if len(cards) > 1:
        raise UserError(f"{path} has {' and '.join(c.name for c in cards)} beside it; keep one")
    card = cards[0]
    try:
        text = card.read_text(encoding="utf-8")
        data: Any = json.loads(text) if card.suffix == ".json" else yaml.safe_load(text)
    except (OSError, ValueError, yaml.YAMLError) as error:
        why = " ".join(str(error).split())
        raise UserError(f"model card {card} cannot be read: {why}; delete it") from error
    if not isinstance(data, dict):
        kind = "JSON object" if card.suffix == ".json" else "YAML mapping"
        raise UserError(f"model card {card} must be a {kind}, got {type(data).__name__}")
    known = {key: data.pop(key, None) for key in ("sha256", "licence", "source")}
    return Card(**known, more=data, file=card)


def write_card(path: Path, card: Card) -> None:
    """Writes `card` beside the ONNX file `path`."""
    known = {"sha256": card.sha256, "licence": card.licence, "source": card.source}
    write_json(path.with_suffix(".json"), {**known, **card.more}, 2)


def install(
    name: str, file: Path, *, source: str, licence: str | None = None, sha256: str | None = None
) -> Path:
    """Copies `file` to where network `name` lies, once the copy opens with the right signature.

    The file it replaces stays until then. source: what messages and the card call it.

    Raises CallError for a packaged network, UserError for another digest or signature.
    """
    model = find(name)
    if model.packaged:
        raise CallError(f"{name} is packaged; pass another file to --network by its path")
    try:
        data = file.read_bytes()
    except OSError as error:
        raise UserError(f"cannot read {source}: {error.strerror}") from error
    # Tried where it will lie, as a file with weights in a second one fails only there.
    trial = write_bytes(model.path.with_name(f".{name}.trial.onnx"), data)
    try:
        _adapter(name)(trial, name=name, sha256=sha256)
        card = Card(sha256=digest(trial), licence=licence, source=source)
        trial.replace(model.path)
        write_card(model.path, card)
    except OSError as error:
        raise UserError(f"cannot write {model.path}: {error.strerror}") from error
    except UserError as error:
        raise UserError(str(error).replace(str(trial), source)) from error
    finally:
        trial.unlink(missing_ok=True)
    return model.path


def load(name: str, *, threads: int | None = None, needs: Iterable[str] = ()) -> Network:
    """Opens a network, or several as one.

    >>> sorted(load("doornet").gives)
    ['columns', 'depth', 'floor', 'p_open']

    Args:
        name: NAME[+NAME], each from `3ds models` or the path of an .onnx file.
        threads: CPU threads; default: the physical cores.
        needs: what the caller requires of them together ("p_open", "columns", "depth", "floor");
            relative depth is depth only with a floor.

    Returns:
        What a `Pipeline` takes as its network.

    Raises:
        UserError: for an unknown name, an argument of another kind, something needed that is not
            given, or a file that is missing (with how to get it), damaged or of another signature.
    """
    require("name", name, str, "the name of a network, or two joined by +")
    require_number("threads", threads, 1, 1024, whole=True, optional=True)
    if isinstance(needs, str):
        raise CallError(f"needs must be a sequence of words, got {needs!r}")
    parts = [_load_one(part, threads) for part in name.split("+")]
    network = parts[0] if len(parts) == 1 else Joined(parts)
    lacking = [need for need in needs if need not in network.gives]
    if lacking == [DEPTH] and RELATIVE in network.gives:
        raise CallError(
            f"network {name} returns depth without metres, which are needed here; join one that "
            f"returns {FLOOR}, as in doornet+{presets.RELATIVE}, and set the lens height"
        )
    if lacking:
        raise CallError(
            f"network {name} returns {', '.join(sorted(network.gives))} but {', '.join(lacking)} "
            f"is needed here; join one that returns it, as in doornet+densedepth"
        )
    return network


def _load_one(name: str, threads: int | None) -> Network:
    if name.endswith(".onnx"):
        path = Path(name)
        if not path.is_file():
            raise UserError(f"no network file {path}; expected an existing .onnx file")
        card = read_card(path)
        if "depth" in card.more:
            from doorway3ds.networks.depth.file import DepthFile

            spec = parse(card.more["depth"], card.file or path)
            return DepthFile(path, spec, name=name, sha256=card.sha256, threads=threads)
        kind, sha256 = kind_of(path), card.sha256
    else:
        model, found = find(name), find(name).found()
        if found is None:
            raise UserError(f"network {name} has no file {model.path}; to get it: {model.make}")
        # The card first: a user's own fetched file replaces what the registry knows.
        kind, path, sha256 = name, found, read_card(found).sha256 or model.sha256
    network: Network = _adapter(kind)(path, name=name, sha256=sha256, threads=threads)
    return network


def kind_of(path: Path) -> str:
    """Which adapter an ONNX file is for, by the names of its outputs."""
    names = set(signature(path).outputs)
    for kind in _SIGNED:
        adapter = _adapter(kind)
        if set(adapter.outputs) == names - set(adapter.optional):
            return kind
    raise UserError(
        f"network file {path} has another signature: expected outputs of one of "
        f"{', '.join(_SIGNED)}, or {path.stem}.yaml beside it that says what its depth is, "
        f"got {', '.join(sorted(names))}"
    )


# Networks whose file is known by its outputs alone: module and class of each adapter.
_SIGNED = {
    "doornet": ("doornet", "DoorNet"),
    "cnn-srin": ("cnn_srin", "CnnSrin"),
    "densedepth": ("densedepth", "DenseDepth"),
}


def _adapter(name: str) -> Any:
    """What makes a network of a registered name from its file; see `adapter.OnnxNetwork`."""
    if name in presets.PRESETS:
        from doorway3ds.networks.depth.file import DepthFile

        return functools.partial(DepthFile, spec=presets.PRESETS[name])
    module, adapter = _SIGNED[name]
    return getattr(importlib.import_module(f"doorway3ds.networks.{module}"), adapter)
