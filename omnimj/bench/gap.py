"""Speed of the gap workflow: its time, and its ratio to the bare simulations that it makes."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.estimate.gap.find import find_gap
from omnimj.estimate.gap.plants import find_plant, read_machine
from omnimj.estimate.replay.interface import Replay, Setting
from omnimj.parameters import read_floors
from omnimj.recording.read_dataset import read_dataset
from omnimj.simulate.suites.catalogue import find_suite
from omnimj.simulate.suites.recording import RecordingConfig, record_suite

SEED = 5


def measure_gap(rig_runs: int, axis_runs: int) -> dict[str, float]:
    """Measure the search for a hidden effect on the rig and on the linear axis.

    Args:
      rig_runs: Number of runs of the rig, 1.8 s each.
      axis_runs: Number of runs of the axis.

    Returns:
      `gap_rig_seconds`, `gap_axis_seconds`: wall time of a search without compilation.
      `gap_axis_log_seconds`: length of the axis runs. `gap_simulation_ratio`: CPU time of the rig's search
      over that of as many bare simulations.
    """
    with tempfile.TemporaryDirectory() as folder:
        rig, axis = Path(folder) / "rig", Path(folder) / "axis"
        _record("rig_mixed", rig, {"rail_viscous": {"coefficient": 2.0}}, rig_runs, "planar")
        _record("axis_moves", axis, {"viscous": {"coefficient": 60.0}}, axis_runs, None)
        find_gap(rig, seed=SEED)  # compiles the kernels
        wall, cpu = time.perf_counter(), time.process_time()
        count = find_gap(rig, seed=SEED).simulations
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        bare = _simulation_seconds(_replay(rig))
        find_gap(axis, seed=SEED)
        start = time.perf_counter()
        find_gap(axis, seed=SEED)
        axis_wall = time.perf_counter() - start
        length = sum(float(run.columns["time"][-1]) for run in read_dataset(axis).runs)
    return {
        "gap_rig_seconds": wall,
        "gap_simulation_ratio": cpu / (count * bare),
        "gap_axis_seconds": axis_wall,
        "gap_axis_log_seconds": length,
    }


def _record(
    suite: str, folder: Path, effects: Mapping[str, Mapping[str, Any]], runs: int, plant: str | None
) -> None:
    config = RecordingConfig(folder, seed=SEED, plant=plant, effects=effects)
    record_suite(find_suite(suite), config, choose=lambda planned: planned[:runs])


def _replay(dataset: Path) -> Replay:
    read = read_dataset(dataset)
    return find_plant(read.plant).make_replay(read, read_machine(read.plant, None), read_floors())


def _simulation_seconds(replay: Replay, rounds: int = 20) -> float:
    """CPU time of one simulation of all runs [s]."""
    setting = Setting(np.array([b.nominal for b in replay.base]))
    start = time.process_time()
    replay.simulate([setting] * rounds)
    return (time.process_time() - start) / rounds
