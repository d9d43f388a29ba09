"""Replay of rig runs: equations with effects, driven by measured currents; the MuJoCo twin as reference."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from omnimj.effects import RIG, AppliedEffects, ChannelEffect, apply_effects, find_effect
from omnimj.estimate.replay.base_parameters import (
    AdjustedMachine,
    adjusted_machine,
    base_parameters,
    with_free_curve,
)
from omnimj.estimate.replay.interface import (
    MOST_EFFECTS,
    BaseParameter,
    CandidateEffect,
    Channel,
    Experiment,
    Setting,
    Structure,
    candidate_effects,
)
from omnimj.estimate.replay.motor_force import changes_of, motor_forces
from omnimj.estimate.replay.repeating_force import repeating_forces, with_repeating_force
from omnimj.estimate.replay.rig import kernels as native
from omnimj.estimate.replay.rig.runs import (
    RigRuns,
    experiment_runs,
    regimes,
    rig_experiments,
    rig_runs,
    variable_spans,
)
from omnimj.estimate.rig_runs import CHANNELS, drive_by_currents
from omnimj.estimate.threads import map_in_threads
from omnimj.parameters import Floor, Rig
from omnimj.physics.motor import driven_by_measured_current, motor_parameters
from omnimj.physics.rig import rig_parameters
from omnimj.physics.wheel import packed
from omnimj.plant.mujoco.twin import RigTwin
from omnimj.recording.dataset import Dataset
from omnimj.signals import Array

_LEAST_SCALE = 1e-3
_SIMULATED = CHANNELS[: native.OUTPUTS]
_STEPS = 2  # per sample: 0.5 ms
_UNCLIPPED = 1e6  # V and A: a measured current has passed its amplifier already


def true_current(runs: RigRuns, channels: Mapping[str, ChannelEffect], lags: Mapping[str, float]) -> Array:
    """Motor current [A]: the monitor's reading without its scale, offset and delay, shape (samples,)."""
    change = channels.get("current", ChannelEffect())
    scale = math.copysign(max(abs(change.scale), _LEAST_SCALE), change.scale)
    current = (runs.current - change.offset) / scale
    return _delayed(runs, current, -change.delay - lags.get("current", 0.0))


def true_angle(runs: RigRuns, changed: AppliedEffects, lags: Mapping[str, float]) -> Array:
    """Wheel angle [rad] from the measured speed, without the scale, lag and delay of that channel.

    A speed filter with time constant τ delays the angle by τ ω, and so does a delay.

    Returns:
      Shape (samples,); (0,) for runs that were not measured.
    """
    change = changed.channels.get("wheel_speed", ChannelEffect())
    late = changed.machine.sensors.speed_filter + change.delay + lags.get("wheel_speed", 0.0)
    scale = math.copysign(max(abs(change.scale), _LEAST_SCALE), change.scale)
    return (runs.turned[:, 1] + late * runs.turned[:, 0]) / scale


def _delayed(runs: RigRuns, series: Array, late: float) -> Array:
    """Delay a series of all runs, with linear interpolation between samples."""
    if late == 0.0:
        return series
    moved = np.empty_like(series)
    for begin, end in zip(runs.first[:-1], runs.first[1:], strict=True):
        places = np.arange(end - begin)
        moved[begin:end] = np.interp(places - late / runs.period, places, series[begin:end])
    return moved


