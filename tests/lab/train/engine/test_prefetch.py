from __future__ import annotations

import threading
import time

import pytest

from doorway3ds.lab.train.engine.prefetch import ahead


def test_loads_come_in_order_from_another_thread() -> None:
    threads: set[int] = set()

    def load(n: int) -> int:
        threads.add(threading.get_ident())
        return n * n

    assert list(ahead(load, range(7))) == [n * n for n in range(7)]
    assert len(threads) == 1 and threading.get_ident() not in threads
    assert list(ahead(load, [])) == []


def test_it_is_never_more_than_its_depth_ahead_and_closing_drops_the_rest() -> None:
    loaded: list[int] = []
    found = ahead(lambda n: loaded.append(n), range(100), depth=2)
    next(found)
    next(found)
    time.sleep(0.05)
    found.close()
    assert loaded == list(range(len(loaded))) and 2 <= len(loaded) <= 4


def test_an_error_comes_out_at_its_place() -> None:
    found = ahead(lambda n: 1 // (2 - n), [0, 1, 2, 3])
    assert (next(found), next(found)) == (0, 1)
    with pytest.raises(ZeroDivisionError):
        next(found)
