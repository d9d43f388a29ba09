"""Steps a plant and fills one row per control step; whatever ends it early keeps what was recorded."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnimj.errors import LinkLost, SimulationError
from omnimj.plant.interface import Plant
from omnimj.signals import Array, CurrentCommand, Measurement, RigMeasurement, Trace

SNAPSHOT_PERIOD = 0.02
"""Time between two poses of the 3-D recording [s]."""

Progress = Callable[[int, int], None]
"""Called now and then with the rows done and the rows in all."""
Snapshot = Callable[[float, Array], None]
"""Called every `SNAPSHOT_PERIOD` with the time [s] and the plant's pose (the twin's qpos)."""
Rows = Callable[[tuple[str, ...], Array], None]
"""Called now and then with the columns' names and the rows since the call before, shape (m, columns)."""

LARGEST = 1e10
"""A truth beyond it, in whatever unit, is no robot's: MuJoCo gives up there too."""

_PROGRESS_EVERY = 100  # [rows]
_STOPPED = 0.1  # [s] in a step that takes longer code is compiled, or the machine stands still


@dataclass(frozen=True)
class Watch:
    """Who looks on while the loop runs."""

    progress: Progress | None = None
    snapshot: Snapshot | None = None
    rows: Rows | None = None


NOBODY = Watch()
"""Nobody does."""


def record(
    plant: Plant,
    measurement: Measurement | RigMeasurement,
    control: Callable[[int, Array, Any], CurrentCommand],
    names: tuple[str, ...],
    rows: int,
    watch: Watch,
    about: Mapping[str, Any],
) -> Trace:
    """Steps the plant and fills one row per step: first `names` (by `control`), then the plant's truth.

    A failure inside is a value, so that nothing recorded is lost; the outermost call raises.
    """
    names = (*names, *plant.truth_names)
    if len(set(names)) != len(names):
        raise ValueError(f"two columns share a name: {sorted(n for n in set(names) if names.count(n) > 1)}")
    # filled before the clock runs: memory that is only promised takes up to 8 ms when a row first touches it
    table = np.full((rows, len(names)), np.nan)
    first_truth = len(names) - len(plant.truth_names)
    show = _showing(plant, watch, names, table)
    done, begin = 0, time.perf_counter()
    last = begin
    interrupted, failure = False, None
    try:
        for k, row in enumerate(table):
            command = control(k, row, measurement)
            truth = plant.truth()
            row[first_truth:] = truth
            check_truth(plant.truth_names, truth.tolist())
            done = k + 1
            show(done, row[0])
            if done < rows:
                measurement = plant.step(command)
            now = time.perf_counter()
            if now - last > _STOPPED:
                begin += now - last
            last = now
    except KeyboardInterrupt:
        interrupted = True
    except (SimulationError, ArithmeticError, LinkLost) as error:
        interrupted, failure = True, f"at {done * plant.period:.4f} s: {error}"
    wall = time.perf_counter() - begin
    columns = np.ascontiguousarray(table[:done].T)
    simulated = max(done - 1, 0) * plant.period
    described = {
        **about,
        "interrupted": interrupted,
        "failure": failure,
        "realtime_factor": simulated / wall if wall > 0.0 else 0.0,
    }
    return Trace(dict(zip(names, columns, strict=True)), described)


def _showing(
    plant: Plant, watch: Watch, names: tuple[str, ...], table: Array
) -> Callable[[int, float], None]:
    """What to do after each row: progress and rows now and then, a snapshot every `SNAPSHOT_PERIOD`."""
    progress, snapshot, pose, total = watch.progress, watch.snapshot, getattr(plant, "pose", None), len(table)
    each = max(1, round(SNAPSHOT_PERIOD / plant.period))

    def show(done: int, now: float) -> None:
        if snapshot is not None and pose is not None and (done - 1) % each == 0:
            snapshot(float(now), pose())
        if done % _PROGRESS_EVERY and done != total:
            return
        if progress is not None:
            progress(done, total)
        if watch.rows is not None:
            watch.rows(names, table[(done - 1) // _PROGRESS_EVERY * _PROGRESS_EVERY : done])

    return show


def check_truth(names: tuple[str, ...], truth: list[float]) -> None:
    """Refuses a truth that is not finite or beyond `LARGEST`; for twenty numbers the quickest way.

    Raises:
      SimulationError: It names the columns.
    """
    if (
        math.isfinite(sum(truth))
        and max(truth, default=0.0) <= LARGEST
        and min(truth, default=0.0) >= -LARGEST
    ):
        return
    broken = [
        f"{name} is {value:g}" for name, value in zip(names, truth, strict=True) if not abs(value) <= LARGEST
    ]
    raise SimulationError(", ".join(broken))