def sensor_block_means(
    out: Array, runs: RigRuns, changed: AppliedEffects, lags: Mapping[str, float]
) -> Array:
    """Block means of the simulated sensors, shape (blocks, channels).

    Args:
      out: Result of `kernels.replay_runs`, shape (samples, OUTPUTS).
    """
    sensors, h = changed.machine.sensors, runs.period
    chain = {
        "wheel_speed": sensors.speed_filter,
        "carriage_speed": sensors.speed_filter,
        "carriage_acceleration": 1.0 / (2.0 * math.pi * sensors.accelerometer_bandwidth),
    }
    result = np.empty((runs.blocks_first[-1], runs.measured.shape[1]))

    def observe(column: int, series: Array, name: str, lag: float, late: float) -> None:
        change = changed.channels.get(name, ChannelEffect())
        delay = (change.delay + late) / h
        means = np.empty(len(result))
        sensor = native.SensorModel(lag / h, delay, float(change.scale), float(change.offset))
        native.observe(series, native.BlockLayout(runs.first, runs.blocks_first, runs.size), sensor, means)
        result[:, column] = means

    for c, name in enumerate(_SIMULATED):
        observe(c, np.ascontiguousarray(out[:, c]), name, chain[name], lags.get(name, 0.0))
    if runs.target is not None:
        (motor,) = changed.motors((motor_parameters(changed.machine.motor),))
        wheel = np.ascontiguousarray(out[:, native.WHEEL])
        lag = changed.machine.motor.current_loop
        # the set value may be logged a sample before it acts; the wheel's speed limits it when it does
        target = _delayed(runs, runs.target, lags.get("current_target", 0.0))
        layout = native.BlockLayout(runs.first, runs.blocks_first, runs.size)
        delivered = native.delivered_current(target, wheel, np.array(motor), changed.terms[0], layout, h)
        observe(len(_SIMULATED), delivered, "current", lag, 0.0)
    return result


class RigReplay:
    """Replay of a dataset of rig runs; implements `replay.interface.Replay`."""

    plant = "quarter_rig"
    most_effects, backward_elimination, notes = MOST_EFFECTS, False, ()

    def __init__(self, dataset: Dataset, rig: Rig, floors: Mapping[str, Floor]):
        """Prepare the runs.

        Raises:
          InputError: A run without floor.
          UnknownNameError: Unknown floor.
        """
        self._rig, self._floors = rig, dict(floors)
        self._runs = rig_runs(dataset, rig, self._floors)
        lagging = (*_SIMULATED, "current", *(("current_target",) if self._runs.target is not None else ()))
        self.base: tuple[BaseParameter, ...] = base_parameters(rig, self._floors, self._runs.floor, lagging)
        self.segments, self.measured = self._runs.segments, self._runs.measured
        self.channels = _channels(rig, self._runs.target is not None)
        self._spans = variable_spans(self._runs)
        moved = ("speed", "position", "time", *(("lateral_speed",) if self._runs.lateral.any() else ()))
        self.curves: Mapping[str, float] = dict.fromkeys(moved, 1.0)
        hidden = () if self._runs.target is not None else ("supply_sag",)
        self.candidates: tuple[CandidateEffect, ...] = candidate_effects(self.plant, self._spans, hidden)
        self._by_label = {c.label: c for c in self.candidates}
        self._turn = 2.0 * math.pi * rig.wheel.radius
        self._fastest = max(map(abs, self._spans["speed"]))
        self._repeating, self._motor_forces = repeating_forces(self._turn), motor_forces(self._fastest)
        self.structures: tuple[Structure, ...] = (*self._repeating, *self._motor_forces)

    def simulate(self, settings: Sequence[Setting]) -> list[Array]:
        """Block means of the channels by the equations, shape (blocks, channels) per setting."""
        return map_in_threads(lambda s: self._equations(s, self._runs, measured=True), settings)

    def based(self, setting: Setting) -> AdjustedMachine[Rig]:
        """Rig with the base parameters and effects of a setting, those of the library."""
        known = {label: values for label, values in setting.effects.items() if label in self._by_label}
        setting = dataclasses.replace(setting, effects=known)
        return adjusted_machine(self._rig, self._floors, self.base, self._by_label, setting)

    def _equations(self, setting: Setting, runs: RigRuns, measured: bool) -> Array:
        """Block means by the equations, driven by a measured current or by a set value."""
        based = self.based(setting)
        changed = apply_effects(based.machine)
        curve = None if setting.curve is None else (*setting.curve, self._spans[setting.curve[0]])
        terms = with_free_curve(changed.terms[:1], curve)[0]
        terms = with_repeating_force(terms, self._repeating, setting.effects, self._turn)
        current = true_current(runs, changed.channels, based.lags) if measured else runs.current
        (motor,) = changed.motors((motor_parameters(changed.machine.motor),))
        motor = np.array(driven_by_measured_current(motor) if measured else motor)
        rows, floor_rows = _rows(runs, changed, based)
        out = np.empty((len(current), native.OUTPUTS))
        log = native.Log(current, runs.lateral, runs.first, runs.start, true_angle(runs, changed, based.lags))
        parameters = native.KernelParameters(
            rows, motor, floor_rows, terms, changes_of(self._motor_forces, setting.effects), self._fastest
        )
        native.replay_runs(log, parameters, runs.period / _STEPS, _STEPS, out)
        return sensor_block_means(out, runs, changed, based.lags)

    def simulate_twin(self, setting: Setting) -> Array:
        """Block means by the MuJoCo twin, every run from its start, shape (blocks, channels)."""
        based = self.based(setting)
        changed = apply_effects(based.machine)
        current = true_current(self._runs, changed.channels, based.lags)
        edges = [slice(*ends) for ends in itertools.pairwise(self._runs.first.tolist())]
        driven = map_in_threads(
            lambda k: _drive_twin(based, self._runs, k, current[edges[k]]), range(len(edges))
        )
        return sensor_block_means(np.concatenate(driven), self._runs, changed, based.lags)

    def regimes(self) -> Mapping[str, tuple[str, Array]]:
        """Variable → unit and its measured value in every block, shape (blocks,)."""
        return regimes(self._runs)

    def candidate_experiments(self) -> tuple[Experiment, ...]:
        """Runs that a rig can make."""
        return rig_experiments(self._rig, self._runs.floor)

    def predict(self, settings: Sequence[Setting], experiment: Experiment) -> list[Array]:
        """Predict block means of a candidate run within the supply limits, shape (blocks, channels) each."""
        runs = experiment_runs(experiment, self._runs)
        return map_in_threads(lambda s: self._equations(s, runs, measured=False), settings)


