"""How long one control step takes, all of it, and what memory an hour of them takes."""

from __future__ import annotations

import gc
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnimj.bench.driven import (
    SLIP_AND_WEAK_MOTOR,
    Driven,
    driven_mission,
    once_more,
    whole_controller,
)
from omnimj.parameters import read_robot

HOUR = 3600.0
WARM = 5
"""Missions before memory is looked at: caches and windows fill."""
_PAGES = Path("/proc/self/smaps_rollup")  # counted one by one; the figures of statm are off by some pages
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


def memory_growth(
    driven: Driven, passes: int, longest: float = float("inf"), memory: Callable[[], float] | None = None
) -> Growth:
    """Drives a mission again and again with one controller, and looks at memory.

    Every diagnosis that is remembered takes 0.2 kB, of up to `past.REMEMBERED`: in health nothing may grow.

    Args:
      driven: A mission that begins and ends in health.
      passes: How often, after `WARM` that are not counted.
      longest: Wall time after which it ends with the pass that is being driven [s].
      memory: What is looked at [kB]; what Python and numpy have allocated when None.
    """
    look = _traced if memory is None else memory
    if memory is None:
        tracemalloc.start()
    try:
        controller = whole_controller(driven.robot)
        state = controller.start(driven.measurements[0])
        for number in range(WARM):
            state = once_more(controller, state, driven, number)
        before, done, begin = look(), 0, time.perf_counter()
        while done < passes and (done == 0 or time.perf_counter() - begin < longest):
            state = once_more(controller, state, driven, WARM + done)
            done += 1
        return Growth(done * driven.duration, look() - before, len(state.diagnoses))
    finally:
        if memory is None:
            tracemalloc.stop()


def _traced() -> float:
    """In whole kB: looking itself takes some bytes."""
    gc.collect()
    return float(round(tracemalloc.get_traced_memory()[0] / _KB))


def pages() -> float:
    """Memory of this process, native code's too, in pages that the heap has touched [kB]; Linux only."""
    gc.collect()
    (line,) = (line for line in _PAGES.read_text().splitlines() if line.startswith("Anonymous:"))
    return float(line.split()[1])


def measure_control(rounds: int, duration: float, hours: float, longest: float) -> dict[str, float]:
    """One control step [µs], and what an hour of them adds to memory [kB].

    Args:
      rounds: How often the mission is timed. Every step counts by its median over them, since the same step
        does the same work: what others do on the machine meanwhile is left out.
      duration: Of the mission [s].
      hours: Robot time over which memory is looked at [h].
      longest: Wall time after which that ends [s].
    """
    robot = read_robot()
    driven = driven_mission(robot, duration, SLIP_AND_WEAK_MOTOR)
    times = 1e6 * np.median([step_times(driven) for _ in range(rounds)], axis=0)
    calm, passes = driven_mission(robot, duration), max(1, round(hours * HOUR / duration))
    growth = memory_growth(calm, passes, 0.5 * longest)
    found = {
        "control_step_median_us": float(np.median(times)),
        "control_step_p999_us": float(np.quantile(times, 0.999)),
        "control_growth_kb_per_hour": growth.per_hour,
        "control_growth_hours": growth.seconds / HOUR,
    }
    if _PAGES.exists():
        found["control_pages_kb_per_hour"] = memory_growth(calm, passes, 0.5 * longest, pages).per_hour
    return found
