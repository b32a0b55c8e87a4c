"""Many images decided at once, their answers in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import Generic, TypeVar

Item = TypeVar("Item")
Answer = TypeVar("Answer")


class Each(Generic[Item, Answer]):
    """An iterator of the answers to items, in the items' order, a few batches at work at a time.

    decide: gives for each of at most `batch` items its answer, or the exception that it ended in;
    the exception is raised in its turn, and the iteration can go on after it. Items are taken only
    a little ahead of the answers, so that there may be very many.
    """

    def __init__(
        self,
        decide: Callable[[Sequence[Item]], Sequence[Answer | Exception]],
        items: Iterable[Item],
        workers: int,
        batch: int = 1,
    ) -> None:
        self._decide, self._items, self._batch = decide, iter(items), batch
        self._ahead = 2 * workers
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="decide")
        self._waiting: deque[Future[Sequence[Answer | Exception]]] = deque()
        self._ready: deque[Answer | Exception] = deque()

    def __iter__(self) -> Iterator[Answer]:
        return self

    def __next__(self) -> Answer:
        while len(self._waiting) < self._ahead:
            taken = list(islice(self._items, self._batch))
            if not taken:
                break
            self._waiting.append(self._pool.submit(self._decide, taken))
        if not self._ready and self._waiting:
            self._ready.extend(self._waiting.popleft().result())
        if not self._ready:
            self._pool.shutdown(wait=False)
            raise StopIteration
        answer = self._ready.popleft()
        if isinstance(answer, Exception):
            raise answer
        return answer
