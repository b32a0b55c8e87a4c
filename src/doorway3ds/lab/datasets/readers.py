"""Readers of the layouts in which marked images come.

nyu       images/, depth/ (8-bit), labels/, doorways.csv: NYU Depth v2, 640x480 with its frame
rendered  images/, depth/ (16-bit millimetres), doorways.csv with a column fx_px, and truth.jsonl
          with each image's whole camera and pose where it is there
plain     images/ (or files beside it), doorways.csv: photographs marked by hand, of any
          size, as `3ds label` writes it; a column `state` tells half open from open, and closed
          from no door
boxes     images/, boxes.csv: door boxes with a state, portraits squeezed to a square
folders   one folder per class: open-door/, no-door/ and their like

A views.csv beside doorways.csv (image, pitch_deg, + up) tells how each photograph was tilted. A
camera.yaml beside doorways.csv or the class folders is the camera of its photographs (a ROS
camera_info file); without one it is told by EXIF or assumed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from doorway3ds.camera.choice import FitCamera, default_camera
from doorway3ds.camera.info import read_camera_info
from doorway3ds.camera.model import Camera, Pose
from doorway3ds.errors import CallError, UserError
from doorway3ds.files import read_text
from doorway3ds.images.codec import image_size
from doorway3ds.images.folder import images_in
from doorway3ds.lab.datasets.csvfile import Row, csv_columns, csv_rows, flag, number
from doorway3ds.lab.datasets.samples import Dataset, Marked, Sample

LAYOUTS = ("nyu", "rendered", "plain", "boxes", "folders")

# A white frame of 5-8 px surrounds each NYU image: rows 10:470, columns 10:630 remain.
NYU_CROP = (10, 470, 10, 630)
NYU_CAMERA = Camera("nyu-v2 cropped", 620, 460, 518.86, 519.47, 325.58 - 10, 253.74 - 10)
NYU_UNIT_M = 9.9955 / 255
NYU_BLOCK = 40  # neighbouring numbers are the same room
NYU_EIGEN_BOX = (35, 460, 31, 591)  # Eigen et al.'s 45:471, 41:601 after the crop

# DeepDoors2 portraits, taken 480x640 and squeezed to 416x416.
BOX_CAMERA = Camera.from_fov(480, 640, 64.0, name="64 deg portrait", assumed=True)
BOX_STATES: dict[str, bool | None] = {"open": True, "semi": None, "closed": False}

CLASS_FOLDERS: dict[str, bool | None] = {
    **dict.fromkeys(("open-door", "opened-door", "open"), True),
    **dict.fromkeys(("no-door", "none", "closed-door", "close-door", "closed"), False),
    **dict.fromkeys(("half-open", "half-open-door", "semi-open", "semi-open-door", "semi")),
}

# The renderer's words for what is no open doorway; "blank" and what is open are none of these.
_RENDERED_KINDS = {
    "closed": "closed door",
    "sliding_closed": "closed glass door",
    "window": "window",
    "mirror": "mirror",
    "wardrobe": "wardrobe or cabinet",
    "closet": "closet without a leaf",
    "glass_closed": "closed glass door",
    "curtain": "curtain in a doorway",
    "stairs_down": "stairs down",
    "stairs_up": "stairs up",
    "step": "step",
    "person": "person",
    "pet": "pet",
}

CAMERA_FILE = "camera.yaml"
VIEWS_FILE = "views.csv"
HALF_OPEN = "half"  # a `state` of an open row
# What a `state` of an image marked by hand says is easily taken for an open doorway.
_MARKED_KINDS = {"closed": ("closed door",), "none": ()}


def read_dataset(
    path: Path, layout: str | None = None, places: Mapping[str, str] | None = None
) -> Dataset:
    """The samples of a folder; the layout is told from its files unless given.

    places: place of each image by name, over what the layout says. Raises UserError, one
    line, on a folder of no known layout and on damaged or missing files.
    """
    if not path.is_dir():
        raise UserError(f"expected a folder with marked images, got {path}")
    layout = layout or guess_layout(path)
    if layout not in LAYOUTS:
        raise CallError(f"expected a layout of {', '.join(LAYOUTS)}, got '{layout}'")
    if layout == "boxes":
        samples, known = _read_boxes(path)
    elif layout == "folders":
        samples, known = _read_folders(path)
    else:
        samples, known = _read_doorways(path, layout)
    if layout in ("plain", "folders"):
        fit = folder_camera(path)
        samples = [replace(s, fit=fit) for s in samples]
    if places is not None:
        samples, known = in_places(samples, places), True
    if not samples:
        raise UserError(f"{path} holds no marked images ({layout} layout)")
    return Dataset(path, layout, tuple(sorted(samples, key=lambda s: s.name)), known)


def read_places(path: Path) -> dict[str, str]:
    """A CSV with columns image and place."""
    return {row["image"]: row["place"] for _, row in csv_rows(path, ("image", "place"))}


def in_places(samples: Iterable[Sample], places: Mapping[str, str]) -> list[Sample]:
    """Samples with the places of a places file; UserError if it leaves an image out."""
    placed = []
    for sample in samples:
        if sample.name not in places:
            raise UserError(f"the places file names no place for {sample.name}")
        placed.append(replace(sample, place=places[sample.name]))
    return placed


def guess_layout(path: Path) -> str:
    """Which of LAYOUTS a folder is, by its files. Raises UserError where it is none."""
    if (path / "boxes.csv").is_file():
        return "boxes"
    doorways = path / "doorways.csv"
    if doorways.is_file():
        if "fx_px" in csv_columns(doorways):
            return "rendered"
        return "nyu" if all((path / d).is_dir() for d in ("depth", "labels")) else "plain"
    if any(d.is_dir() and _class_key(d.name) in CLASS_FOLDERS for d in path.glob("*")):
        return "folders"
    raise UserError(
        f"{path} has neither doorways.csv, boxes.csv nor folders like open-door/ and no-door/"
    )


def _by_image(table: Path, columns: Sequence[str]) -> dict[str, list[tuple[str, Row]]]:
    """Rows of each image, with where they stand."""
    found: dict[str, list[tuple[str, Row]]] = {}
    for where, row in csv_rows(table, columns):
        found.setdefault(row["image"], []).append((where, row))
    return found


def _read_doorways(path: Path, layout: str) -> tuple[list[Sample], bool]:
    required = ["image", "open", "left_px", "right_px"]
    if layout == "rendered":
        required.append("fx_px")
    known = True
    samples = []
    eyes = _read_eyes(path / "truth.jsonl") if layout == "rendered" else {}
    poses = _read_views(path / VIEWS_FILE) if layout == "plain" else {}
    for name, rows in _by_image(path / "doorways.csv", required).items():
        where, main = rows[0]
        stem = Path(name).stem
        if main.get("place"):
            place = main["place"]
        elif main.get("home"):
            place = f"home-{main['home']}"
        elif stem.isdigit() and layout == "nyu":
            place = f"{int(stem) // NYU_BLOCK:03d}"
        else:
            place, known = name, False
        is_open = flag(main, "open", where)
        if is_open is None:
            raise UserError(f"{where}: expected open 0 or 1, got nothing")
        sample = Sample(
            name=name,
            place=place,
            image_path=_existing(path, name, where),
            is_open=is_open,
            kinds=() if is_open else _kinds([main.get("state", "")], layout),
            confidence=confidence(main, where),
        )
        sample = _with_files(sample, path, layout, main, where)
        if name in poses:
            sample = replace(sample, pose=poses[name])
        if name in eyes:
            camera, pose, in_view = eyes[name]
            sample = replace(sample, camera=camera, pose=pose)
            if in_view and not is_open:
                sample = replace(sample, kinds=_kinds(in_view, layout))
        shift = NYU_CROP[2] if layout == "nyu" else 0
        marks = tuple(
            _marked(row, place_, shift) for place_, row in rows if flag(row, "open", place_)
        )
        if sample.camera is not None:
            edge = sample.camera.width - 0.5
            marks = tuple(
                replace(m, left_px=max(m.left_px, -0.5), right_px=min(m.right_px, edge))
                for m in marks
            )
            if any(m.left_px >= m.right_px for m in marks):
                raise UserError(f"{where}: the opening lies outside the image")
        by_hand = layout != "rendered"
        if by_hand and marks and all(row.get("state") == HALF_OPEN for _, row in rows):
            sample = replace(sample, is_open=None)
        samples.append(replace(sample, openings=marks))
    return samples, known


def folder_camera(path: Path) -> FitCamera:
    """The camera of a folder's photographs: that of its camera.yaml, else told by each image.

    Raises UserError where the file cannot be read.
    """
    file = path / CAMERA_FILE
    if not file.is_file():
        return default_camera
    camera = read_camera_info(file)
    return lambda width, height, focal_35mm: camera.scaled_to(width, height)


def _with_files(
    sample: Sample, path: Path, layout: str, row: Mapping[str, str], where: str
) -> Sample:
    depth_path, labels_path, floor_path = (
        file if file.is_file() else None
        for file in (
            path / part / f"{Path(sample.name).stem}.png" for part in ("depth", "labels", "floor")
        )
    )
    if layout == "nyu":
        return replace(
            sample,
            camera=NYU_CAMERA,
            crop=NYU_CROP,
            depth_path=depth_path,
            depth_unit_m=NYU_UNIT_M,
            depth_full=255,
            labels_path=labels_path,
            eigen_box=NYU_EIGEN_BOX,
        )
    if layout == "plain":
        return replace(sample, depth_path=depth_path)

    def given(column: str, default: float) -> float:
        value = number(row, column, where)
        return default if value is None else value

    width, height = image_size(sample.image_path)
    fx = given("fx_px", math.nan)
    if not fx > 0:
        raise UserError(f"{where}: expected a focal length fx_px above 0, got '{row['fx_px']}'")
    middle = given("cx_px", (width - 1) / 2), given("cy_px", (height - 1) / 2)
    camera = Camera("rendered", width, height, fx, given("fy_px", fx), *middle)
    turned = {angle: given(angle, 0) for angle in ("pitch_deg", "yaw_deg", "roll_deg")}
    pose = Pose(height_m=number(row, "height_m", where), **turned)
    return replace(sample, camera=camera, pose=pose, depth_path=depth_path, floor_path=floor_path)


def _read_views(path: Path) -> dict[str, Pose]:
    """How each image's camera was tilted; nothing where there is no such file."""
    if not path.is_file():
        return {}
    poses = {}
    for where, row in csv_rows(path, ("image", "pitch_deg")):
        pitch = number(row, "pitch_deg", where)
        poses[row["image"]] = Pose(pitch_deg=pitch or 0.0)
    return poses


