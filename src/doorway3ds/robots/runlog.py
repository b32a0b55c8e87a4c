"""The log of a run: one JSON object a line, each line whole, and the images that were decided on.

    start   method, network, gates, limits, source, robot, version
    look    step, image, camera, pose, stamp_s, expected_deg, decision, action
    down    step, image, camera, pose, stamp_s, bearing_deg, range_m, clear
    turn    step, asked_deg, turned_deg, end, took_s
    end     outcome, turns, took_s

Images are PNG, so that the same decision can be made again; `t_s` counts from the start.
"""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.closing import Closing
from doorway3ds.errors import UserError
from doorway3ds.files import write_bytes
from doorway3ds.images.codec import read_image, write_image
from doorway3ds.types import ColumnVotes, Decision, Frame, Perception, RelativeDepth, Selection

LOG = "run.jsonl"


class RunLog(Closing):
    """Writes one run into a folder. Without a folder it writes nothing.

    perception: also keep what the network said, for networks that cannot be asked again.
    """

    def __init__(
        self,
        folder: Path | None,
        *,
        perception: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.folder, self._perception, self._clock = folder, perception, clock
        self._zero = clock()
        self._pictures = 0
        self._file = None
        if folder is not None:
            try:
                folder.mkdir(parents=True, exist_ok=True)
                self._file = (folder / LOG).open("x", encoding="utf-8")
            except FileExistsError as error:
                raise UserError(
                    f"{folder} already holds a run; name another folder by --log"
                ) from error
            except OSError as error:
                raise UserError(f"cannot write the log {folder}: {error.strerror}") from error

    def write(self, event: str, **values: Any) -> None:
        if self._file is None:
            return
        line = json.dumps(
            {"event": event, "t_s": round(self._clock() - self._zero, 4), **values},
            default=str,
            allow_nan=False,
        )
        try:
            self._file.write(line + "\n")
            self._file.flush()
        except OSError as error:
            raise UserError(f"cannot write the log {self.folder}: {error.strerror}") from error

    def look(
        self, step: int, decision: Decision, action: str, expected_deg: float | None = None
    ) -> None:
        """An image, what was decided on it, and what follows from that.

        expected_deg: where the doorway that is followed should have been.
        """
        if self.folder is None:
            return
        kept = {}
        name = self._picture(self.folder, decision.frame)
        if self._perception:
            kept["perception"] = f"{self._pictures:04d}.npz"
            write_bytes(self.folder / kept["perception"], _packed(decision.perception))
        self.write(
            "look", step=step, image=name, **_taken(decision.frame), expected_deg=expected_deg,
            **kept, decision=decision.to_dict(name), action=action,
        )  # fmt: skip

    def down(self, step: int, frame: Frame, way: Selection, clear: bool | None) -> None:
        """An image taken with the head down along a way, and whether it shows it free."""
        if self.folder is None:
            return
        self.write(
            "down", step=step, image=self._picture(self.folder, frame), **_taken(frame),
            bearing_deg=way.bearing_deg, range_m=way.range_m, clear=clear,
        )  # fmt: skip

    def _picture(self, folder: Path, frame: Frame) -> str:
        self._pictures += 1
        name = f"{self._pictures:04d}.png"
        write_image(folder / name, frame.image)
        return name

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None


def _taken(frame: Frame) -> dict[str, Any]:
    return {
        "camera": asdict(frame.camera),
        "pose": asdict(frame.pose),
        "stamp_s": frame.stamp_s,
    }


@dataclass(frozen=True)
class Look:
    """One look of a recorded run. perception: None if the network is to be asked again."""

    step: int
    frame: Frame
    decision: dict[str, Any]
    action: str
    perception: Perception | None
    expected_deg: float | None = None


def read_log(folder: Path) -> list[dict[str, Any]]:
    """The events of a run; UserError if there is none, or a line is no whole event."""
    path = folder / LOG
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise UserError(
            f"{folder} holds no run: cannot read {LOG} ({error.strerror}); name the folder that "
            f"3ds run wrote"
        ) from error
    events = []
    for number, line in enumerate(lines, 1):
        try:
            event = json.loads(line)
        except json.JSONDecodeError as error:
            raise UserError(f"{path}:{number} is not a whole event: {error.msg}") from error
        if not isinstance(event, dict) or "event" not in event:
            raise UserError(f"{path}:{number} is not an event of a run")
        events.append(event)
    if not events or events[0]["event"] != "start":
        raise UserError(f"{path} does not begin with the start of a run")
    return events


def looks(folder: Path, events: list[dict[str, Any]]) -> Iterator[Look]:
    """The looks of a run with their images."""
    for event in events:
        if event["event"] != "look":
            continue
        try:
            camera = dict(event["camera"])
            camera["distortion"] = tuple(camera["distortion"])
            image = read_image(folder / event["image"]).image
            frame = Frame(image, Camera(**camera), Pose(**event["pose"]), event["stamp_s"])
            kept = event.get("perception")
            perception = None if kept is None else _unpacked(folder / kept)
            yield Look(
                event["step"], frame, event["decision"], event["action"], perception,
                event.get("expected_deg"),
            )  # fmt: skip
        except (KeyError, TypeError, ValueError) as error:
            raise UserError(f"{folder / LOG}: a look is damaged ({error})") from error


def differences(before: dict[str, Any], now: dict[str, Any], tolerance: float = 1e-6) -> list[str]:
    """Which values of two decisions differ, by name; times are no part of a decision."""
    names = (set(before) | set(now)) - {"timings_ms", "image"}
    return sorted(n for n in names if not _same(before.get(n), now.get(n), tolerance))


def _same(a: Any, b: Any, tolerance: float) -> bool:
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_same(a[k], b[k], tolerance) for k in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(_same(*pair, tolerance) for pair in zip(a, b, strict=True))
    if isinstance(a, float | int) and isinstance(b, float | int) and not isinstance(a, bool):
        return abs(a - b) <= tolerance * max(1.0, abs(a), abs(b))
    return bool(a == b)


def _packed(perception: Perception) -> bytes:
    """Every array and number of a perception and its parts, by the names of their fields."""
    parts = (perception, perception.columns, perception.relative)
    arrays: dict[str, Any] = {
        field.name: value
        for part in parts
        if part is not None
        for field in fields(part)
        if isinstance(value := getattr(part, field.name), np.ndarray | float | int | str)
    }
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _unpacked(path: Path) -> Perception:
    try:
        with np.load(path, allow_pickle=False) as kept:
            # scalars come back as arrays without dimensions
            arrays = {
                name: kept[name] if kept[name].ndim else kept[name][()].item()
                for name in kept.files
            }
    except (OSError, ValueError) as error:
        raise UserError(f"cannot read {path}: {error}") from error
    seen = _of(Perception, arrays)
    if "score" in arrays:
        seen = replace(seen, columns=_of(ColumnVotes, arrays))
    if "inverse" in arrays:
        seen = replace(seen, relative=_of(RelativeDepth, arrays))
    return seen


_Part = TypeVar("_Part", Perception, ColumnVotes, RelativeDepth)


def _of(kind: type[_Part], arrays: dict[str, Any]) -> _Part:
    names = {field.name for field in fields(kind)}
    return kind(**{name: value for name, value in arrays.items() if name in names})
