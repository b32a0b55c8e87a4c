"""What a training leaves behind: the card, report.html with its plots, and the installed file."""

from __future__ import annotations

import datetime
import hashlib
import json
import platform
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from doorway3ds.files import digest
from doorway3ds.lab.evaluate.intervals import plain
from doorway3ds.lab.evaluate.report import plots
from doorway3ds.lab.evaluate.report.html import Report
from doorway3ds.lab.train.engine.loop import Row
from doorway3ds.networks import registry

_LISTED = 6  # entries of a long list that a report's facts show


def require_plots() -> None:
    """ModuleNotFoundError, before hours of training, if its report could not be drawn."""
    import_module("matplotlib")


def identity(*parts: Any) -> str:
    """A short digest of what must be the same for a resumed training."""
    return hashlib.sha256(json.dumps(parts, default=str).encode()).hexdigest()[:16]


def when_and_where() -> dict[str, str]:
    """Date and machine for a card."""
    return {
        "date": datetime.date.today().isoformat(),
        "machine": f"{platform.machine()} {platform.system()}",
    }


def write_card(path: Path, card: dict[str, Any]) -> None:
    """Adds digest and size of the ONNX file `path` to `card` and writes it beside it."""
    card["sha256"], card["bytes"] = digest(path), path.stat().st_size
    rest = {k: v for k, v in plain(card).items() if k not in ("sha256", "licence", "source")}
    known = {key: card.get(key) for key in ("sha256", "licence", "source")}
    registry.write_card(path, registry.Card(**known, more=rest))


def install(name: str, path: Path, licence: str | None = None) -> Path:
    """Makes the trained file the one that `--network NAME` finds, with its whole card."""
    card = registry.read_card(path)
    installed = registry.install(name, path, source=str(path), licence=licence)
    found = registry.read_card(installed)
    whole = registry.Card(found.sha256, found.licence, found.source, card.more)
    registry.write_card(installed, whole)
    return installed


def training_report(card: Mapping[str, Any], history: Sequence[Row]) -> Report:
    """What every training's report begins with: its card and its losses."""
    shown = {
        key: value
        for key, value in card.items()
        if key not in ("options", "sha256")
        and not (key == "held_out" and isinstance(value, Mapping))
    }
    report = Report(f"Training of {card['name']}", facts(shown))
    names = [k for k in history[0] if k != "epoch" and not k.startswith("val_")] if history else []
    for name in names:
        report.add_plot(f"curve-{name}", name.capitalize(), curves(history, name))
    return report


def curves(history: Sequence[Row], name: str) -> bytes:
    """One loss or measure over the epochs, in training and held out, as PNG."""
    with plots.figure() as (axes, done):
        for key, label in ((name, "training"), (f"val_{name}", "held out")):
            points = [(row["epoch"], row[key]) for row in history if key in row]
            if points:
                axes.plot(*zip(*points, strict=True), label=label, marker=".")
        axes.set(xlabel="epoch", ylabel=name.replace("_", " "))
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.legend(frameon=False)
    return done()


def facts(card: Mapping[str, Any]) -> dict[str, str]:
    """A card's entries in words, long ones cut."""
    shown = {}
    for key, value in card.items():
        if isinstance(value, list) and len(value) > _LISTED:
            value = f"{len(value)}: {', '.join(map(str, value[:_LISTED]))} and others"
        if key == "left_out":
            value = f"{len(value)} images" + "".join(
                f"; {name}: {why}" for name, why in list(value.items())[:3]
            )
        shown[key.replace("_", " ")] = value if isinstance(value, str) else json.dumps(plain(value))
    return shown
