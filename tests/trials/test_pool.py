"""Many workers: what is kept, what is broken off, what is told."""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from omnimj.errors import SimulationError
from omnimj.trials.pool import with_workers


def quiet(phrase: str, share: float) -> None:
    pass


def interrupted_after(count: int):
    def report(phrase: str, share: float) -> None:
        if phrase == f"sleeping: {count} of 6":
            raise KeyboardInterrupt

    return report


def test_workers_of_its_own_end_at_once_after_ctrl_c_and_what_was_done_is_kept():
    kept: list[str] = []
    tasks = {f"task_{k}": (0.05 if k < 2 else 60.0,) for k in range(6)}

    def work(workers):
        workers.do_all(time.sleep, tasks, lambda name, _: kept.append(name), "sleeping", interrupted_after(2))

    assert with_workers(work, 2) is False  # a thread that stumbles would fail this test
    assert sorted(kept) == ["task_0", "task_1"]
    for child in multiprocessing.active_children():
        child.join(10.0)
    assert not multiprocessing.active_children()


def test_a_strange_executor_stays_open_and_is_rid_of_what_was_not_begun():
    kept: list[str] = []
    with ThreadPoolExecutor(1) as executor:
        tasks = {f"task_{k}": (0.05,) for k in range(6)}

        def work(workers):
            workers.do_all(
                time.sleep, tasks, lambda name, _: kept.append(name), "sleeping", interrupted_after(1)
            )

        assert with_workers(work, 1, executor) is False
        assert executor.submit(int, "7").result() == 7
    assert len(kept) == 1


def test_an_error_on_purpose_is_kept_in_the_place_of_a_result_and_any_other_is_raised():
    kept: dict[str, object] = {}

    def fail(kind):
        raise kind("it broke")

    with ThreadPoolExecutor(1) as executor:
        assert with_workers(
            lambda w: w.do_all(fail, {"a": (SimulationError,)}, kept.__setitem__, "", quiet), 1, executor
        )
        assert kept == {"a": {"error": "it broke"}}
        with pytest.raises(ZeroDivisionError):
            with_workers(
                lambda w: w.do_all(fail, {"a": (ZeroDivisionError,)}, kept.__setitem__, "", quiet),
                1,
                executor,
            )
