"""Recordings of a true machine: its joints follow sines in a closed loop, by MuJoCo in steps of 0.1 ms."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import mujoco
import numpy as np

from omnimj.effects import ChannelEffect
from omnimj.physics.native import kernel
from omnimj.plant.mujoco.machine import Machine
from omnimj.plant.mujoco.step import call_step, function_address
from omnimj.recording.dataset import Run
from omnimj.signals import Array
from omnimj.simulate.machine.truth import (
    JointTruth,
    MachineTruth,
    actuator_force,
    behind_gear,
    friction_bounds,
    is_apart,
    machine_truth,
    outer_force,
    play_force,
)

PERIOD = 0.005
"""Sample period of logs, unless a loop has its own [s]."""
STEP = 1e-4
"""Step of the simulation [s]."""
_BANDWIDTH, _HOLD = 12.0, 30.0  # of the position loop: [rad/s], and least stiffness over dry friction / range
_SWING, _STROKE = 1.0, 0.12  # half ranges of hinges and slides without a range of their own [rad, m]
_OF_RANGE = 0.4  # half range over that of the joint
_SLOW, _FAST, _SHARE = (0.25, 0.6), (0.9, 2.0), 0.2  # the two sines [Hz], and the amplitude of the faster one
_OF_LIMIT = 0.6  # largest planned force over that of the actuator
_SMALLER, _TRIES = 0.8, 40
_POSITION_NOISE, _INPUT_NOISE = 2e-4, 4e-3  # over the range of the positions and the RMS input
_VELOCITY_NOISE = 2e-3  # over the range of the speeds
_COMMAND = 2  # place of the command among the rows
_JOINT_POSITION = mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtObj.mjOBJ_JOINT
_JOINT_VELOCITY = mujoco.mjtSensor.mjSENS_JOINTVEL, mujoco.mjtObj.mjOBJ_JOINT
_FORCE = mujoco.mjtSensor.mjSENS_ACTUATORFRC, mujoco.mjtObj.mjOBJ_ACTUATOR


class Motion(NamedTuple):
    """Kind of motion of a run."""

    seconds: float = 8.0
    pace: float = 1.0
    """Frequencies over those of the usual motion."""
    reach: float = 1.0
    """Range over that of the usual motion."""


USUAL = Motion()
"""The usual motion: most of the range, at 0.25 … 0.6 and 0.9 … 2 Hz."""


class Plan(NamedTuple):
    """Planned motion of one run, a row per sample of the logs, n rows, j joints."""

    goal: Array
    """Positions, shape (n, j)."""
    rate: Array
    """Shape (n, j)."""
    force: Array
    """Force of the nominal machine along the goal, shape (n, j)."""
    period: float
    """[s]"""


class Loop(NamedTuple):
    """Position loop with the constants of the nominal machine."""

    nominal: tuple[JointTruth, ...]
    stiffness: Array
    """Shape (j,)."""
    damping: Array
    """Shape (j,)."""


@dataclass(frozen=True)
class MachineLoop:
    """A machine with its position loop, and the ranges of its motions."""

    machine: Machine
    loop: Loop
    middle: Array
    half: Array
    period: float = PERIOD
    """Sample period of plans and logs [s]."""

    def plan(self, seed: int, motion: Motion = USUAL) -> Plan:
        """Plan a run within the forces of the actuators: two sines per joint that begin at rest."""
        random = np.random.default_rng(seed)
        joints = len(self.machine.joints)
        time = np.arange(round(motion.seconds / self.period) + 1) * self.period
        ramp = np.minimum(time / 0.8, 1.0)
        ramp = (ramp**2 * (3.0 - 2.0 * ramp))[:, None]
        slow, fast = (motion.pace * random.uniform(*band, joints) for band in (_SLOW, _FAST))
        reach, phase = random.uniform(0.6, 1.0, joints), random.uniform(0.0, 2.0 * np.pi, joints)
        slow_wave = np.sin(2.0 * np.pi * np.outer(time, slow))
        shape = (
            ramp * (slow_wave + _SHARE * np.sin(2.0 * np.pi * np.outer(time, fast) + phase)) / (1.0 + _SHARE)
        )
        half = motion.reach * self.half * reach
        for _ in range(_TRIES):
            plan = self.follow(self.middle + half * shape)
            too_large = np.abs(plan.force).max(axis=0) > _OF_LIMIT * self._strongest()
            if not too_large.any():
                break
            half = np.where(too_large, _SMALLER * half, half)
        return plan

    def _strongest(self) -> Array:
        """Largest force of each joint's actuator, infinite without a limit, shape (j,)."""
        found = np.full(len(self.loop.nominal), np.inf)
        for j, own in enumerate(self.loop.nominal):
            if own.gain:
                found[j] = abs(own.gear) * min(own.strongest, abs(own.gain * own.highest))
        return found

    def follow(self, goal: Array) -> Plan:
        """Plan of given positions, a row per sample, shape (n, j)."""
        rate = np.gradient(goal, self.period, axis=0)
        bend = np.gradient(rate, self.period, axis=0)
        model = machine_truth(self.machine, declared_values(self.machine)).rigid_model(STEP)
        data, force = mujoco.MjData(model), np.empty(goal.shape)
        addresses = function_address("mj_inverse"), model._address, data._address
        motion = np.stack([goal, rate, bend])
        needed_forces(
            self.loop.nominal, addresses, (data.qpos, data.qvel, data.qacc), data.qfrc_inverse, motion, force
        )
        return Plan(goal, rate, force, self.period)