def _read_eyes(path: Path) -> dict[str, tuple[Camera, Pose, list[str]]]:
    """Camera, pose and what is in view by image; nothing where there is no such file."""
    if not path.is_file():
        return {}
    eyes = {}
    for line_number, line in enumerate(read_text(path).splitlines(), 1):
        try:
            told = json.loads(line)
            camera = {**told["camera"], "distortion": tuple(told["camera"]["distortion"])}
            in_view = [str(state) for state in told.get("in_view", ())]
            eyes[str(told["image"])] = (Camera(**camera), Pose(**told["pose"]), in_view)
        except (ValueError, KeyError, TypeError) as error:
            raise UserError(
                f"{path} line {line_number}: expected an image's camera and pose, {error!r}"
            ) from error
    return eyes


def _kinds(states: Iterable[str], layout: str) -> tuple[str, ...]:
    """What an image without a doorway shows instead, each kind once."""
    if layout == "rendered":
        found = [_RENDERED_KINDS[state] for state in states if state in _RENDERED_KINDS]
    else:
        found = [kind for s in states if s for kind in _MARKED_KINDS.get(s, (s,))]
    return tuple(dict.fromkeys(found))


def _marked(row: Mapping[str, str], where: str, shift_px: float) -> Marked:
    left, right = number(row, "left_px", where), number(row, "right_px", where)
    if left is None or right is None or left >= right:
        raise UserError(
            f"{where}: an open row needs left_px below right_px, "
            f"got '{row['left_px']}' and '{row['right_px']}'"
        )
    return Marked(
        left - shift_px,
        right - shift_px,
        clear=flag(row, "clear", where),
        confidence=confidence(row, where),
        second=bool(flag(row, "second", where)),
        range_m=number(row, "range_m", where),
    )


