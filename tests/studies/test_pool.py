"""Many workers: what is kept, what is broken off, what is reported."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from omnimj.errors import SimulationError
from omnimj.studies.workers import run_in_workers


def quiet(phrase: str, share: float) -> None:
    pass


def interrupted_after(count: int):
    def report(phrase: str, share: float) -> None:
        if phrase == f"sleeping: {count} of 6":
            raise KeyboardInterrupt

    return report


def test_started_workers_end_at_once_after_ctrl_c_and_what_was_done_is_kept():
    kept: list[str] = []
    tasks = {f"task_{k}": (0.05 if k < 2 else 60.0,) for k in range(6)}

    def work(workers):
        workers.run_all(
            time.sleep, tasks, lambda name, _: kept.append(name), "sleeping", interrupted_after(2)
        )

    assert run_in_workers(work, 2) is False  # a thread that stumbles would fail this test
    assert sorted(kept) == ["task_0", "task_1"]
    assert not children_after(10.0)


def children_after(limit: float) -> list:
    """Return the child processes alive after at most `limit` seconds.

    Joining them once is not enough: the pool's own thread joins them too, and a process that thread has just
    reaped is counted as alive until its exit code is noted.
    """
    end = time.monotonic() + limit
    while (children := multiprocessing.active_children()) and time.monotonic() < end:
        time.sleep(0.01)
    return children


ORPHANS = """
import time
from omnimj.studies.workers import run_in_workers

def work(workers):
    workers.run_all(time.sleep, {"a": (600.0,), "b": (600.0,)}, print, "sleeping", print)

if __name__ == "__main__":
    run_in_workers(work, 2)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_workers_whose_parent_is_killed_leave_with_it(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(ORPHANS, encoding="utf-8")
    parent = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.DEVNULL)
    children = Path(f"/proc/{parent.pid}/task/{parent.pid}/children")

    def alive(pids: list[str]) -> list[str]:
        found = [Path(f"/proc/{pid}/stat") for pid in pids]
        return [str(one) for one in found if one.exists() and one.read_text().split()[2] != "Z"]

    try:
        begun: list[str] = []
        for _ in range(300):  # two workers and what keeps count of their resources
            begun = children.read_text().split()
            if len(begun) == 3:
                break
            time.sleep(0.1)
        assert len(begun) == 3
        time.sleep(1.0)  # until they work
    finally:
        parent.kill()
        parent.wait()
    for _ in range(100):
        if not alive(begun):
            break
        time.sleep(0.1)
    assert not alive(begun)


def test_an_executor_of_the_caller_stays_open_and_drops_what_was_not_begun():
    kept: list[str] = []
    with ThreadPoolExecutor(1) as executor:
        tasks = {f"task_{k}": (0.05,) for k in range(6)}

        def work(workers):
            workers.run_all(
                time.sleep, tasks, lambda name, _: kept.append(name), "sleeping", interrupted_after(1)
            )

        assert run_in_workers(work, 1, executor) is False
        assert executor.submit(int, "7").result() == 7
    assert len(kept) == 1


def test_an_error_on_purpose_is_kept_in_the_place_of_a_result_and_any_other_is_raised():
    kept: dict[str, object] = {}

    def fail(kind):
        raise kind("it broke")

    with ThreadPoolExecutor(1) as executor:
        assert run_in_workers(
            lambda w: w.run_all(fail, {"a": (SimulationError,)}, kept.__setitem__, "", quiet), 1, executor
        )
        assert kept == {"a": {"error": "it broke"}}
        with pytest.raises(ZeroDivisionError):
            run_in_workers(
                lambda w: w.run_all(fail, {"a": (ZeroDivisionError,)}, kept.__setitem__, "", quiet),
                1,
                executor,
            )