def declared_values(machine: Machine) -> dict[str, float]:
    """Name of each uncertain quantity → its declared value."""
    return {one.name: one.value for one in machine.uncertain}


def machine_loop(machine: Machine, period: float = PERIOD) -> MachineLoop:
    """The position loop of a machine without effects, and ranges for its motions.

    Args:
      machine: The machine.
      period: Sample period of plans and logs [s].
    """
    m = machine.mj_model
    nominal = machine_truth(machine, declared_values(machine))
    model = nominal.rigid_model(STEP)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    inertia = full.diagonal()
    middle, half = np.zeros(model.nv), np.empty(model.nv)
    for j in range(model.nv):
        half[j] = _SWING if m.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE else _STROKE
        if m.jnt_limited[j]:
            low, high = m.jnt_range[j]
            middle[j], half[j] = 0.5 * (low + high), min(half[j], _OF_RANGE * (high - low))
    dry = np.array([own.dry for own in nominal.joints])
    stiffness = np.maximum(inertia * _BANDWIDTH**2, _HOLD * dry / half)  # friction must not hold the joint
    loop = Loop(nominal.joints, stiffness, 2.0 * np.sqrt(stiffness * inertia))
    return MachineLoop(machine, loop, middle, half, period)


class Bodies(NamedTuple):
    """MuJoCo's arrays of the rigid bodies."""

    step: int
    model: int
    data: int
    qpos: Array
    qvel: Array
    qacc: Array
    applied: Array
    constraint: Array
    friction: Array


@kernel
def _interpolated(rows, k, share, j):
    return (1.0 - share) * rows[k, j] + share * rows[k + 1, j]


@kernel
def _slowed(speed, change):
    """Speed after dry friction, which stops a motion but never turns it back."""
    return max(speed - change, 0.0) if speed > 0.0 else min(speed + change, 0.0)


@kernel
def needed_forces(joints, addresses, state, needed, motion, force):
    """Force that each joint needs along a motion: of the links, of friction, damping and springs.

    Args:
      joints: `JointTruth` of every joint.
      addresses: Those of `mj_inverse`, of the model and of its data.
      state: `qpos`, `qvel` and `qacc` of the data.
      needed: `qfrc_inverse` of the data.
      motion: Positions, speeds and accelerations, shape (3, n, j).
      force: Filled, shape (n, j) [N or N.m].
    """
    for k in range(len(force)):
        state[0][:], state[1][:], state[2][:] = motion[0, k], motion[1, k], motion[2, k]
        call_step(addresses[0], addresses[1], addresses[2])
        for j in range(len(joints)):
            place, rate = motion[0, k, j], motion[1, k, j]
            dry, _, smooth = friction_bounds(joints[j], place, rate, needed[j])
            force[k, j] = needed[j] + smooth + dry * np.tanh(20.0 * rate) - outer_force(joints[j], place)


