"""Two small filters over time: a belief that something holds, and a smoothed number."""

from __future__ import annotations

import math

_SUREST = 3.0  # logit; one image is never taken for more (p = 0.95)
_STRAY_SDS = 3.0


class Belief:
    """Bayes filter on a fact that may change: a two-state hidden Markov model.

    change_per_s: rate at which the fact changes either way; the belief decays to 0.5 by it.
    shared_s: evidence nearer in time than this is largely the same evidence, because images
        err alike, and counts accordingly: the filter does not depend on the frame rate.
    """

    def __init__(self, change_per_s: float, shared_s: float) -> None:
        self.p = 0.5
        self._change_per_s, self._shared_s = change_per_s, shared_s
        self._seen = False

    def pass_time(self, dt_s: float) -> None:
        self.p = 0.5 + (self.p - 0.5) * math.exp(-2 * self._change_per_s * dt_s)

    def observe(self, p: float, dt_s: float) -> None:
        """Evidence that alone would give probability `p`, `dt_s` after the last."""
        logit = math.log(max(p, 1e-9)) - math.log(max(1 - p, 1e-9))
        share = 1 - math.exp(-dt_s / self._shared_s) if self._seen else 1.0
        self._seen = True
        odds = math.log(self.p / (1 - self.p)) + share * min(max(logit, -_SUREST), _SUREST)
        self.p = 1 / (1 + math.exp(-odds))


class Smoothed:
    """A number measured with noise: the mean at first, then with exponential forgetting.

    A measurement pulls no further than three standard deviations of one measurement, so that a
    stray one does little; where strays go on, the scatter grows and lets them through.

    value: the estimate. sd: its standard deviation, from how the measurements scatter, as if
    their errors were independent.

    time_s: of forgetting; a steady change is followed about this much later.
    first_sd: of one measurement, believed until enough of them are seen.
    """

    _SCATTER_S = 2.0  # the scatter is learnt over this time

    def __init__(self, value: float, time_s: float, first_sd: float) -> None:
        self.value = value
        self._time_s, self._first_sd = time_s, first_sd
        self._variance = first_sd**2  # of one measurement
        self._weights2 = 1.0  # sum of the squared weights of the measurements in `value`
        self._count = 1

    @property
    def sd(self) -> float:
        return math.sqrt(self._variance * self._weights2)

    def measure(self, value: float, dt_s: float) -> None:
        """A further measurement, `dt_s` after the last."""
        self._count += 1
        gain = max(1 / self._count, 1 - math.exp(-dt_s / self._time_s))
        error = value - self.value
        limit = max(_STRAY_SDS * math.sqrt(self._variance), self._first_sd)
        # An error holds the measurement's noise and the estimate's own.
        learnt = max(1 / (self._count + 1), 1 - math.exp(-dt_s / self._SCATTER_S))
        self._variance += learnt * (error**2 / (1 + self._weights2) - self._variance)
        self.value += gain * min(max(error, -limit), limit)
        self._weights2 = (1 - gain) ** 2 * self._weights2 + gain**2

    def shift(self, by: float) -> None:
        """What is measured moved by a known amount."""
        self.value += by
