"""Simulations side by side in threads: order, errors, and no threads beyond the cores."""

from __future__ import annotations

import os
import threading
import time

import pytest

from omnimj.estimate.threads import map_in_threads


def test_results_come_in_the_order_of_the_arguments():
    def slow(k: int) -> int:
        time.sleep(0.002 * (7 - k))
        return k * k

    assert map_in_threads(slow, range(7)) == [k * k for k in range(7)]
    assert map_in_threads(slow, range(7), threads=1) == [k * k for k in range(7)]
    assert map_in_threads(slow, []) == []


def test_callers_side_by_side_and_within_each_other_share_the_threads():
    seen: set[int] = set()

    def inner(k: int) -> int:
        seen.add(threading.get_ident())
        time.sleep(0.001)
        return k

    def outer(k: int) -> list[int]:
        return map_in_threads(inner, range(k, k + 20))

    callers, found = [], {}
    for name in range(4):
        call = threading.Thread(target=lambda n=name: found.update({n: map_in_threads(outer, range(5))}))
        callers.append(call)
        call.start()
    for call in callers:
        call.join(timeout=60.0)
    assert found == {name: [list(range(k, k + 20)) for k in range(5)] for name in range(4)}
    assert len(seen) <= len(callers) + max((os.cpu_count() or 1) - 1, 1)


@pytest.mark.parametrize("kind", [ValueError, KeyboardInterrupt])
def test_an_error_ends_the_work(kind):
    done = []

    def breaks(k: int) -> int:
        if k == 3:
            raise kind("three")
        time.sleep(0.01)
        done.append(k)
        return k

    with pytest.raises(kind):
        map_in_threads(breaks, range(200), threads=1)
    assert done == [0, 1, 2]
    with pytest.raises(kind):
        map_in_threads(breaks, range(4), threads=2)