@kernel
def drive_machine(joints, loop, plan, bodies, substeps, step, rows):
    """Simulate a run and fill its rows.

    Args:
      joints: `JointTruth` of every joint, of the true machine.
      loop: `Loop`.
      plan: `Plan`.
      bodies: `Bodies`, at the start of the plan.
      substeps: Steps per row.
      step: [s]
      rows: Filled with position and speed where they are measured, command and force, shape (n, 4, j).
    """
    n = len(joints)
    place, speed, load = plan.goal[0].copy(), np.zeros(n), np.zeros(n)
    received, command = np.zeros(n), np.zeros(n)
    for k in range(len(plan.goal) - 1):
        for i in range(substeps):
            share = i / substeps
            for j in range(n):
                own, known = joints[j], loop.nominal[j]
                if not is_apart(own):
                    place[j], speed[j] = bodies.qpos[j], bodies.qvel[j]
                seen, rate = (bodies.qpos[j], bodies.qvel[j]) if own.on_link else (place[j], speed[j])
                wanted = _interpolated(plan.force, k, share, j)
                wanted += loop.stiffness[j] * (_interpolated(plan.goal, k, share, j) - seen)
                wanted += loop.damping[j] * (_interpolated(plan.rate, k, share, j) - rate)
                if known.gain != 0.0:
                    electric = known.position_gain * seen + known.velocity_gain * rate
                    value = (wanted / known.gear - known.bias - known.gear * electric) / known.gain
                    command[j] = min(max(value, known.lowest), known.highest)
                keep = math.exp(-step / own.lag) if own.lag > 0.0 else 0.0
                received[j] = keep * received[j] + (1.0 - keep) * command[j]
                drive = actuator_force(own, received[j], place[j], speed[j])
                if i == 0:
                    rows[k, 0, j], rows[k, 1, j], rows[k, 2, j] = seen, rate, command[j]
                    rows[k, 3, j] = drive
                drive, held = behind_gear(own, drive, speed[j])
                if own.play > 0.0:  # friction acts on the link
                    load[j] = play_force(own, place[j] - bodies.qpos[j], speed[j] - bodies.qvel[j])
                    free = speed[j] + step * (drive - load[j]) / own.armature
                    speed[j] = _slowed(free, step * held / own.armature)
                    place[j] += step * speed[j]
                    forward, backward, smooth = friction_bounds(own, bodies.qpos[j], bodies.qvel[j], load[j])
                    bodies.friction[j] = 0.5 * (forward + backward)
                    bodies.applied[j] = load[j] + outer_force(own, bodies.qpos[j]) - smooth
                    bodies.applied[j] -= 0.5 * (forward - backward)
                    continue
                forward, backward, smooth = friction_bounds(own, place[j], speed[j], load[j])
                push = drive + outer_force(own, place[j]) - smooth
                forward, backward = forward + held, backward + held
                if own.compliance == 0.0:
                    bodies.friction[j] = 0.5 * (forward + backward)
                    bodies.applied[j] = push - 0.5 * (forward - backward)
                    continue
                load[j] = (place[j] - bodies.qpos[j]) / own.compliance
                bodies.friction[j], bodies.applied[j] = 0.0, load[j]
                free = speed[j] + step * (push - load[j]) / own.armature
                speed[j] = _slowed(free, step * (forward if free > 0.0 else backward) / own.armature)
                place[j] += step * speed[j]
            call_step(bodies.step, bodies.model, bodies.data)
            for j in range(n):
                if not is_apart(joints[j]):
                    load[j] = bodies.applied[j] + bodies.constraint[j] - joints[j].armature * bodies.qacc[j]


def simulated_rows(truth: MachineTruth, loop: Loop, plan: Plan) -> Array:
    """Measured position and speed, command and force of a run by MuJoCo, shape (n − 1, 4, j)."""
    stiffest = [j.compliance * j.armature for j in truth.joints if j.compliance]
    fine = min([STEP, *(0.2 * float(np.sqrt(square)) for square in stiffest)])
    substeps = int(np.ceil(plan.period / fine))
    step = plan.period / substeps
    model = truth.rigid_model(step)
    model.dof_solimp[:, :2], model.dof_solref[:] = 0.9999, (2.0 * step, 1.0)
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    data.qpos[:] = plan.goal[0]
    addresses = function_address("mj_step"), model._address, data._address
    arrays = data.qpos, data.qvel, data.qacc, data.qfrc_applied, data.qfrc_constraint
    rows = np.empty((len(plan.goal) - 1, 4, plan.goal.shape[1]))
    bodies = Bodies(*addresses, *arrays, model.dof_frictionloss)
    drive_machine(truth.joints, loop, plan, bodies, substeps, step, rows)
    return rows


def planned_rows(loop: Loop, plan: Plan) -> Array:
    """Rows as of `simulated_rows` of the nominal machine, were it to follow its plan, shape (n, 4, j)."""
    rows = np.stack([plan.goal, plan.rate, np.zeros(plan.goal.shape), plan.force], axis=1)
    for j, own in enumerate(loop.nominal):
        if own.gain:
            electric = own.position_gain * plan.goal[:, j] + own.velocity_gain * plan.rate[:, j]
            command = (plan.force[:, j] / own.gear - own.bias - own.gear * electric) / own.gain
            rows[:, 2, j] = np.clip(command, own.lowest, own.highest)
    return rows


