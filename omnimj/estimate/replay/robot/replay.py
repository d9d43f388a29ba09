"""Replay of a robot's missions by the planar equations, without knowledge of the pose.

`current_i`: the wheels turn as measured, and the current needed by their motion is compared with the measured
one; in a closed loop that is where a gap shows. The same replay gives accelerometer and gyro. `yaw`:
integrated by the equations, each window from its own initial heading.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from omnimj.effects import ROBOT, apply_effects
from omnimj.errors import InputError
from omnimj.estimate.replay.base_parameters import (
    AdjustedMachine,
    add_effects,
    adjusted_machine,
    base_parameters,
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
from omnimj.estimate.replay.robot import kernels as native
from omnimj.estimate.replay.robot.kernel_parameters import (
    kernel_parameters,
    lean_shares,
    roller_tables,
    sensor_readings,
)
from omnimj.estimate.replay.robot.runs import (
    STEP,
    RobotRuns,
    experiment_currents,
    regimes,
    robot_experiments,
    robot_runs,
    synthetic_run,
    variable_spans,
)
from omnimj.estimate.threads import map_in_threads
from omnimj.parameters import Floor, Robot
from omnimj.parameters.parts import Sensors
from omnimj.physics.planar import PlanarModel
from omnimj.recording.dataset import Dataset
from omnimj.signals import Array

_WIDTH, _MOST = 0.1, 80  # [m] of a strip, and largest number of strips
_PART = 0.3  # share of the friction removed in a strip
_SUBSTEPS = 4  # substeps of a candidate run: 1 ms, a quarter of a wheel's time constant on the floor
_COMPARED = [c for c in range(native.CHANNELS) if not native.SPEED <= c < native.ACCELERATION]
"""Columns of the blocks that are compared: the wheels turn as measured."""
_PHASES = 12  # trial angles over a pitch
_FLAT = np.zeros((3, 0))
"""Roller tables of wheels without rollers."""
_LAGS = ("wheel_speed", "acceleration", "yaw_rate", "yaw")
"""Kinds of channels that may lag behind the currents."""
_HIDDEN = (
    "supply_sag",
    "creep_ratio",
    "soft_floor",
    "load_sensitivity",
    "load_offset",
    "heading_offset",
    "pose_scale",
)
"""Effects whose consequences the measured currents already contain, or that only a measured pose shows."""


def likely_patch(
    span: tuple[float, float], noise: Array, mismatch: Array, moved: Callable[[Array], list[Array]]
) -> tuple[float, float]:
    """Start and end of the stretch of floor that explains most of the mismatch [m].

    Args:
      span: Lowest and highest place visited by a wheel [m].
      noise: Noise of each channel, shape (channels,).
      mismatch: Measured − simulated, shape (blocks, channels).
      moved: Changes of the prediction by patches (scale, start, end), shape (strips, 3) → (blocks,
        channels) each.
    """
    count = int(np.clip((span[1] - span[0]) / _WIDTH, 3, _MOST))
    edges = np.linspace(*span, count + 1)
    strips = np.stack([np.full(count, 1.0 - _PART), edges[:-1], edges[1:]], axis=1)
    columns = np.stack([np.nan_to_num(change / noise).ravel() for change in moved(strips)], axis=1)
    slope = columns.T @ np.nan_to_num(mismatch / noise).ravel()
    gram = columns.T @ columns
    above = np.concatenate(([0.0], np.cumsum(slope)))
    corner = np.zeros((count + 1, count + 1))
    corner[1:, 1:] = np.cumsum(np.cumsum(gram, axis=0), axis=1)
    first, last = np.triu_indices(count + 1, 1)
    size = corner[last, last] - corner[first, last] - corner[last, first] + corner[first, first]
    gain = (above[last] - above[first]) ** 2 / np.maximum(size, 1e-9 * max(float(gram.max()), 1e-30))
    best = int(np.argmax(gain))
    return float(edges[first[best]]), float(edges[last[best]])


class RobotReplay:
    """Replay of a dataset of missions; ground truth in the logs is ignored."""

    plant = ROBOT
    most_effects, backward_elimination, notes = MOST_EFFECTS, False, ()
    structures: tuple[Structure, ...] = ()

    def __init__(self, dataset: Dataset, robot: Robot, floors: Mapping[str, Floor]):
        """Prepare the runs.

        Raises:
          InputError: A run without floor, or none that is long enough.
          UnknownNameError: Unknown floor.
        """
        self._robot, self._floors = robot, dict(floors)
        self._runs = robot_runs(dataset, robot, self._floors)
        self.channels = _channels(robot.sensors)
        self.segments, self.measured = self._runs.segments, self._runs.measured[:, _COMPARED]
        self.base: tuple[BaseParameter, ...] = base_parameters(robot, self._floors, self._runs.floor, _LAGS)
        self._spans = variable_spans(self._runs, robot)
        self.curves: Mapping[str, float] = dict.fromkeys((*self._spans, "wheel_angle"), 1.0)
        candidates = candidate_effects(ROBOT, self._spans, _HIDDEN, robot.wheel_count)
        possible = tuple(f for f in candidates if self._fits(f))
        self._by_label = {c.label: c for c in possible}
        self._rollers, self._phases = roller_tables(robot), np.empty(0)
        self.candidates: tuple[CandidateEffect, ...] = tuple(self._with_place(f) for f in possible)

    def _fits(self, candidate: CandidateEffect) -> bool:
        """True if this effect can be added to those of the model."""
        try:
            add_effects(self._robot, [(candidate, np.array([s.typical for s in candidate.parameters]))])
        except InputError:
            return False
        return True

    def _with_place(self, candidate: CandidateEffect) -> CandidateEffect:
        """Candidate with trial values of its place, since the edges of a patch converge from nearby only."""
        if candidate.effect != "floor_patch":
            return candidate
        base = np.array([b.nominal for b in self.base])
        (plain,) = self.simulate([Setting(base)])

        def moved(patches: Array) -> list[Array]:
            return [p - plain for p in self.simulate([Setting(base, {candidate.label: v}) for v in patches])]

        rough = np.array([c.equation_error for c in self.channels])
        start, end = likely_patch(self._spans["position"], rough, self.measured - plain, moved)
        tried = {"start": (start,), "end": (end,)}
        shapes = tuple(
            dataclasses.replace(s, trials=tried.get(s.name, s.trials)) for s in candidate.parameters
        )
        return dataclasses.replace(candidate, parameters=shapes)

    def simulate(self, settings: Sequence[Setting]) -> list[Array]:
        """Block means of the channels by the equations, shape (blocks, channels) per setting."""
        return map_in_threads(lambda s: self._replay(s, self._runs), settings)

    def based(self, setting: Setting) -> AdjustedMachine[Robot]:
        """Robot with the base parameters and effects of a setting."""
        return adjusted_machine(self._robot, self._floors, self.base, self._by_label, setting)

    def _kernel_parameters(
        self, setting: Setting, runs: RobotRuns
    ) -> tuple[native.KernelParameters, AdjustedMachine[Robot]]:
        based, curve = self.based(setting), None
        if setting.curve is not None:
            over, force = setting.curve
            curve = over, force, self._spans.get(over, (0.0, 1.0))
        mass_scale = based.machine.body.mass / self._robot.body.mass
        return kernel_parameters(based, runs, mass_scale, curve), based

    def _replay(
        self, setting: Setting, runs: RobotRuns, tables: Array = _FLAT, phases: Array | None = None
    ) -> Array:
        """Block means by the equations, with rollers where their tables and phases are given."""
        own, _ = self._kernel_parameters(setting, runs)
        if phases is None:
            phases = np.zeros((len(runs.log.stretches), native.WHEELS))
        blocks = np.empty((len(runs.measured), native.CHANNELS))
        sampling = native.Sampling(STEP, runs.size, runs.window)
        native.replay(runs.log, own, native.Rollers(tables, phases), sampling, blocks)
        return blocks[:, _COMPARED]

    def simulate_twin(self, setting: Setting) -> Array:
        """Block means with the twin's additions to the planar equations: rows of rollers, and springs.

        The twin itself cannot be restarted in the middle of a mission, and open loop it drifts away. The
        action of its rollers on a wheel is geometry (`roller_tables`); the angle at which a roller was lowest
        when a log began is found where the measured currents fit best.

        Returns:
          Shape (blocks, channels).
        """
        if not self._phases.size:
            self._phases = self._find_phases(setting)
        found = self._replay(setting, self._runs, self._rollers, self._phases)
        for c, lean in zip(
            (native.ACCELERATION, native.ACCELERATION + 1), lean_shares(self._robot), strict=True
        ):
            found[:, _COMPARED.index(c)] *= 1.0 + lean
        return found

    def _find_phases(self, setting: Setting) -> Array:
        """Phase of the rollers of every wheel at the start of every stretch, shape (stretches, 4) [rad]."""
        shape = (len(self._runs.log.stretches), native.WHEELS)
        step = self._rollers[2, 0] / _PHASES
        wheels = [_COMPARED.index(native.CURRENT + i) for i in range(native.WHEELS)]

        def misfit(turn: int) -> Array:
            phases = np.full(shape, turn * step)
            off = self._replay(setting, self._runs, self._rollers, phases) - self.measured
            return np.stack([np.nansum(off[p.first : p.last, wheels] ** 2, axis=0) for p in self.segments])

        sums = np.stack(map_in_threads(misfit, range(_PHASES)))
        best = sums.argmin(axis=0)

        def near(k: int) -> Array:
            return np.take_along_axis(sums, ((best + k) % _PHASES)[None], axis=0)[0]

        bend = near(-1) - 2.0 * near(0) + near(1)
        return (best + 0.5 * (near(-1) - near(1)) / np.maximum(bend, 1e-30)) * step

    def regimes(self) -> Mapping[str, tuple[str, Array]]:
        """Variable → unit and its measured value in every block, shape (blocks,)."""
        return regimes(self._runs, self._robot)

    def candidate_experiments(self) -> tuple[Experiment, ...]:
        """Runs that a user could make."""
        return robot_experiments(self._runs.floor)

    def predict(self, settings: Sequence[Setting], experiment: Experiment) -> list[Array]:
        """Predict block means of a run driven under the first setting, shape (blocks, channels) each."""
        runs = self._experiment_runs(settings[0], experiment)
        return map_in_threads(lambda s: self._replay(s, runs), settings)

    def _experiment_runs(self, setting: Setting, experiment: Experiment) -> RobotRuns:
        """Candidate run under one setting, driven from rest by given currents."""
        mass = self._robot.body.mass + float(experiment.run["added_mass"])
        floor, current = str(experiment.run["floor"]), experiment_currents(self._robot, experiment)
        values = np.zeros((len(current), native.CHANNELS))
        runs = synthetic_run(values, floor, mass, self._runs)
        own, based = self._kernel_parameters(setting, runs)
        floors = np.repeat(own.floors, native.WHEELS, axis=0)
        model = PlanarModel(own.bodies[0], own.wheels[0], own.motors, floors, own.terms, False)
        native.drive(current, model, STEP, _SUBSTEPS, values)
        delay, scale, offset = sensor_readings(apply_effects(based.machine))
        places = np.arange(len(values))
        for c in range(native.CHANNELS):
            values[:, c] = scale[c] * np.interp(places - delay[c] / STEP, places, values[:, c]) + offset[c]
        return synthetic_run(values, floor, mass, self._runs)


def _channels(sensors: Sensors) -> tuple[Channel, ...]:
    """Channels; equation errors are RMS over 20 ms on a healthy twin, without its sensors' noise."""
    wheels = range(1, native.WHEELS + 1)
    bias, drift = sensors.accelerometer_bias, sensors.gyro_bias
    return (
        *(Channel(f"current_{i}", "A", f"current that wheel {i} needs", 0.0, 0.018) for i in wheels),
        Channel("acceleration_x", "m/s2", "acceleration ahead", bias, 0.03),
        Channel("acceleration_y", "m/s2", "acceleration to the left", bias, 0.03),
        Channel("yaw_rate", "rad/s", "yaw rate", drift, 0.002),
        Channel("yaw", "rad", "heading within a window", 0.0, 0.0003),
    )
