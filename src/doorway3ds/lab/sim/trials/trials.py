"""Many episodes: played in parallel, resumable, and summed up in tables with intervals."""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from doorway3ds.errors import UserError
from doorway3ds.files import write_bytes, write_json
from doorway3ds.lab.evaluate.intervals import Interval, mean, paired_difference, wilson
from doorway3ds.lab.evaluate.report.html import cell, markdown
from doorway3ds.lab.evaluate.report.plots import COLORS, figure
from doorway3ds.lab.sim.stages.scenarios import SCENES
from doorway3ds.lab.sim.trials.trial import Episode, Method, play
from doorway3ds.networks.base import Network

EPISODES = "episodes.jsonl"
NETWORKS = "networks.json"
METHODS: tuple[Method, ...] = ("opening", "paper")


@dataclass(frozen=True)
class Job:
    """One stage and what is played on it. network: a name of `3ds models`, or None for truth."""

    scene: str
    seed: int
    methods: tuple[Method, ...]
    network: str | None


_studio: Any = None


def _start_worker() -> None:
    # One thread each: the workers share the cores, not an image.
    os.environ.setdefault("LP_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")


def play_job(job: Job) -> list[Episode]:
    """The episodes of a job, in a process that keeps its renderer."""
    global _studio
    from doorway3ds.lab.sim.robot.world import Studio, stage_of

    if _studio is None:
        _studio = Studio((320, 240), plain=job.network is None)
    network = None if job.network is None else _load(job.network)
    stage = stage_of(_studio, job.scene, job.seed)
    return [play(_studio, stage, method, network) for method in job.methods]


@cache
def _load(name: str) -> Network:
    from doorway3ds.networks import load

    return load(name, threads=1)


def run_trials(
    out: Path,
    scenes: Sequence[str],
    episodes: int,
    seed: int = 0,
    methods: tuple[Method, ...] = METHODS,
    network: str | None = None,
    workers: int = 2,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Episode]:
    """Plays what is missing in `out`; all methods meet the same stages.

    Returns all episodes of these scenes, seeds, methods and network.
    """
    out.mkdir(parents=True, exist_ok=True)
    name = "truth" if network is None else network
    if network is not None:
        _require_same_files(out, network)
    wanted = {
        (scene, seed + k, method, name)
        for scene in scenes
        for k in range(episodes)
        for method in methods
    }
    done = {_key(e): e for e in read_episodes(out)}
    # By seed first, so that a run that is cut short covers all scenes alike.
    jobs = []
    for k in range(episodes):
        for scene in scenes:
            missing = tuple(m for m in methods if (scene, seed + k, m, name) not in done)
            if missing:
                jobs.append(Job(scene, seed + k, missing, network))
    progress(episodes * len(scenes) - len(jobs))
    with (out / EPISODES).open("a", encoding="utf-8") as file:
        if file.tell() and not (out / EPISODES).read_bytes().endswith(b"\n"):
            file.write("\n")  # a crash has cut the last line
        for played in _played(jobs, workers):
            for episode in played:
                # A network's own name may be longer than the one it was asked for by.
                line = {**asdict(episode), "network": name}
                done[_key(Episode(**line))] = Episode(**line)
                file.write(json.dumps(line) + "\n")
            file.flush()
            progress(1)
    return [episode for key, episode in sorted(done.items()) if key in wanted]


def _require_same_files(out: Path, network: str) -> None:
    """UserError where this folder's episodes were played by other files of a network's name."""
    from doorway3ds.files import digest
    from doorway3ds.networks.registry import find

    parts = network.split("+")
    files = [Path(part) if part.endswith(".onnx") else find(part).found() for part in parts]
    mine = [digest(file) for file in files if file is not None and file.is_file()]
    path = out / NETWORKS
    played: dict[str, list[str]] = json.loads(path.read_text()) if path.exists() else {}
    if played.setdefault(network, mine) != mine:
        raise UserError(
            f"{out} holds episodes of another file of {network}; name another folder by --out"
        )
    write_json(path, played)


def _played(jobs: list[Job], workers: int) -> Iterable[list[Episode]]:
    if workers == 1 or len(jobs) < 2:
        yield from map(play_job, jobs)
        return
    context = multiprocessing.get_context("spawn")
    with context.Pool(workers, initializer=_start_worker, maxtasksperchild=60) as pool:
        yield from pool.imap_unordered(play_job, jobs)