def confidence(row: Mapping[str, str], where: str) -> int:
    text = row.get("confidence") or "3"
    if text not in ("1", "2", "3"):
        raise UserError(f"{where}: expected a confidence of 1, 2 or 3, got '{text}'")
    return int(text)


def _read_boxes(path: Path) -> tuple[list[Sample], bool]:
    sides = ("left", "top", "right", "bottom")
    by_image = _by_image(path / "boxes.csv", ("image", "state", *sides))
    samples = []
    known = all(rows[0][1].get("place") for rows in by_image.values())
    for name, rows in by_image.items():
        openings, leaves = [], []
        for where, row in rows:
            if row["state"] not in BOX_STATES:
                raise UserError(
                    f"{where}: expected a state of open, semi, closed, got '{row['state']}'"
                )
            left, top, right, bottom = (number(row, side, where) for side in sides)
            if left is None or right is None or not 0 <= left < right <= 1:
                raise UserError(
                    f"{where}: expected fractions 0 <= left < right <= 1, "
                    f"got '{row['left']}' and '{row['right']}'"
                )
            if row["state"] != "closed":
                width = BOX_CAMERA.width
                openings.append(Marked(left * width - 0.5, right * width - 0.5))
            elif top is not None and bottom is not None:
                leaves.append((left, top, right, bottom))
        states = {row["state"] for _, row in rows}
        state = next(s for s in BOX_STATES if s in states)
        place = rows[0][1].get("place") if known else None
        samples.append(
            Sample(
                name=name,
                place=place or name,
                image_path=_existing(path, name, rows[0][0]),
                is_open=BOX_STATES[state],
                openings=tuple(openings),
                kinds=("closed door",) if state == "closed" else (),
                camera=BOX_CAMERA,
                size=(BOX_CAMERA.width, BOX_CAMERA.height),
                leaf=leaves[0] if leaves else None,
            )
        )
    return samples, known


