"""Workers on this machine: a process each, bounded memory, answers in the order of the items."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context, parent_process

from doorway3ds.lab.batch.items import Item
from doorway3ds.lab.batch.rows import Row, unanswered
from doorway3ds.lab.batch.worker import Chunk, Job, Worker

AHEAD = 3
"""Chunks that wait for each worker: enough that none is idle, few enough to hold in memory."""

_worker: Worker | None = None


def answers(chunks: Iterable[Chunk], job: Job, workers: int) -> Iterator[tuple[Item, Row | None]]:
    """Each item with its row, in the order given; None where its row is there already.

    A worker that dies is replaced. What was under way is tried once more, one item at a time, and
    an item that ends a worker a second time becomes a row that says so.
    """
    source = iter(chunks)
    waiting: deque[tuple[Chunk, Future[list[Row | None]]]] = deque()
    pool = _pool(job, workers)
    try:
        while True:
            while len(waiting) < workers * AHEAD and (chunk := next(source, None)) is not None:
                waiting.append((chunk, pool.submit(_answer, chunk)))
            if not waiting:
                return
            chunk, future = waiting[0]
            try:
                rows = future.result()
            except BrokenProcessPool:
                # Nobody knows which of the chunks under way it was.
                pool.shutdown(wait=False, cancel_futures=True)
                suspects = [one for one, _ in waiting]
                waiting.clear()
                for one in suspects:
                    yield from one_by_one(one, job)
                pool = _pool(job, workers)
                continue
            waiting.popleft()
            yield from zip((item for item, _ in chunk), rows, strict=True)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def one_by_one(chunk: Chunk, job: Job) -> Iterator[tuple[Item, Row | None]]:
    """Answers items that may have ended a worker, so that only the guilty one goes without."""
    pool = _pool(job, 1)
    try:
        for item, known in chunk:
            try:
                yield item, pool.submit(_answer, [(item, known)]).result()[0]
            except BrokenProcessPool:
                message = f"{item.name}: the process that decided on it died twice"
                yield item, unanswered(item.name, item.occurrence, None, message)
                pool = _pool(job, 1)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _pool(job: Job, workers: int) -> ProcessPoolExecutor:
    # Spawned, not forked: ONNX Runtime's threads and locks do not survive a fork.
    return ProcessPoolExecutor(workers, get_context("spawn"), _start, (job,))


def _start(job: Job) -> None:
    global _worker
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the driver's to handle
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    _worker = Worker(job)


def _leave_with_parent() -> None:
    """A driver that was killed cannot tell its workers, who would wait for ever."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _answer(chunk: Chunk) -> list[Row | None]:
    assert _worker is not None, "the pool's initializer ran"
    return _worker.answer(chunk)
