"""Timing of decisions: by stage in this process, and of the whole command in a fresh one."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from doorway3ds.decide.pipeline import Pipeline
from doorway3ds.errors import UserError
from doorway3ds.networks import Joined, Network, load
from doorway3ds.networks.session import available_providers, available_threads

Run = Callable[[bytes], Mapping[str, float]]
"""From an image file's bytes to milliseconds by stage."""

BUDGET_MS, BUDGET_START_S, BUDGET_PEAK_MB = 33.0, 1.5, 300.0
_WARM_UP = 5
_START_LIMIT_S = 120

# Runs one command line and says the largest memory that the process had.
_PROBE = """
import sys
from doorway3ds.cli.main import run
status = run(sys.argv[1:])
try:
    with open("/proc/self/status") as file:
        peak = next(int(line.split()[1]) * 1024 for line in file if line.startswith("VmHWM"))
except OSError:
    import resource
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
sys.stderr.write(f"\\npeak {peak}")
sys.exit(status)
"""


def made_up_jpeg(width: int = 640, height: int = 480) -> bytes:
    """A JPEG with a photograph's share of edges, gradients and grain; always the same."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(40, 216, (9, 12, 3), dtype=np.uint8)
    image = np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), float)
    for left, top, right, bottom in rng.uniform(0, 1, (12, 4)):
        rows = slice(int(min(top, bottom) * height), int(max(top, bottom) * height))
        image[rows, int(min(left, right) * width) : int(max(left, right) * width)] *= 0.85
    image += rng.normal(0, 3, image.shape)
    done, data = cv2.imencode(
        ".jpg", np.clip(image, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 90]
    )
    if not done:
        raise RuntimeError("OpenCV could not encode a JPEG")
    return data.tobytes()


def open_pipeline(name: str, threads: int | None) -> Pipeline:
    """A network with its method: `paper` if it gives no opening columns."""
    network = load(name, threads=threads)
    return Pipeline(network, "opening" if "columns" in network.gives else "paper")


def measure_decisions(
    names: Sequence[str], data: bytes, repeat: int, threads: int | None
) -> list[dict[str, Any]]:
    """Milliseconds from the file's bytes to the decision, by stage, for each network."""
    pipelines = [open_pipeline(name, threads) for name in names]
    return [
        {"name": name, "weights": weights(one.network), "method": one.method, **times}
        for name, one, times in zip(
            names, pipelines, by_turns([timed(p) for p in pipelines], data, repeat), strict=True
        )
    ]


def timed(pipeline: Pipeline) -> Run:
    """What `by_turns` calls of a pipeline."""
    return lambda data: pipeline(data).timings_ms


def by_turns(runs: Sequence[Run], data: bytes, repeat: int) -> list[dict[str, Any]]:
    """The times of each, which take turns, as `stages_ms` and `samples_ms`."""
    spent: list[list[dict[str, float]]] = [[] for _ in runs]
    for turn in range(_WARM_UP + repeat):
        for run, samples in zip(runs, spent, strict=True):
            start = time.perf_counter()
            stages = run(data)
            total = (time.perf_counter() - start) * 1e3
            if turn >= _WARM_UP:
                samples.append({**stages, "total": total})
    return [
        {
            "stages_ms": {
                stage: _summary([sample[stage] for sample in samples]) for stage in samples[0]
            },
            "samples_ms": [round(sample["total"], 4) for sample in samples],
        }
        for samples in spent
    ]


def weights(network: Network) -> str:
    """ "random" where a network's file says that nothing was trained, else "trained"."""
    parts = network.networks if isinstance(network, Joined) else (network,)
    sessions = [part.session for part in parts if hasattr(part, "session")]
    texts = [session.metadata.get("doorway3ds", "") for session in sessions]
    return "random" if any('"weights": "random"' in text for text in texts) else "trained"


def measure_starts(result: Mapping[str, Any], data: bytes, count: int) -> dict[str, Any]:
    """Seconds and bytes of `3ds look` on one image in a fresh process, annotated image written.

    result: of `measure_decisions`, for the network's name and method.
    """
    with tempfile.TemporaryDirectory() as folder:
        image = Path(folder, "image.jpg")
        image.write_bytes(data)
        call = ["look", str(image), "--out", folder]
        call += ["--network", result["name"], "--method", result["method"]]
        runs = [_start(call) for _ in range(count + 1)][1:]  # the first fills the disk cache
    return {
        "start_s": _summary([seconds for seconds, _ in runs]),
        "peak_mb": round(max(peak for _, peak in runs) / 1e6, 1),
    }