def _rows(runs: RigRuns, changed: AppliedEffects, based: AdjustedMachine[Rig]) -> tuple[Array, Array]:
    """Packed rigs and packed floors of all runs."""
    scale, slope = float(changed.radius_scale[0]), changed.slope[0]
    masses = (runs.mass * based.mass_scale + changed.added_mass).tolist()
    rows = [packed(rig_parameters(changed.machine, mass, scale, 1.0, slope)) for mass in masses]
    by_name = {name: changed.floor(based.floors[name]).row for name in set(runs.floor)}
    return np.stack(rows), np.stack([by_name[name] for name in runs.floor])


def _drive_twin(based: AdjustedMachine[Rig], runs: RigRuns, k: int, current: Array) -> Array:
    """Drive one run on the twin with ideal sensors, shape (samples, OUTPUTS)."""
    motor = dataclasses.replace(based.machine.motor, supply=_UNCLIPPED, current_limit=_UNCLIPPED)
    lateral = float(np.median(runs.lateral[runs.first[k] : runs.first[k + 1]]))
    mass = float(runs.mass[k] * based.mass_scale)
    floor = based.floors[runs.floor[k]]
    plain = {
        n: v for n, v in based.machine.effects.items() if find_effect(n, RIG, "effects").where != "sensors"
    }
    rig = dataclasses.replace(based.machine, motor=motor, effects=plain)
    twin = RigTwin(rig, floor, mass, lateral, ideal_sensors=True)
    carriage, wheel = runs.start[k].tolist()
    return drive_by_currents(twin, current, (carriage, wheel))


def _channels(rig: Rig, has_target: bool) -> tuple[Channel, ...]:
    bias = rig.sensors.accelerometer_bias
    channels = (
        Channel("wheel_speed", "rad/s", "speed of the wheel"),
        Channel("carriage_speed", "m/s", "speed of the carriage"),
        Channel("carriage_acceleration", "m/s2", "acceleration of the carriage", bias),
    )
    if not has_target:
        return channels
    return (*channels, Channel("current", "A", "current that the amplifier drives"))
