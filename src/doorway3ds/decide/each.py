"""Many images decided at once, their answers in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

Item = TypeVar("Item")
Answer = TypeVar("Answer")


class Each(Generic[Item, Answer]):
    """An iterator of `decide(item)`, in the items' order, a few at work at a time.

    Items are taken only a little ahead of the answers, so that there may be very many. What
    `decide` raises is raised in its turn; the iteration can go on after it.
    """

    def __init__(
        self, decide: Callable[[Item], Answer], items: Iterable[Item], workers: int
    ) -> None:
        self._decide, self._items = decide, iter(items)
        self._ahead = 2 * workers
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="decide")
        self._waiting: deque[Future[Answer]] = deque()

    def __iter__(self) -> Iterator[Answer]:
        return self

    def __next__(self) -> Answer:
        while len(self._waiting) < self._ahead:
            try:
                item = next(self._items)
            except StopIteration:
                break
            self._waiting.append(self._pool.submit(self._decide, item))
        if not self._waiting:
            self._pool.shutdown(wait=False)
            raise StopIteration
        return self._waiting.popleft().result()