def _start(call: Sequence[str]) -> tuple[float, int]:
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", _PROBE, *call], capture_output=True, timeout=_START_LIMIT_S
    )
    seconds = time.perf_counter() - start
    message, _, peak = done.stderr.decode(errors="replace").rpartition("\npeak ")
    if done.returncode or not peak.isdigit():
        raise UserError(message.strip().removeprefix("3ds: ") or "3ds look ended without an answer")
    return seconds, int(peak)


def ratio(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """How many times longer the first network's decision takes; 95 % by bootstrap over pairs."""
    pairs = np.array([first["samples_ms"], second["samples_ms"]])
    rng = np.random.default_rng(0)
    drawn = pairs[:, rng.integers(0, pairs.shape[1], (2000, pairs.shape[1]))]
    ratios = np.median(drawn[0], axis=1) / np.median(drawn[1], axis=1)
    low, high = np.percentile(ratios, [2.5, 97.5])
    medians = np.median(pairs, axis=1)
    stage = [result["stages_ms"]["network"]["median"] for result in (first, second)]
    return {
        "of": [first["name"], second["name"]],
        "total": float(medians[0] / medians[1]),
        "interval": [float(low), float(high)],
        "network_stage": stage[0] / stage[1],
    }


def machine(threads: int | None) -> dict[str, Any]:
    """What the numbers hold for."""
    import onnxruntime

    return {
        "cpu": _cpu(),
        "cpus": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "onnxruntime": onnxruntime.__version__,
        "opencv": cv2.__version__,
        "numpy": np.__version__,
        "provider": available_providers()[0],
        "threads": threads or available_threads(),
    }


def _cpu() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return platform.processor() or "unknown"
    names = [line.partition(":")[2].strip() for line in text.splitlines() if "model name" in line]
    return names[0] if names else platform.machine()


def _summary(values: Sequence[float] | NDArray[np.float64]) -> dict[str, float]:
    low, median, high = np.percentile(values, [10, 50, 90])
    return {"median": float(median), "p10": float(low), "p90": float(high)}


def table(report: Mapping[str, Any]) -> str:
    """The report for people."""
    computer, image = report["machine"], report["image"]
    lines = [
        f"{computer['cpus']} CPUs of {computer['cpu']}, {computer['threads']} threads, "
        f"{computer['provider'].removesuffix('ExecutionProvider')}; "
        f"{image['width']}x{image['height']}, {report['repeat']} decisions; {report['date'][:10]}"
    ]
    for result in report["networks"]:
        note = ", random weights: only its timing means anything" * (result["weights"] == "random")
        lines += ["", f"{result['name']} ({result['method']}{note})"]
        lines.append(f"  {'stage':<12}{'median ms':>10}{'10 %':>9}{'90 %':>9}")
        for stage, ms in result["stages_ms"].items():
            lines.append(f"  {stage:<12}{ms['median']:>10.2f}{ms['p10']:>9.2f}{ms['p90']:>9.2f}")
        if process := result["process"]:
            start = process["start_s"]["median"]
            lines.append(f"  cold start  {start:>10.2f} s   (budget {BUDGET_START_S:g} s)")
            lines.append(
                f"  peak memory {process['peak_mb']:>10.0f} MB  (budget {BUDGET_PEAK_MB:g} MB)"
            )
        lines.append(
            f"  decision    {result['stages_ms']['total']['median']:>10.2f} ms  "
            f"(budget {BUDGET_MS:g} ms for doornet on 640x480)"
        )
    for found in report["ratios"]:
        low, high = found["interval"]
        lines += [
            "",
            f"{found['of'][0]} takes {found['total']:.2f} times as long as {found['of'][1]} "
            f"(95 %: {low:.2f}..{high:.2f}; the network stage alone {found['network_stage']:.2f})",
        ]
    return "\n".join(lines)
