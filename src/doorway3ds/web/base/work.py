"""Decisions run in a few threads; what would wait too long is refused at once."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from doorway3ds.web.base.errors import ApiError, busy

T = TypeVar("T")


class ClientGone(Exception):
    """The client hung up; nobody waits for the answer."""


class Work:
    """A bounded number of jobs, the surplus answered with 429 and when to come back.

    limit: jobs that run or wait. workers: that run. timeout_s: for one, with its wait.
    """

    def __init__(self, limit: int, workers: int, timeout_s: float) -> None:
        self._limit = limit
        self._workers = workers
        self._timeout_s = timeout_s
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="decide")
        self._usual_s = 0.05  # of one job, a running mean
        self.in_flight = 0

    async def run(
        self, job: Callable[[], T], gone: Callable[[], Awaitable[object]] | None = None
    ) -> T:
        """What `job` returns; `gone` returns once the client hangs up.

        Raises ApiError: 429 if `limit` jobs are there, 503 after `timeout_s`; ClientGone.
        A job that has begun is finished in any case, and counts until then.
        """
        if self.in_flight >= self._limit:
            raise busy("decisions", self.retry_after_s())
        loop = asyncio.get_running_loop()
        self.in_flight += 1

        def released(_: Future[T]) -> None:
            # The loop may be closed by the time that the last job of a stopped server ends.
            if not loop.is_closed():
                loop.call_soon_threadsafe(self._release)

        future = self._pool.submit(self._timed, job)
        future.add_done_callback(released)
        answer = asyncio.wrap_future(future)
        waits: set[asyncio.Future[object]] = {answer}  # type: ignore[arg-type]
        if gone is not None:
            waits.add(asyncio.ensure_future(gone()))
        try:
            done, _ = await asyncio.wait(
                waits, timeout=self._timeout_s, return_when=asyncio.FIRST_COMPLETED
            )
            if answer in done:
                return answer.result()
            if done:
                raise ClientGone
            raise ApiError(
                503,
                "too_slow",
                f"no decision within {self._timeout_s:g} s; the server is overloaded",
                {"Retry-After": str(self.retry_after_s())},
            )
        finally:
            for wait in waits:
                if not wait.done():
                    wait.cancel()

    def _timed(self, job: Callable[[], T]) -> T:
        start = time.perf_counter()
        try:
            return job()
        finally:
            self._usual_s += 0.1 * (time.perf_counter() - start - self._usual_s)

    def _release(self) -> None:
        self.in_flight -= 1

    def retry_after_s(self) -> int:
        """Seconds in which the jobs at hand will usually be done, at least one."""
        return max(1, math.ceil(self.in_flight * self._usual_s / self._workers))

    def close(self) -> None:
        """Drops what waits; returns once what runs is done."""
        self._pool.shutdown(wait=True, cancel_futures=True)
