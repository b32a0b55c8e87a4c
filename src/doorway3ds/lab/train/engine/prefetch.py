"""Batches made ready while the one before is learned from."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Wanted = TypeVar("Wanted")
Loaded = TypeVar("Loaded")


def ahead(
    load: Callable[[Wanted], Loaded], wanted: Sequence[Wanted], depth: int = 2
) -> Generator[Loaded, None, None]:
    """load(w) for each of `wanted` in order, by one thread that is at most `depth` ahead.

    What `load` raises comes out at its place. Closing the iterator waits for the load under way
    and drops the others.
    """
    pool = ThreadPoolExecutor(1, thread_name_prefix="batches")
    waiting: deque[Future[Loaded]] = deque()
    try:
        for item in wanted:
            waiting.append(pool.submit(load, item))
            if len(waiting) > depth:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
