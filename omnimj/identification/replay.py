"""Measured currents drive a simulated rig, run by run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from scipy.signal import lfilter

from omnimj.effects import applied
from omnimj.errors import InputError, SimulationError
from omnimj.identification.records import ReplayedRun
from omnimj.identification.rig_run import RigRun
from omnimj.parameters import Floor, Rig
from omnimj.parameters.floor import find_floor
from omnimj.physics import rig as rig_equations
from omnimj.plant.planar_rig import PlanarRig
from omnimj.signals import Array, CurrentCommand
from omnimj.twin.twin import RigTwin

PLANTS = ("twin", "planar")
"""Plants that a measured current can drive."""


def replay(rig: Rig, floors: Mapping[str, Floor], run: RigRun, plant: str, nominal: float) -> ReplayedRun:
    """One run: from rest, or from the measured speeds where the data begin in motion.

    Both speeds of the simulation pass the sensors' speed filter, so that they are late as the measured ones.

    Args:
      rig: The model, with its effects.
      floors: By name.
      run: On the rig's control period.
      plant: `twin` or `planar`.
      nominal: The run's set value, to be kept beside it [A].

    Raises:
      InputError: No such floor, or a mass that the rig cannot have.
      SimulationError: The simulation left finite numbers.
    """
    simulated = _plant(rig, floors, run, plant)
    try:
        speeds = _driven(simulated, run, _true_current(rig, run))
    finally:
        simulated.close()
    if not np.isfinite(speeds).all():
        raise SimulationError(f"run {run.name}: the {plant} plant left finite numbers")
    lag = math.exp(-run.period / rig.sensors.speed_filter)
    late, _ = lfilter([1.0 - lag], [1.0, -lag], speeds, axis=0, zi=lag * speeds[:1])
    late = np.asarray(late)
    radius, measured = rig.wheel.radius, run.measured
    carriage = np.where(measured[:, 2], run.carriage_speed, np.nan)
    wheel = np.where(measured[:, 1], run.wheel_speed, np.nan)
    return ReplayedRun(
        run=run.name,
        plant=plant,
        floor=run.floor,
        mass=run.mass,
        current=nominal,
        lateral_speed=run.lateral_speed,
        time=run.time,
        measured_speed=carriage,
        simulated_speed=late[:, 0],
        measured_rim=radius * wheel,
        simulated_rim=radius * late[:, 1],
        carriage_rms=_rms(late[:, 0] - carriage),
        wheel_rms=_rms(late[:, 1] - wheel),
    )


def _plant(rig: Rig, floors: Mapping[str, Floor], run: RigRun, plant: str) -> PlanarRig | RigTwin:
    floor = find_floor(run.floor, f"run {run.name}: floor", floors)
    if run.mass <= rig.wheel.mass:
        rule = f"must be above wheel.mass, {rig.wheel.mass:g}"
        raise InputError(f"run {run.name}: mass", f"found {run.mass:g}", rule)
    asked: dict[str, Any] = {"mass": run.mass, "lateral_speed": run.lateral_speed}
    asked |= {"ideal_sensors": True, "measured_current": True}
    if plant == "planar":
        return PlanarRig(rig, floor.name, floors=floors, **asked)
    return RigTwin(rig, floor, **asked)


def _true_current(rig: Rig, run: RigRun) -> Array:
    """The motor's current: what the monitor said, with the model's effects on the monitor undone [A]."""
    change = applied(rig).channels.get("current")
    if change is None:
        return run.current
    if change.scale == 0.0:
        raise InputError(f"{rig.file}: effects", "the current monitor has no gain", "its scale must not be 0")
    on_time = np.interp(run.time + change.delay, run.time, run.current)
    return (on_time - change.offset) / change.scale


def _driven(plant: PlanarRig | RigTwin, run: RigRun, current: Array) -> Array:
    """Carriage and wheel speed at every sample, shape (k, 2) [m/s, rad/s]."""
    speeds = np.empty((len(current), 2))
    measured = plant.reset()
    if not run.starts_at_rest:
        begin = slice(0, max(1, round(0.005 / run.period)))
        _set_moving(plant, float(run.carriage_speed[begin].mean()), float(run.wheel_speed[begin].mean()))
        speeds[0] = run.carriage_speed[begin].mean(), run.wheel_speed[begin].mean()
    else:
        speeds[0] = measured.carriage_speed, measured.wheel_speed
    for k in range(1, len(current)):
        # the sample at the period's end: the loop is quicker than a period, that current flowed most of it
        measured = plant.step(CurrentCommand(current[k : k + 1]))
        speeds[k] = measured.carriage_speed, measured.wheel_speed
    return speeds


def _set_moving(plant: PlanarRig | RigTwin, carriage_speed: float, wheel_speed: float) -> None:
    """Gives a plant at its start the speeds with which the data begin."""
    if isinstance(plant, RigTwin):
        for joint, speed in (("rail", carriage_speed), ("wheel_1_axle", wheel_speed)):
            plant.mj_data.qvel[int(plant.mj_model.joint(joint).dofadr[0])] = speed
        mujoco.mj_forward(plant.mj_model, plant.mj_data)
        return
    plant._state[rig_equations.SPEED] = carriage_speed
    plant._state[rig_equations.WHEEL_SPEED] = wheel_speed


def _rms(error: Array) -> float:
    counted = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(counted**2))) if len(counted) else math.nan