def _key(episode: Episode) -> tuple[str, int, str, str]:
    return episode.scene, episode.seed, episode.method, episode.network


def read_episodes(out: Path) -> list[Episode]:
    """Episodes of a folder; a line that was cut by a crash is played again."""
    path = out / EPISODES
    if not path.exists():
        return []
    names = {field.name for field in fields(Episode)}
    found = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            values = json.loads(line)
        except json.JSONDecodeError:
            continue
        if set(values) != names:
            raise UserError(f"{path} was written by another version; name another folder by --out")
        found.append(Episode(**values))
    return found


@dataclass(frozen=True)
class Row:
    """The episodes of one scene and method."""

    scene: str
    method: str
    of: Sequence[Episode]

    @property
    def success(self) -> Interval:
        return wilson(self.total("success"), len(self.of))

    def total(self, what: str) -> int:
        return sum(getattr(e, what) for e in self.of)


def summarise(episodes: Sequence[Episode]) -> list[Row]:
    """A row for each scene and method, then one over all scenes for each method."""
    rows = []
    for scene in [*SCENES, "all"]:
        for method in METHODS:
            of = [e for e in episodes if e.method == method and scene in (e.scene, "all")]
            if of:
                rows.append(Row(scene, method, of))
    return rows


def difference(episodes: Sequence[Episode], scene: str = "all") -> Interval | None:
    """Success of `opening` minus `paper` on the stages that both played, by bootstrap."""
    by = {_key(e)[:3]: e for e in episodes if scene in (e.scene, "all")}
    stages = sorted({key[:2] for key in by})
    both = [s for s in stages if all((*s, m) in by for m in METHODS)]
    if not both:
        return None
    opening, paper = (
        {"success": mean([float(by[(*s, m)].success) for s in both])} for m in METHODS
    )
    places = [f"{scene} {seed}" for scene, seed in both]
    return paired_difference(paper, opening, places)["success"]


def table(episodes: Sequence[Episode]) -> str:
    """Markdown: success with 95 % Wilson intervals, mistakes as counts, means and medians."""
    heads = ["scene", "method", "n", "success", "wrong turns", "go without door",
             "go when blocked", "turns", "time"]  # fmt: skip
    rows = []
    for row in summarise(episodes):
        mistakes = [row.total(what) for what in ("wrong_turns", "without_door", "when_blocked")]
        turns, took_s = np.mean([e.turns for e in row.of]), np.median([e.took_s for e in row.of])
        counted = [str(len(row.of)), _percent(row.success), *map(str, mistakes)]
        rows.append([row.scene, row.method, *counted, f"{turns:.1f}", f"{took_s:.1f} s"])
    gaps = {scene: difference(episodes, scene) for scene in [*SCENES, "all"]}
    minus = [[s, _percent(gap, signed=True), str(gap.n)] for s, gap in gaps.items() if gap]
    told = markdown(["scene", "opening minus paper, same stages", "n"], minus)
    return f"{markdown(heads, rows)}\n{told}"


def _percent(share: Interval, signed: bool = False) -> str:
    return cell(share, "share", to=" to ", digits=0, signed=signed)


def plot(episodes: Sequence[Episode], path: Path) -> Path:
    """Success of each scene and method with its interval, as PNG or SVG."""
    rows = summarise(episodes)
    scenes = list(dict.fromkeys(row.scene for row in rows))
    with figure(7, 0.42 * len(scenes) + 1, path.suffix[1:]) as (axes, done):
        for method, colour, shift in zip(METHODS, COLORS, (0.14, -0.14), strict=False):
            of = {row.scene: row.success for row in rows if row.method == method}
            y = [len(scenes) - scenes.index(scene) + shift for scene in of]
            value = np.array([share.value for share in of.values()])
            low = value - [share.low for share in of.values()]
            high = [share.high for share in of.values()] - value
            axes.errorbar(
                value, y, xerr=[low, high], fmt="o", color=colour, label=method, capsize=2
            )
        axes.set_yticks(range(len(scenes), 0, -1), [scene.replace("_", " ") for scene in scenes])
        axes.set(xlim=(-0.02, 1.02), xlabel="success, with 95 % interval")
        axes.legend(frameon=False, loc="lower left")
    return write_bytes(path, done())
