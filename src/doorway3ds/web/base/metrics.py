"""Counters, gauges and histograms in Prometheus' text format 0.0.4."""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections.abc import Callable, Mapping
from pathlib import Path

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
_BUCKETS_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)

Labels = tuple[tuple[str, str], ...]


class Metrics:
    """What one server counts; safe to use from every thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._about: dict[str, tuple[str, str]] = {}
        self._counts: dict[str, dict[Labels, float]] = {}
        self._spreads: dict[str, dict[Labels, list[float]]] = {}
        self._gauges: dict[str, Callable[[], float]] = {}

    def describe(self, name: str, kind: str, about: str) -> None:
        """Must be called once for every name; `kind` is counter or histogram."""
        self._about[name] = (kind, about)
        (self._counts if kind == "counter" else self._spreads)[name] = {}

    def gauge(self, name: str, about: str, read: Callable[[], float]) -> None:
        """A value that is read when the metrics are."""
        self._about[name] = ("gauge", about)
        self._gauges[name] = read

    def count(self, name: str, amount: float = 1.0, **labels: str) -> None:
        key = tuple(sorted(labels.items()))
        with self._lock:
            values = self._counts[name]
            values[key] = values.get(key, 0.0) + amount

    def observe(self, name: str, seconds: float, **labels: str) -> None:
        key = tuple(sorted(labels.items()))
        with self._lock:
            # One cell per bucket, one for what is longer, then the sum.
            cells = self._spreads[name].setdefault(key, [0.0] * (len(_BUCKETS_S) + 2))
            cells[bisect_left(_BUCKETS_S, seconds)] += 1
            cells[-1] += seconds

    def text(self) -> str:
        """All of it, as /metrics gives it."""
        lines: list[str] = []
        with self._lock:
            counts = {name: dict(values) for name, values in self._counts.items()}
            spreads = {
                name: {key: list(cells) for key, cells in values.items()}
                for name, values in self._spreads.items()
            }
        for name, (kind, about) in self._about.items():
            lines += [f"# HELP {name} {about}", f"# TYPE {name} {kind}"]
            if kind == "gauge":
                lines.append(f"{name} {self._gauges[name]():g}")
            elif kind == "counter":
                lines += [f"{name}{_braced(key)} {value:g}" for key, value in counts[name].items()]
            else:
                for key, cells in spreads[name].items():
                    lines += _histogram(name, key, cells)
        return "\n".join(lines) + "\n"


def _histogram(name: str, key: Labels, cells: list[float]) -> list[str]:
    lines, total = [], 0.0
    for bound, count in zip((*map(str, _BUCKETS_S), "+Inf"), cells[:-1], strict=True):
        total += count
        lines.append(f"{name}_bucket{_braced((*key, ('le', bound)))} {total:g}")
    lines.append(f"{name}_sum{_braced(key)} {cells[-1]:.6f}")
    lines.append(f"{name}_count{_braced(key)} {total:g}")
    return lines


def _braced(key: Labels) -> str:
    if not key:
        return ""
    escaped = (
        (name, value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n"))
        for name, value in key
    )
    return "{" + ",".join(f'{name}="{value}"' for name, value in escaped) + "}"


def standard(read: Mapping[str, tuple[str, Callable[[], float]]]) -> Metrics:
    """The metrics of a server; `read` gives its gauges by name, with what they mean."""
    metrics = Metrics()
    metrics.describe("doorway3ds_requests_total", "counter", "Answers by route and status.")
    metrics.describe("doorway3ds_request_seconds", "histogram", "From head to last byte, by route.")
    metrics.describe("doorway3ds_refused_total", "counter", "Requests refused, by error code.")
    metrics.describe("doorway3ds_decisions_total", "counter", "Decisions by origin and reason.")
    metrics.describe("doorway3ds_stage_seconds", "histogram", "Time of a decision's stages.")
    for name, (about, value) in read.items():
        metrics.gauge(name, about, value)
    metrics.gauge("process_resident_memory_bytes", "Memory in use.", _resident_bytes)
    return metrics


def _resident_bytes() -> float:
    try:
        text = Path("/proc/self/status").read_text()
    except OSError:
        return float("nan")
    found = [line.split()[1] for line in text.splitlines() if line.startswith("VmRSS")]
    return float(found[0]) * 1024 if found else float("nan")
