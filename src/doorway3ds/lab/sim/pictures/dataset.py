"""Folders of rendered images with their truth, in the format that training reads."""

from __future__ import annotations

import csv
import io
import json
import multiprocessing
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera
from doorway3ds.files import write_bytes
from doorway3ds.lab.datasets.csvfile import MARKS
from doorway3ds.lab.sim.homes import apartment as homes
from doorway3ds.lab.sim.homes import hazards
from doorway3ds.lab.sim.homes.apartment import Home
from doorway3ds.lab.sim.homes.plan import Plan
from doorway3ds.lab.sim.pictures import views
from doorway3ds.lab.sim.pictures.truth import Truth, truth_of
from doorway3ds.lab.sim.render import sensor
from doorway3ds.lab.sim.render.renderer import Eye, Renderer, open_context
from doorway3ds.lab.sim.render.scene import Scene, build

VIEWS = 10  # images of one home
OPEN_SHARE = 0.56
HAZARD_SHARE = 0.75  # of the views of a home with hazards
COLUMNS = (*MARKS, *["home", "state", "fx_px", "height_m", "pitch_deg", "range_m", "bearing_deg"])


@dataclass(frozen=True)
class Shot:
    """One image: rgb (H, W, 3), depth (H, W) metres with nan for the sky, and its truth."""

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]
    camera: Camera
    eye: Eye
    truth: Truth


def take(
    renderer: Renderer, plan: Plan, camera: Camera, eye: Eye, rng: np.random.Generator | None
) -> Shot:
    """Photograph a scene; without `rng` the sensor is ideal (no noise, automatic exposure)."""
    pinhole = sensor.pinhole_for(camera, renderer.limit)
    rgb, depth = sensor.distort(camera, pinhole, *renderer.draw(pinhole, eye))
    return exposed(Shot(rgb, depth, camera, eye, truth_of(plan, camera, eye, depth)), rng)


def exposed(ideal: Shot, rng: np.random.Generator | None) -> Shot:
    """An ideal sensor's image as a real one takes it."""
    return ideal if rng is None else replace(ideal, rgb=sensor.expose(rng, ideal.rgb))


def good(shot: Shot) -> bool:
    """Not an image of a wall at arm's length."""
    depth = np.nan_to_num(shot.depth, nan=60.0)
    return bool(np.median(depth) > 0.75 and (depth < 0.35).mean() < 0.2)


def shots(
    scene: Scene, renderer: Renderer, count: int, size: tuple[int, int], seed: int, low: float = 0.0
) -> Iterator[Shot]:
    """`count` images of one home, about half with an open doorway.

    Where the home has hazards, most views are of one. low: share of views from 0.3 to 0.6 m.
    """
    rng = np.random.default_rng([0x54, seed, scene.home.seed])
    # What defaults do not ask for draws from its own generator, so that they stay as they are.
    extra = np.random.default_rng([0x55, seed, scene.home.seed])
    plan = Plan(scene.furnished)
    marks = hazards.marks(scene.furnished)
    marks = marks if scene.home.hazards or scene.home.flights else []
    for _ in range(count):
        shot = None
        want_open = bool(rng.random() < OPEN_SHARE)
        is_low = bool(extra.random() < low)
        at_hazard = bool(marks) and bool(extra.random() < HAZARD_SHARE)
        for _ in range(6):
            camera = views.random_camera(rng, *size)
            eye = views.look_at(extra, plan, camera, marks) if at_hazard else None
            eye = eye or views.choose(rng, plan, camera, want_open)
            if eye is None:
                want_open = not want_open
                continue
            if is_low:
                eye = replace(eye, pose=views.low_pose(extra))
            shot = take(renderer, plan, camera, eye, rng)
            if good(shot):
                break
        if shot is not None:
            yield shot


def rows(shot: Shot, name: str) -> list[dict[str, Any]]:
    """The lines of doorways.csv for one image."""
    pose, truth = shot.eye.pose, shot.truth
    common = {
        "image": name,
        "home": "",
        "fx_px": round(shot.camera.fx, 3),
        "height_m": round(pose.height_m or 0.0, 4),
        "pitch_deg": round(pose.pitch_deg, 3),
    }
    if not truth.openings:
        first = next((s for s in truth.states if s not in homes.OPEN_STATES), "blank")
        sure = 1 if truth.glimpse else 3
        return [{**common, "open": 0, "confidence": sure, "second": 0, "state": first}]
    return [
        {
            **common,
            "open": 1,
            "left_px": round(o.left_px, 2),
            "right_px": round(o.right_px, 2),
            "clear": "" if o.clear is None else int(o.clear),
            "confidence": o.confidence,
            "second": int(k > 0),
            "state": o.state,
            "range_m": round(o.range_m, 4),
            "bearing_deg": round(o.bearing_deg, 4),
        }
        for k, o in enumerate(truth.openings)
    ]


def truth_object(shot: Shot, name: str, home: int) -> dict[str, Any]:
    """Everything about one image as JSON values."""
    camera = {k: v for k, v in asdict(shot.camera).items() if k != "assumed"}
    return {
        "image": name,
        "home": home,
        "camera": camera,
        "pose": asdict(shot.eye.pose),
        "x_m": shot.eye.x,
        "y_m": shot.eye.y,
        "heading_deg": shot.eye.heading_deg,
        "openings": [asdict(o) for o in shot.truth.openings],
        "glimpse": shot.truth.glimpse,
        "in_view": list(shot.truth.states),
    }


