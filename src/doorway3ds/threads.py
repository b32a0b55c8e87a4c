"""Threads that end before Python does.

A thread that is inside OpenCV or ONNX Runtime while Python takes itself apart ends the process by
signal 6 or 11, so that a script believes that its work failed.
"""

from __future__ import annotations

import atexit
import threading
import time
from collections.abc import Callable

_working: set[Worker] = set()


class Worker:
    """A thread that has been started, until `close`, or at the latest until Python ends.

    run: its work. stop: makes `run` return soon; called from other threads, perhaps twice.
    """

    def __init__(
        self, run: Callable[[], None], name: str, stop: Callable[[], object] = lambda: None
    ) -> None:
        self._run, self._stop = run, stop
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        _working.add(self)
        self._thread.start()

    @property
    def alive(self) -> bool:
        return self._thread.is_alive()

    def close(self, within_s: float | None = 2.0) -> None:
        """Stops the thread and waits for it; one that hangs in a driver is left at that.

        within_s: None: however long it takes.
        """
        self._stop()
        if self._thread is not threading.current_thread():
            self._thread.join(within_s)

    def _work(self) -> None:
        try:
            self._run()
        finally:
            _working.discard(self)


def end_all(within_s: float = 5.0) -> bool:
    """Closes the workers that nobody has closed; whether all have ended within that time."""
    deadline = time.monotonic() + within_s
    left = list(_working)
    for worker in left:
        worker._stop()
    for worker in left:
        worker.close(max(0.0, deadline - time.monotonic()))
    return not any(worker.alive for worker in left)


atexit.register(end_all)
