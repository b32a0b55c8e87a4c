"""What one server counts, for Prometheus."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    ProcessCollector,
    disable_created_metrics,
    generate_latest,
)

# The text format that every version of Prometheus reads; the library's newer ones vary.
CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
_BUCKETS_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)


class Metrics:
    """The counters of one server, apart from those of any other in the same process.

    gauges: name -> (help, value), read when the metrics are.
    """

    def __init__(self, gauges: Mapping[str, tuple[str, Callable[[], float]]]) -> None:
        disable_created_metrics()  # type: ignore[no-untyped-call]
        own = CollectorRegistry()
        self._registry = own
        self.requests = Counter(
            "doorway3ds_requests", "Answers by route and status.", ("route", "status"), registry=own
        )
        self.request_seconds = Histogram(
            "doorway3ds_request_seconds",
            "From head to last byte, by route.",
            ("route",),
            buckets=_BUCKETS_S,
            registry=own,
        )
        self.refused = Counter(
            "doorway3ds_refused", "Requests refused, by error code.", ("code",), registry=own
        )
        self.decisions = Counter(
            "doorway3ds_decisions",
            "Decisions by origin and reason.",
            ("origin", "reason"),
            registry=own,
        )
        self.stage_seconds = Histogram(
            "doorway3ds_stage_seconds",
            "Time of a decision's stages.",
            ("stage",),
            buckets=_BUCKETS_S,
            registry=own,
        )
        for name, (about, value) in gauges.items():
            Gauge(name, about, registry=own).set_function(value)
        ProcessCollector(registry=own)

    def decided(self, origin: str, reason: str, timings_ms: Mapping[str, float]) -> None:
        """Counts one decision and the time of its stages."""
        self.decisions.labels(origin, reason).inc()
        for stage, spent in timings_ms.items():
            self.stage_seconds.labels(stage).observe(spent / 1e3)

    def text(self) -> bytes:
        return generate_latest(self._registry)
