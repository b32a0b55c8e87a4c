"""How fast `3ds sim render` is: images a second, and what each stage of an image costs.

    python benchmarks/sim_render.py [--count 200] [--out benchmarks/results/sim_render.json]

Wall time is that of the whole command with two workers, start, distortion, noise, truth and files
included. Where other work shares the cores, the processor seconds say what the command itself
needs. Stages are measured in one process, image by image, with and without shadow lights
taking turns.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import statistics
import tempfile
import time
from datetime import date
from pathlib import Path

os.environ.setdefault("LP_NUM_THREADS", "1")

import cv2
import numpy as np

from doorway3ds.lab.sim.homes import apartment as homes
from doorway3ds.lab.sim.homes.plan import Plan
from doorway3ds.lab.sim.pictures import dataset, views
from doorway3ds.lab.sim.pictures.truth import truth_of
from doorway3ds.lab.sim.render import sensor
from doorway3ds.lab.sim.render.renderer import Renderer, open_context
from doorway3ds.lab.sim.render.scene import build

SIZE = (320, 240)


def cpu_model() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor()


def whole_command(count: int, workers: int) -> dict[str, float]:
    """Wall and processor seconds of a fresh data set."""
    with tempfile.TemporaryDirectory() as folder:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        load, start = os.getloadavg()[0], time.perf_counter()
        done = dataset.render_dataset(
            Path(folder), dataset.home_jobs(Path(folder), count, 77, SIZE), workers
        )
        wall = time.perf_counter() - start
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {
        "pictures": done, "workers": workers, "wall_s": wall, "cpu_s": cpu,
        "pictures_per_s": done / wall, "cpu_s_per_picture": cpu / done, "load_before": load,
    }  # fmt: skip


def stages(home_count: int, per_home: int) -> dict[str, dict[str, float]]:
    """Processor milliseconds by stage: median and mean an image."""
    cv2.setNumThreads(1)
    context = open_context()
    taken: dict[str, list[float]] = {}

    def clock(name: str, start: float, share: int = 1) -> float:
        now = time.process_time()
        taken.setdefault(name, []).append((now - start) * 1000 / share)
        return time.process_time()

    with tempfile.TemporaryDirectory() as folder:
        for seed in range(500, 500 + home_count):
            start = time.process_time()
            scene = build(homes.generate(seed), size=dataset.largest(SIZE))
            start = clock("build home", start, per_home)
            renderer = Renderer(scene, context)
            start = clock("upload home", start, per_home)
            plan, rng = Plan(scene.furnished), np.random.default_rng(seed)
            for k in range(per_home):
                camera = views.random_camera(rng, *SIZE)
                start = time.process_time()
                eye = views.choose(rng, plan, camera, k % 2 == 0)
                if eye is None:
                    continue
                start = clock("choose view", start)
                pinhole = sensor.pinhole_for(camera, renderer.limit)
                for name, shadows in (("draw, no shadows", False), ("draw", True)):
                    start = time.process_time()
                    rgb, depth = renderer.draw(pinhole, eye, shadows)
                    start = clock(name, start)
                rgb, depth = sensor.distort(camera, pinhole, rgb, depth)
                start = clock("lens", start)
                truth_of(plan, camera, eye, depth)
                start = clock("truth", start)
                rgb = sensor.expose(rng, rgb)
                start = clock("exposure and noise", start)
                cv2.imwrite(f"{folder}/a.jpg", rgb[..., ::-1])
                dataset.write_depth(Path(folder) / "a.png", depth)
                clock("files", start)
            renderer.close()
    context.free()
    return {
        name: {"mean_ms": statistics.fmean(ms), "median_ms": statistics.median(ms), "n": len(ms)}
        for name, ms in taken.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    default = Path(__file__).parent / "results" / "sim_render.json"
    parser.add_argument("--out", type=Path, default=default)
    options = parser.parse_args()
    result = {
        "date": date.today().isoformat(), "cpu": cpu_model(), "cores": os.cpu_count(),
        "size": SIZE, "views_per_home": dataset.VIEWS,
        "command": whole_command(options.count, options.workers),
        "stages": stages(8, 10),
    }  # fmt: skip
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(result, indent=1) + "\n")
    command = result["command"]
    print(
        f"{command['pictures_per_s']:.1f} images/s with {command['workers']} workers "
        f"(load before: {command['load_before']:.1f}), "
        f"{command['cpu_s_per_picture'] * 1000:.0f} ms of processor time an image"
    )
    for name, stage in result["stages"].items():
        print(f"{name:20} {stage['mean_ms']:7.1f} ms mean {stage['median_ms']:7.1f} ms median")


if __name__ == "__main__":
    main()
