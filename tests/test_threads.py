"""Threads end before Python does, whoever forgot them; what hangs is left, and said to be."""

from __future__ import annotations

import subprocess
import sys
import threading
import time

import pytest

from doorway3ds.threads import Worker, end_all

# At its end Python kills threads as they return from native code, which ends the process as well.
BUSY = """
import sys, threading, time
import cv2, numpy as np
from doorway3ds.threads import Worker

image, stopping = np.zeros((1500, 1500, 3), np.uint8), threading.Event()

def run():
    while not stopping.is_set():
        cv2.GaussianBlur(image, (31, 31), 0)
    print("ended", flush=True)

"""


def python(script: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", BUSY + script], capture_output=True, text=True, timeout=60
    )


def test_a_thread_in_native_code_that_nobody_closed_does_not_crash_the_end() -> None:
    ran = python("Worker(run, 'blur', stopping.set); time.sleep(0.2)")
    assert (ran.returncode, ran.stdout) == (0, "ended\n")


def test_the_command_line_ends_beside_a_thread_that_hangs_in_native_code() -> None:
    ran = python(
        "from doorway3ds.cli import main\n"
        "main.run = lambda arguments: Worker(run, 'blur') and print('all said') or 3\n"
        "main.main()"
    )
    assert (ran.returncode, ran.stdout, ran.stderr) == (3, "all said\n", "")


def test_closing_stops_and_waits_but_not_for_what_hangs() -> None:
    stopping, released = threading.Event(), threading.Event()
    worker = Worker(stopping.wait, "waits", stopping.set)
    assert worker.alive
    worker.close(None)
    worker.close()
    assert not worker.alive
    hanging = Worker(released.wait, "hangs")
    start = time.monotonic()
    hanging.close(0.05)
    assert hanging.alive and 0.04 < time.monotonic() - start < 2
    assert not end_all(0.01)
    released.set()
    assert end_all(5) and not hanging.alive


def test_a_thread_may_close_itself_and_may_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    failed: list[type[BaseException]] = []
    monkeypatch.setattr(threading, "excepthook", lambda args: failed.append(args.exc_type))
    started = threading.Event()

    def run() -> None:
        started.wait(5)
        worker.close(None)
        raise ZeroDivisionError

    worker = Worker(run, "own end")
    started.set()
    assert end_all(5) and failed == [ZeroDivisionError]
