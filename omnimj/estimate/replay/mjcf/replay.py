"""Replay of any machine's logs for the search for missing effects.

`force:MOTOR` or `control:MOTOR`: the input that the measured motion needs, by inverse dynamics, against the
measured one. `balance:JOINT`: the force that a joint without actuator lacks along its measured motion.
`position:JOINT`: free windows start from the measured state and are driven by the measured inputs alone.
`velocity:JOINT` and `sensor:NAME`, where measured: compared with the measured motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter1d

from omnimj.estimate.replay.interface import (
    MOST_EFFECTS,
    CandidateEffect,
    Channel,
    Experiment,
    Segment,
    Setting,
    Structure,
)
from omnimj.estimate.replay.mjcf import kernels
from omnimj.estimate.replay.mjcf.along import Dynamics, Motion, effective_inputs
from omnimj.estimate.replay.mjcf.columns import Input, measured_parts, stated_masses
from omnimj.estimate.replay.mjcf.contacts import free_runs
from omnimj.estimate.replay.mjcf.delays import shifted
from omnimj.estimate.replay.mjcf.experiments import added_masses, machine_experiments, moved_log
from omnimj.estimate.replay.mjcf.filters import add_filtered, same_filter
from omnimj.estimate.replay.mjcf.kernels import (
    ARMATURE,
    CURVE_HIGH,
    CURVE_JOINT,
    CURVE_KIND,
    CURVE_LOW,
    FORCE_PER_UNIT,
    GEAR,
    OVER_POSITION,
    OVER_SPEED,
    OVER_TIME,
    PLAY,
    POSITION_GAIN,
)
from omnimj.estimate.replay.mjcf.laws import LawMaker, Laws
from omnimj.estimate.replay.mjcf.log import MachineLog, read_machine_log
from omnimj.estimate.replay.mjcf.remembered import Remembered
from omnimj.estimate.replay.mjcf.scope import scope_notes
from omnimj.estimate.replay.mjcf.settings import (
    JointSpan,
    base_parameters,
    free_curves,
    joint_span,
    machine_candidates,
)
from omnimj.estimate.replay.mjcf.window_errors import (
    NominalWindows,
    predictable_blocks,
    sufficient_substeps,
)
from omnimj.estimate.replay.stretches import block_means
from omnimj.estimate.threads import map_in_threads
from omnimj.plant.mujoco.machine import Machine
from omnimj.plant.mujoco.quantities import is_hinge
from omnimj.recording.dataset import Dataset
from omnimj.signals import Array

WINDOW = 0.5
"""Length of a free window [s]."""
_STEPS = 6000  # steps of MuJoCo per simulation, for which windows are chosen evenly
_MORE_EFFECTS = 2  # in a model, per joint
_KEPT = 256  # simulated settings that are remembered
_HALF, _LEAST_SHARE = 0.5, 1e-6  # rows of a block, and of a filter, in which the balance holds
_EQUATION = 0.003  # known error of the inverse dynamics, over the RMS input or acceleration
_SLOWEST_RATE, _FASTEST_RATE = 2.0 * np.pi, 100.0  # [rad/s] of the filter of missing forces
_NOTED = 0.01  # share of the windows
_KINDS = {"speed": OVER_SPEED, "position": OVER_POSITION, "time": OVER_TIME}


class MachineReplay:
    """Replay of a dataset of any machine; implements `replay.interface.Replay`."""

    backward_elimination = False
    structures: tuple[Structure, ...] = ()

    def __init__(self, dataset: Dataset, machine: Machine):
        """Prepare the logs.

        Raises:
          InputError: A joint or input was not measured, no run is long enough, or bodies touch in all.
          UnknownNameError: A column or a stated mass names a part that the MJCF file does not have.
        """
        self._machine, self.plant = machine, machine.plant
        self.parts = measured_parts(dataset, machine)
        self._runs, contacts = free_runs(dataset.runs, machine, dataset.path)
        self.log = log = read_machine_log(self._runs, self.parts, WINDOW)
        stated = [stated_masses(self._runs[k], machine, dataset.path) for k in log.run_of_stretch]
        self._dynamics = Dynamics(machine, log, self.parts.sensors, stated)
        self._windows = self._chosen_windows()
        self._known: Remembered[Array] = Remembered(_KEPT)
        period = min(float(np.median(np.diff(run.time))) for run in self._runs)
        self.base = base_parameters(machine, period)
        self._maker = LawMaker(machine, self.parts, machine.uncertain, {}, log.rest_speed)
        nominal = Setting(np.array([b.nominal for b in self.base]))
        self.spans = self._spans(nominal)
        self.smoothing = self._smoothing_of(nominal)
        """Width σ of the filter of each joint's missing force, shape (j,) [rows]; 0: none was measured."""
        self._holds = log.valid & ~self._turning()
        self._shares = np.ones(log.valid.shape)
        for j in np.flatnonzero(self.smoothing > 0.0):
            shares = self._smoothed(self._holds[:, j].astype(float), self.smoothing[j])
            self._shares[:, j] = np.maximum(shares, _LEAST_SHARE)
        self.candidates: tuple[CandidateEffect, ...] = machine_candidates(machine, self.parts, self.spans)
        self._maker = replace(self._maker, candidates={c.label: c for c in self.candidates})
        self.curves: Mapping[str, float] = free_curves(self.spans)
        self.most_effects = MOST_EFFECTS + _MORE_EFFECTS * len(self.parts.joints)
        self.segments = self._segments()
        self._inputs = self._compared_inputs()
        laws = self._maker.make(self.base, nominal)
        commands = effective_inputs(laws, log)
        declared = NominalWindows(
            self._dynamics, laws, self._dynamics.motion(laws, commands), commands, self._windows
        )
        self._predictable = predictable_blocks(declared, log)
        self.substeps = sufficient_substeps(declared, self._predictable, self._window_errors())
        """Steps per row of the free windows."""
        self.measured = self._measured()
        self.channels = self._channels()
        scope = scope_notes(machine, self.parts, self.spans, log, self.candidates)
        self.notes = (*self.parts.notes, *scope, *contacts, *self._shortened())
        """Notes on columns and rows that are not used, excited joints and effects that are not sought."""

    def simulate(self, settings: Sequence[Setting]) -> list[Array]:
        """Block means of the channels, shape (blocks, channels) per setting."""
        return map_in_threads(self._remembered, settings)

    def _remembered(self, setting: Setting) -> Array:
        """Block means under a setting; a search comes back to its last ones."""
        effects = tuple((label, np.asarray(values).tobytes()) for label, values in setting.effects.items())
        curve = None if setting.curve is None else (setting.curve[0], np.asarray(setting.curve[1]).tobytes())
        key = np.asarray(setting.base, float).tobytes(), effects, curve
        if (found := self._known.get(key)) is None:
            found = self._simulate(setting)
            self._known.keep(key, found)
        return found

    def simulate_twin(self, setting: Setting) -> None:
        """None: the replay is that of MuJoCo already."""

    def regimes(self) -> Mapping[str, tuple[str, Array]]:
        """Variable → unit and its measured value in every block, shape (blocks,)."""
        log, found = self.log, {}
        for j, name in enumerate(self.parts.joints):
            unit = "rad" if is_hinge(self._machine.mj_model, name) else "m"
            columns = np.stack([log.position[:, j], log.speed[:, j], log.acceleration[:, j]], axis=1)
            place, speed, acceleration = self._means(columns).T
            before = f"{name} " if len(self.parts.joints) > 1 else ""
            found[f"{before}position"] = (unit, place)
            found[f"{before}speed"] = (f"{unit}/s", speed)
            found[f"{before}acceleration"] = (f"{unit}/s2", acceleration)
            direction, since = self._means(self._direction(j)).T
            found[f"{before}direction"] = ("1", np.rint(direction))
            found[f"{before}reversal"] = ("s", since)
            own = self.parts.inputs[j]
            if own is not None:
                force = ("N.m" if unit == "rad" else "N") if own.is_force else "1"
                name = "force" if own.is_force else "command"
                found[f"{before}{name}"] = (force, self._means(log.inputs[:, j : j + 1])[:, 0])
        found["time"] = ("s", self._means(log.times[:, None])[:, 0])
        return {**found, **self._stated()}

    def _direction(self, j: int) -> Array:
        """Direction of a joint, 0 at rest, and time since it last reversed, shape (rows, 2) [1, s]."""
        log, found = self.log, np.empty((len(self.log.times), 2))
        moving = np.abs(log.speed[:, j]) >= self._maker.rest_speed[j]
        found[:, 0] = np.where(moving, np.sign(log.speed[:, j]), 0.0)
        for first, last, _, _ in log.stretches:
            found[first:last, 1] = log.period * kernels.since_reversal(found[first:last, 0])
        return found

    def _stated(self) -> dict[str, tuple[str, Array]]:
        """Masses of bodies that differ between the runs."""
        log, found = self.log, {}
        stated = [stated_masses(run, self._machine, run.name) for run in self._runs]
        for part in dict.fromkeys(part for masses in stated for part in masses):
            own = np.array([masses.get(part, self._machine.values[part]) for masses in stated])
            if np.ptp(own) > 0.0:
                rows = np.empty((len(log.times), 1))
                for (first, last, _, _), run in zip(log.stretches, log.run_of_stretch, strict=True):
                    rows[first:last] = own[run]
                found[f"mass of {part[1]}"] = ("kg", self._means(rows)[:, 0])
        return found

    def candidate_experiments(self) -> tuple[Experiment, ...]:
        """Motions of one joint that a user could make."""
        return machine_experiments(self._machine, self.spans)

    def predict(self, settings: Sequence[Setting], experiment: Experiment) -> list[Array]:
        """Predict the inputs that a motion needs, (blocks, channels) per setting; other channels NaN."""
        log = moved_log(self.log, self.parts.joints, self.spans, experiment)
        stated = added_masses(self._machine, experiment)
        dynamics = Dynamics(self._machine, log, self.parts.sensors, stated)
        return [self._predict(setting, log, dynamics) for setting in settings]

    def input_balances(self) -> dict[str, tuple[Array, Array, Array]]:
        """Column of an input → force by its command, force of the links and speed where the balance holds.

        Both forces are those of the machine as it is declared, electric damping taken out. The force by which
        a position servo answers its own position counts as one of the links: a wrong scale or sign is that of
        the whole command, most of which this position balances.
        """
        log, laws = self.log, self._maker.make(self.base, Setting(np.array([b.nominal for b in self.base])))
        motion, commands = self._dynamics.motion(laws), effective_inputs(laws, self.log)
        found = {}
        for j, own in enumerate(self.parts.inputs):
            if own is not None and log.valid[:, j].any():
                rows, law = log.valid[:, j], laws.joints[j]
                links = motion.rigid[rows, j] + law[ARMATURE] * motion.acceleration[rows, j]
                links -= law[GEAR] ** 2 * law[POSITION_GAIN] * motion.position[rows, j]
                force = law[FORCE_PER_UNIT] * commands[rows, j]
                found[own.column] = force, links, motion.speed[rows, j]
        return found

    def _simulate(self, setting: Setting) -> Array:
        laws, curve = self._maker.make(self.base, setting), self._curve(setting)
        commands = effective_inputs(laws, self.log)
        motion = self._dynamics.motion(laws, commands)
        missing = _missing(laws, self.log, motion, curve, commands)
        joints = len(self.parts.joints)
        free = self._dynamics.windows(laws, motion, curve, commands, self._windows, self.substeps)
        columns = []
        missing = self._balanced(missing)
        driven = (commands, motion.position, motion.balanced_speed, self.log.enabled)
        kernels.to_input_errors(laws.joints, *driven, missing)
        means = self._means(self._inputs + missing)
        columns += list(means.T)
        for j, name in enumerate(self.parts.joints):
            reading = laws.channel(f"position:{name}")
            place = free[:, j] - reading.delay * free[:, joints + j]
            columns.append(reading.scale * place + reading.offset)
        columns += self._readings(laws, motion)
        found = np.stack(columns, axis=1)
        found[np.isnan(self.measured)] = np.nan
        return found

    def _balanced(self, missing: Array) -> Array:
        """Missing forces, low-passed where the force was measured and the encoder is the noisier sensor.

        Only rows in which the balance holds pass the filter: what is wrong elsewhere does not spread.
        """
        found = missing.copy()
        for j in np.flatnonzero(self.smoothing > 0.0):
            kept = np.where(self._holds[:, j], missing[:, j], 0.0)
            found[:, j] = self._smoothed(kept, self.smoothing[j]) / self._shares[:, j]
        return found

    def _smoothed(self, values: Array, width: float) -> Array:
        """Values low-passed within each stretch, shape (n,)."""
        found = np.empty(len(values))
        for first, last, _, _ in self.log.stretches:
            found[first:last] = gaussian_filter1d(values[first:last], width, mode="nearest")
        return found

    def _smoothing_of(self, nominal: Setting) -> Array:
        """Width σ of the filter of each joint's missing force, shape (j,) [rows]: 0 without a measured force.

        Its rate ω balances the noise of force and position, ω² = σ_F/(M σ_q), as a steady-state Kalman filter
        of an inertia M under white force noise does.
        """
        log, laws = self.log, self._maker.make(self.base, nominal)
        motion, found = self._dynamics.motion(laws), np.zeros(len(self.parts.joints))
        for j, own in enumerate(self.parts.inputs):
            if own is not None and own.is_force:
                bends = motion.acceleration[:, j]
                links = float(bends @ motion.rigid[:, j]) / max(float(bends @ bends), 1e-300)
                inertia = max(links + laws.joints[j, ARMATURE], 1e-12)
                noise = log.input_noise[j] * laws.joints[j, FORCE_PER_UNIT]
                rate = np.sqrt(noise / (inertia * log.position_noise[j]))
                found[j] = 1.0 / (np.clip(rate, _SLOWEST_RATE, _FASTEST_RATE) * log.period)
        return found

    def _readings(self, laws: Laws, motion: Motion) -> list[Array]:
        """Predicted velocities and sensors, block means."""
        series = [
            (f"velocity:{name}", motion.balanced_speed[:, j])
            for j, name in enumerate(self.parts.joints)
            if self.parts.has_velocity[j]
        ]
        series += [(f"sensor:{name}", motion.readings[:, s]) for s, name in enumerate(self.parts.sensors)]
        found = []
        for name, values in series:
            reading = laws.channel(name)
            if reading.delay:
                late = np.empty(len(values))
                rows = -reading.delay / self.log.period
                shifted(np.ascontiguousarray(values), self.log.stretches, rows, False, late)
                values = late
            found.append(reading.scale * self._means(values[:, None])[:, 0] + reading.offset)
        return found

    def _predict(self, setting: Setting, log: MachineLog, dynamics: Dynamics) -> Array:
        laws, curve = self._maker.make(self.base, setting), self._curve(setting)
        motion = dynamics.motion(laws)
        needed = _missing(laws, log, motion, curve, np.zeros(log.inputs.shape))
        kernels.to_inputs(laws.joints, motion.position, motion.balanced_speed, log.enabled, needed)
        for j, law in enumerate(laws.inputs):
            if law is not None:
                change = np.gradient(needed[:, j], log.period)
                needed[:, j] += (law.delay + law.lag - law.reading.delay + laws.clock) * change
        rows = np.full((log.blocks, len(self.channels)), np.nan)
        blocks = np.empty((log.blocks, needed.shape[1]))
        block_means(np.ascontiguousarray(needed), log.windows, log.size, blocks)
        rows[:, : needed.shape[1]] = blocks
        return rows

    def _curve(self, setting: Setting) -> Array:
        found = kernels.no_curve()
        if setting.curve is not None:
            name, values = setting.curve
            joint, _, kind = name.rpartition(" ")
            joint = joint or self.parts.joints[0]
            found[CURVE_JOINT], found[CURVE_KIND] = self.parts.joints.index(joint), _KINDS[kind]
            span = self.spans[joint]
            ends = {
                "speed": (-span.speed, span.speed),
                "position": (span.low, span.high),
                "time": (0.0, float(self.log.times.max())),
            }
            found[CURVE_LOW], found[CURVE_HIGH] = ends[kind]
            found[4:] = values
        return found

    def _spans(self, nominal: Setting) -> dict[str, JointSpan]:
        """Range of the motion and force of each joint, under the machine as it is declared."""
        log, laws = self.log, self._maker.make(self.base, nominal)
        motion = self._dynamics.motion(laws)
        inputs = effective_inputs(laws, log) * laws.joints[:, FORCE_PER_UNIT]
        found = {}
        for j, name in enumerate(self.parts.joints):
            driven = self.parts.inputs[j] is not None and laws.joints[j, POSITION_GAIN] == 0.0
            own = inputs[:, j] if driven else motion.rigid[:, j]  # a servo's force is a small difference
            noise = (float(log.position_noise[j]), float(log.speed_noise[j]))
            columns = (log.position[:, j], log.speed[:, j], log.acceleration[:, j])
            found[name] = joint_span(*columns, own, noise)
        return found

    def _chosen_windows(self) -> NDArray[np.int64]:
        """Windows that are simulated, evenly over the logs."""
        windows = self.log.windows
        steps = int((windows[:, 1] - windows[:, 0]).sum()) * self._dynamics.substeps
        count = max(1, min(len(windows), round(len(windows) * _STEPS / max(steps, 1))))
        return windows[np.unique(np.linspace(0, len(windows) - 1, count).astype(int))]

    def _means(self, columns: Array) -> Array:
        means = np.empty((self.log.blocks, columns.shape[1]))
        block_means(np.ascontiguousarray(columns), self.log.windows, self.log.size, means)
        return means

    def _measured(self) -> Array:
        log = self.log
        holding, least = self._means(self._holds.astype(float)), np.where(self.smoothing > 0.0, _HALF, 1.0)
        inputs = np.where(holding >= least - 1e-9, self._means(self._inputs), np.nan)
        places = np.full((log.blocks, len(self.parts.joints)), np.nan)
        rows = kernels.window_rows(self._windows, log.size)
        places[rows] = np.where(self._predictable, self._means(log.position), np.nan)[rows]
        velocity = log.velocity[:, np.array(self.parts.has_velocity)]
        return np.hstack([inputs, places, self._means(velocity), self._means(log.sensors)])

    def _turning(self) -> NDArray[np.bool_]:
        """Rows around a rest or a reversal of joints with a measured force, shape (n, j).

        The filter of the motion mixes rows before and after it, in which dry friction differs.
        """
        log = self.log
        found = np.zeros(log.valid.shape, bool)
        for j in np.flatnonzero(self.smoothing > 0.0):
            near = round(log.reach[j] / log.period)
            for first, last, _, _ in log.stretches:
                part, speed = slice(int(first), int(last)), log.speed[first:last, j]
                turns = np.abs(speed) < self._maker.rest_speed[j]
                turns[1:] |= speed[1:] * speed[:-1] < 0.0
                found[part, j] = binary_dilation(turns, iterations=near) if turns.any() else turns
        return found

    def _shortened(self) -> Iterator[str]:
        """Yield a note for each joint of whose windows a part is left out."""
        inside = self._predictable[kernels.window_rows(self._windows, self.log.size)]
        for name, share in zip(self.parts.joints, 1.0 - inside.mean(axis=0), strict=True):
            if share > _NOTED:
                words = f"position of {name}: {100.0 * share:.2g} % of its windows is left out"
                yield f"{words} because unstable motion amplifies the error of their start"

    def _compared_inputs(self) -> Array:
        """Measured inputs; of position servos the following error u + g (k_q q + k_v dq/dt)/k, shape (n, j).

        k is the gain, g the gear, k_q and k_v those of the affine bias. Forces are a small part of such a
        command; this way it is compared as exactly as they are.
        """
        found = self.log.inputs.copy()
        for j, own in enumerate(self.parts.inputs):
            if own is not None and _answers_position(own):
                answer = own.drive.position_gain * self.log.position[:, j]
                answer += own.drive.velocity_gain * self.log.speed[:, j]
                found[:, j] += own.drive.gear / own.drive.gain * answer
        return found

    def _window_errors(self) -> Array:
        """Known error of the positions in free windows, by the noise of start and forces, shape (j,)."""
        bends = np.array([self.spans[name].acceleration for name in self.parts.joints])
        drift = self.log.position_noise + 0.3 * WINDOW * self.log.speed_noise
        return drift + _EQUATION * bends * WINDOW**2 / np.sqrt(20.0)  # RMS of a t²/2

    def _channels(self) -> tuple[Channel, ...]:
        """Channels in the order of the columns of `measured`."""
        m, log = self._machine.mj_model, self.log
        units = ["rad" if is_hinge(m, name) else "m" for name in self.parts.joints]
        forces = ["N.m" if is_hinge(m, name) else "N" for name in self.parts.joints]
        found = []
        for j, (name, own) in enumerate(zip(self.parts.joints, self.parts.inputs, strict=True)):
            if own is None:
                words, size = f"force that {name} lacks", self.spans[name].force
                found.append(Channel(f"balance:{name}", forces[j], words, 0.0, _EQUATION * size))
                continue
            size = float(np.sqrt(np.nanmean(self.measured[:, j] ** 2)))
            unit = forces[j] if own.is_force else ("V" if own.drive.has_back_emf else "1")
            what = "force" if own.is_force else "command"
            what = "following error" if _answers_position(own) else what
            if len(self.parts.joints) > 1:
                what = f"{what} of {own.drive.name}"
            found.append(Channel(own.column, unit, f"{what} that the motion needs", 0.0, _EQUATION * size))
        for name, unit, error in zip(self.parts.joints, units, self._window_errors().tolist(), strict=True):
            words = f"position of {name} after a window without correction"
            found.append(Channel(f"position:{name}", unit, words, 0.0, error))
        for j, name in enumerate(self.parts.joints):
            if self.parts.has_velocity[j]:
                error = float(log.speed_noise[j])
                found.append(Channel(f"velocity:{name}", f"{units[j]}/s", f"speed of {name}", 0.0, error))
        found += [Channel(f"sensor:{name}", "1", f"sensor {name}") for name in self.parts.sensors]
        names = self._machine.column_names
        return tuple(replace(one, name=names.get(one.name, one.name)) for one in found)

    def _segments(self) -> tuple[Segment, ...]:
        log, segments = self.log, []
        means = self._means(log.times[:, None])[:, 0]
        for s, stretch in enumerate(log.stretches):
            run = self._runs[log.run_of_stretch[s]]
            for w in range(int(stretch[2]), int(stretch[2] + stretch[3])):
                first = int(log.windows[w, 2])
                last = first + int(log.windows[w, 1] - log.windows[w, 0]) // log.size
                repeats = run.repeat_of is not None
                segments.append(Segment(run.name, run.condition, first, last, means[first:last], repeats))
        return tuple(segments)


def _answers_position(own: Input) -> bool:
    """True for the command of a position servo."""
    return not own.is_force and own.drive.position_gain != 0.0


def _missing(laws: Laws, log: MachineLog, motion: Motion, curve: Array, commands: Array) -> Array:
    """Needed − produced force along a motion, shape (n, j) [N or N.m].

    Dry friction jumps where the smoothed motion turns; that beside a measured force passes its filter, too.
    """
    found, friction = np.empty(commands.shape), np.empty(commands.shape)
    links = motion.rigid, motion.speed, motion.limited_speed, np.ones(motion.speed.shape)
    if (play := motion.play) is not None:
        limited = np.where(laws.joints[:, PLAY] > 0.0, play.speed, motion.limited_speed)
        links = motion.rigid + play.force, play.speed, limited, play.contact
    moved = log.times, motion.position, motion.balanced_speed, motion.acceleration
    kernels.missing_forces(
        laws.joints, curve, kernels.Balance(*moved, *links, commands, log.enabled), found, friction
    )
    for j, width in enumerate(log.filter_widths):
        if laws.has_force(j):
            add_filtered(friction, j, log.stretches, same_filter(width), found)
        else:
            found[:, j] += friction[:, j]
    return found
