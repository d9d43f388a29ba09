"""How long one control step takes, all of it, and what memory an hour of them takes."""

from __future__ import annotations

import gc
import time
import tracemalloc
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnimj.bench.driven import (
    PASSING_SLIP,
    SLIP_AND_WEAK_MOTOR,
    Driven,
    driven_mission,
    once_more,
    whole_controller,
)
from omnimj.parameters import read_robot

HOUR = 3600.0
_WARM = 5  # missions before memory is looked at: caches and windows fill
_STATM = Path("/proc/self/statm")  # pages: size, resident, …
_KB = 1024.0


def step_times(driven: Driven) -> np.ndarray:
    """Time of each step from measurement to command, over the mission that was driven, shape (k,) [s].

    The plant is not there: what it gave is replayed, and the commands are those of the drive.
    """
    controller = whole_controller(driven.robot)
    state = controller.start(driven.measurements[0])
    times = np.empty(len(driven.measurements))
    for k, (measurement, target) in enumerate(zip(driven.measurements, driven.targets, strict=True)):
        begin = time.perf_counter()
        _, state = controller.step(state, measurement, target)
        times[k] = time.perf_counter() - begin
    return times


@dataclass(frozen=True)
class Growth:
    """Memory over many steps."""

    seconds: float
    """Of robot time between both looks at memory [s]."""
    grown: float
    """By how much memory was more at the later one [kB]."""
    diagnoses: int
    """That were told in the end."""

    @property
    def per_hour(self) -> float:
        """In proportion [kB]."""
        return self.grown * HOUR / self.seconds


def memory_growth(driven: Driven, passes: int, longest: float = float("inf")) -> Growth:
    """Drives a mission again and again with one controller, and looks at memory.

    By resident pages where the system tells them (everything counts, native code too), else by what Python
    has allocated.

    Args:
      driven: A mission that begins and ends in health.
      passes: How often, after five that are not counted.
      longest: Wall time after which it ends with the pass that is being driven [s].
    """
    resident = _STATM.exists()
    if not resident:
        tracemalloc.start()
    try:
        controller = whole_controller(driven.robot)
        state = controller.start(driven.measurements[0])
        for number in range(_WARM):
            state = once_more(controller, state, driven, number)
        before, done, begin = _memory(), 0, time.perf_counter()
        while done < passes and (done == 0 or time.perf_counter() - begin < longest):
            state = once_more(controller, state, driven, _WARM + done)
            done += 1
        return Growth(done * driven.duration, _memory() - before, len(state.diagnoses))
    finally:
        if not resident:
            tracemalloc.stop()


def _memory() -> float:
    """In use [kB]."""
    gc.collect()
    if not _STATM.exists():
        return tracemalloc.get_traced_memory()[0] / _KB
    from resource import getpagesize  # where there is a /proc there is this

    return float(_STATM.read_text().split()[1]) * getpagesize() / _KB


def measure_control(rounds: int, duration: float, hours: float, longest: float) -> dict[str, float]:
    """One control step [µs], and what an hour of them adds to memory [kB].

    Args:
      rounds: How often the mission is timed; the round counts that the machine disturbed least.
      duration: Of the mission [s].
      hours: Robot time over which memory is looked at [h].
      longest: Wall time after which that ends [s].
    """
    robot = read_robot()
    driven = driven_mission(robot, duration, SLIP_AND_WEAK_MOTOR)
    times = [1e6 * step_times(driven) for _ in range(rounds)]
    passes = max(1, round(hours * HOUR / duration))
    growth = memory_growth(driven_mission(robot, duration, PASSING_SLIP), passes, longest)
    return {
        "control_step_median_us": min(float(np.median(one)) for one in times),
        "control_step_p999_us": min(float(np.quantile(one, 0.999)) for one in times),
        "control_growth_kb_per_hour": growth.per_hour,
        "control_growth_hours": growth.seconds / HOUR,
    }