def _read_folders(path: Path) -> tuple[list[Sample], bool]:
    samples = []
    known = True
    for folder in sorted(d for d in path.iterdir() if d.is_dir() and d.name[0] != "."):
        key = _class_key(folder.name)
        if key not in CLASS_FOLDERS:
            raise UserError(
                f"expected class folders like open-door/ and no-door/ in {path}, got {folder.name}/"
            )
        for file in images_in(folder, recursive=True):
            name = file.relative_to(path).as_posix()
            nested = file.parent != folder
            known &= nested
            is_open = CLASS_FOLDERS[key]
            samples.append(
                Sample(
                    name=name,
                    place=file.parent.name if nested else name,
                    image_path=file,
                    is_open=is_open,
                    kinds=(key,) if is_open is False else (),
                )
            )
    return samples, known


def _existing(path: Path, name: str, where: str) -> Path:
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise UserError(f"{where}: expected an image's name below the folder, got '{name}'")
    for candidate in (path / "images" / name, path / name):
        if candidate.is_file():
            return candidate
    raise UserError(f"{where}: there is no image {name} in {path / 'images'}")


def _class_key(name: str) -> str:
    key = name.strip().lower().replace("_", "-").replace(" ", "-")
    return {"opendoor": "open-door", "nodoor": "no-door", "closeddoor": "closed-door"}.get(
        key, key.removesuffix("s") if key.endswith("doors") else key
    )