def logged_run(
    name: str,
    truth: MachineTruth,
    rows: Array,
    seed: int,
    period: float = PERIOD,
    has_velocities: bool = False,
    usual: Array | None = None,
) -> Run:
    """Log of a run with the noise and the distortions of its channels.

    An actuator that answers late shows as a command that was logged early. Where the file has a sensor of an
    actuator's force, this force is logged instead of the command. Noise is that of the file's sensors, where
    it states one.

    Args:
      name: Name of the run.
      truth: The true machine.
      rows: From `simulated_rows`, shape (n, 4, j).
      seed: Seed of the noise.
      period: Sample period of the rows [s].
      has_velocities: Whether the speeds of the joints are logged.
      usual: Rows to whose sizes the noise is relative, where the file states none; the run's own when None.
    """
    sizes = rows if usual is None else usual
    machine, random = truth.machine, np.random.default_rng(seed)
    time: Array = np.arange(len(rows), dtype=float) * period
    columns = {"time": time}
    for j, joint in enumerate(machine.joints):
        place, drive = rows[:, 0, j], truth.drives[j]
        column = f"position:{joint}"
        noise = _sensor_noise(machine, joint, _JOINT_POSITION) or _POSITION_NOISE * float(
            np.ptp(sizes[:, 0, j])
        )
        columns[column] = _read(time, place, truth.channel(column), noise, random)
        if drive is not None:
            is_force = has_force_sensor(machine, drive.name)
            column = f"{'force' if is_force else 'control'}:{drive.name}"
            kind, scale = (3, 1.0 / drive.gear) if is_force else (_COMMAND, 1.0)
            if is_force and machine.forces_are_declared:
                scale *= drive.gain / truth.joints[j].gain
            values = scale * rows[:, kind, j]
            reading = truth.channel(column)
            late = reading._replace(delay=reading.delay - truth.delay(j))
            noise = _sensor_noise(machine, drive.name, _FORCE) if is_force else 0.0
            noise = noise or _INPUT_NOISE * _input_size(truth.joints[j], scale, sizes[:, :, j], kind)
            columns[column] = _read(time, values, late, noise, random)
        if has_velocities:
            column, speed = f"velocity:{joint}", rows[:, 1, j]
            noise = _sensor_noise(machine, joint, _JOINT_VELOCITY) or _VELOCITY_NOISE * float(
                np.ptp(sizes[:, 1, j])
            )
            columns[column] = _read(time, speed, truth.channel(column), noise, random)
    return Run(name, MappingProxyType(columns), MappingProxyType({}), MappingProxyType({}))


def _input_size(joint: JointTruth, scale: float, rows: Array, kind: int) -> float:
    """RMS input of a run; of a position servo, without the part that its own motion balances."""
    values = scale * rows[:, kind]
    if kind == _COMMAND and joint.position_gain:
        answer = joint.position_gain * rows[:, 0] + joint.velocity_gain * rows[:, 1]
        values = values + joint.gear / joint.gain * answer
    return float(np.sqrt(np.mean(values**2)))


def _sensor(machine: Machine, name: str, kind: tuple[mujoco.mjtSensor, mujoco.mjtObj]) -> int | None:
    """Index of the file's sensor of one kind on a joint or actuator; None without one."""
    m, (sensor, part) = machine.mj_model, kind
    own = mujoco.mj_name2id(m, part, name)
    found = np.flatnonzero((np.asarray(m.sensor_type) == int(sensor)) & (np.asarray(m.sensor_objid) == own))
    return int(found[0]) if len(found) else None


def _sensor_noise(machine: Machine, name: str, kind: tuple[mujoco.mjtSensor, mujoco.mjtObj]) -> float:
    """Noise that the file states for a sensor, 0 where it states none."""
    index = _sensor(machine, name, kind)
    return 0.0 if index is None else float(machine.mj_model.sensor_noise[index])


def has_force_sensor(machine: Machine, drive: str) -> bool:
    """True if the file has a sensor of an actuator's force."""
    return _sensor(machine, drive, _FORCE) is not None


def _read(
    time: Array, values: Array, reading: ChannelEffect, noise: float, random: np.random.Generator
) -> Array:
    """Readings of a channel: delayed, scaled, shifted, with white noise."""
    late = np.interp(time - reading.delay, time, values)
    return reading.scale * late + reading.offset + noise * random.standard_normal(len(time))