def write_shot(
    shot: Shot, image: Path, depth: Path, floor: Path, quality: int, effort: int = 1
) -> None:
    """The image (JPEG), its depth in 16-bit millimetres, 0 unknown (the sky), and its floor."""
    cv2.imwrite(str(image), shot.rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    known = np.clip(shot.depth * 1000 + 0.5, 1, 65535)
    millimetres = np.where(np.isnan(shot.depth), 0, known).astype(np.uint16)
    cv2.imwrite(str(depth), millimetres, [cv2.IMWRITE_PNG_COMPRESSION, effort])
    cv2.imwrite(str(floor), shot.truth.floor.astype(np.uint8) * 255)


def texels_a_metre(width: int) -> float:
    """Texture resolution that an image of this width deserves."""
    return float(np.clip(72.0 * width / 320, 72.0, 160.0))


def largest(size: tuple[int, int]) -> tuple[int, int]:
    """Room for the pinhole image behind a distorted one."""
    return int(size[0] * 1.35) + 8, int(size[1] * 1.35) + 8


@dataclass(frozen=True)
class Job(ABC):
    """Some images of a data set, made in one process: numbers first .. first + count - 1.

    low: share of views from 0.3 to 0.6 m.
    """

    out: Path
    first: int
    count: int
    size: tuple[int, int]
    low: float

    @property
    def shard(self) -> Path:
        return self.out / "homes" / f"{self.first:06d}.json"

    @property
    @abstractmethod
    def key(self) -> list[int]:
        """Of the generator of what tells nothing: how the images are compressed."""

    @abstractmethod
    def shots(self, context: Any) -> Iterator[tuple[Home, Shot]]:
        """The images, each with the home that it shows; context: of this process' OpenGL."""


@dataclass(frozen=True)
class HomeJob(Job):
    """Images of one home.

    hazards: share of homes with hazards.
    """

    home: int
    seed: int
    hazards: float

    @property
    def key(self) -> list[int]:
        return [0x19E6, self.home]

    def shots(self, context: Any) -> Iterator[tuple[Home, Shot]]:
        home = homes.generate(self.home)
        dice = np.random.default_rng([0xA2, self.home])
        if dice.random() < self.hazards:
            home = hazards.with_hazards(home, dice)
        scene = build(home, texels_a_metre(self.size[0]), largest(self.size))
        renderer = Renderer(scene, context)
        try:
            for shot in shots(scene, renderer, self.count, self.size, self.seed, self.low):
                yield home, shot
        finally:
            renderer.close()


def home_jobs(
    out: Path, count: int, seed: int, size: tuple[int, int], hazards: float = 0.0, low: float = 0.0
) -> list[Job]:
    """`count` images of homes drawn at random, VIEWS of each."""
    return [
        HomeJob(out, at, min(VIEWS, count - at), size, low, seed * 100_000 + k, seed, hazards)
        for k, at in enumerate(range(0, count, VIEWS))
    ]


_context: Any = None


def _start_worker() -> None:
    # One thread each: the workers share the cores, not an image.
    os.environ.setdefault("LP_NUM_THREADS", "1")
    cv2.setNumThreads(1)
    global _context
    _context = open_context()


def render_job(job: Job) -> int:
    """Render a job's images; its shard is written last, so that a cut run is noticed."""
    rng = np.random.default_rng(job.key)
    lines, objects = [], []
    for k, (home, shot) in enumerate(job.shots(_context)):
        stem = f"{job.first + k:06d}"
        image, depth, floor = (
            job.out / name
            for name in (f"images/{stem}.jpg", f"depth/{stem}.png", f"floor/{stem}.png")
        )
        write_shot(shot, image, depth, floor, int(rng.integers(75, 97)))
        lines += [{**row, "home": home.seed} for row in rows(shot, f"{stem}.jpg")]
        objects.append(truth_object(shot, f"{stem}.jpg", home.seed))
    write_bytes(job.shard, json.dumps({"rows": lines, "truth": objects}).encode())
    return len(objects)


def render_dataset(
    out: Path,
    jobs: Sequence[Job],
    workers: int = 2,
    progress: Callable[[int], None] = lambda done: None,
) -> int:
    """Render what is missing of the jobs' images into `out`; returns how many there are."""
    for folder in ("images", "depth", "floor", "homes"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    missing = [job for job in jobs if not job.shard.exists()]
    progress(sum(job.count for job in jobs if job not in missing))
    open_context().free()  # a worker without OpenGL would be started again and again
    context = multiprocessing.get_context("spawn")
    with context.Pool(workers, initializer=_start_worker, maxtasksperchild=40) as pool:
        for done in pool.imap_unordered(render_job, missing):
            progress(done)
    return _merge(out, jobs)


def _merge(out: Path, jobs: Sequence[Job]) -> int:
    lines: list[dict[str, Any]] = []
    objects: list[dict[str, Any]] = []
    for job in jobs:
        shard = json.loads(job.shard.read_text())
        lines += shard["rows"]
        objects += shard["truth"]
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS)
    writer.writeheader()
    writer.writerows(lines)
    write_bytes(out / "doorways.csv", text.getvalue().encode())
    write_bytes(out / "truth.jsonl", "".join(json.dumps(o) + "\n" for o in objects).encode())
    return len(objects)
