"""Rig runs for tests: through the sensor chain, out of the twin or out of the independent integrator."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rig_reference import integrate
from sampled_sensors import sample

from omnimj.parameters import Floor, Rig
from omnimj.plant.mujoco.twin import RigTwin
from omnimj.plant.sensors import RigSensors
from omnimj.recording.dataset import Dataset, Run
from omnimj.simulate.driving import drive_rig

CURRENTS = (0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.2, 1.35, 1.5)
"""Of the identification tests, section 4.2 [A]."""
COLUMNS = ("time", "current", "wheel_speed", "carriage_speed", "carriage_acceleration", "lateral_speed")


def twin_run(
    rig: Rig,
    floor: Floor,
    current: float | np.ndarray,
    seed: int = 0,
    mass: float | None = None,
    lateral_speed: float = 0.0,
    duration: float = 1.05,
    name: str = "",
) -> Run:
    """The twin's run at a constant current, or at a current per millisecond."""
    mass = rig.rig.masses[0] if mass is None else mass
    twin = RigTwin(rig, floor, mass=mass, lateral_speed=lateral_speed, seed=seed)
    if not isinstance(current, np.ndarray):
        current = np.full(round(duration / twin.period) + 1, current)
    trace = drive_rig(twin, current)
    columns = {column: trace[column] for column in (*COLUMNS, "current_target")}
    name = name or f"{floor.name}_{round(100 * current[-1]):03d}_{mass:.0f}_{100 * lateral_speed:+.0f}_{seed}"
    return Run(name, columns, {}, {"floor": floor.name, "mass": mass})


def reference_run(rig: Rig, floor: Floor, current: float, seed: int = 0, duration: float = 1.05) -> Run:
    """The same out of LSODA, which shares no code with the package; only the sensors are the package's."""
    mass = rig.rig.masses[0]
    time, speed, wheel = integrate(rig, floor, mass, current, duration)
    sensors = RigSensors(rig.sensors, rig.motor, 1e-3, seed)
    felt = np.gradient(speed, time)
    rows = [
        sample(sensors, t, current, w, v, a, 0.0) for t, w, v, a in zip(time, wheel, speed, felt, strict=True)
    ]
    columns = {column: np.array([getattr(row, column) for row in rows]) for column in COLUMNS}
    return Run(f"{floor.name}_{round(100 * current):03d}", columns, {}, {"floor": floor.name, "mass": mass})


def dataset(*runs: Run, plant: str = "quarter_rig") -> Dataset:
    """Runs as a dataset that lies nowhere."""
    return Dataset(Path("made"), plant, runs)


def friction_curve(floor: Floor, slip: np.ndarray) -> np.ndarray:
    """F/F_N of Eqs. 3.42-3.43 once the bristle has settled, written afresh."""
    q = floor.numbers
    fall = np.exp(-np.sqrt(np.abs(slip) / q["V_s"]))
    return q["mu_c"] + (q["mu_s"] - q["mu_c"]) * fall + q["sigma_2"] * slip
