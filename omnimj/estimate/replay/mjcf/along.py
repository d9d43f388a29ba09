"""Rigid-body forces along the measured motion and free windows from it, by MuJoCo in compiled loops."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from omnimj.effects import ChannelEffect
from omnimj.effects.parts import BODY, Part
from omnimj.estimate.replay.mjcf import kernels
from omnimj.estimate.replay.mjcf.delays import CommandPath, effective_commands, shifted
from omnimj.estimate.replay.mjcf.filters import local_cubic
from omnimj.estimate.replay.mjcf.kernels import (
    ARMATURE,
    COMPLIANCE,
    DAMPING,
    GEAR,
    PLAY,
    SPRING,
    SPRING_REST,
    VELOCITY_GAIN,
)
from omnimj.estimate.replay.mjcf.laws import Laws
from omnimj.estimate.replay.mjcf.log import MachineLog
from omnimj.estimate.replay.mjcf.one_joint import free_windows_of_one_joint
from omnimj.estimate.replay.mjcf.play import Play, links_behind_play, motors_before_play
from omnimj.estimate.replay.mjcf.remembered import Remembered
from omnimj.estimate.replay.mjcf.rigid import RigidBodies, arrays_of
from omnimj.estimate.replay.stretches import FIRST
from omnimj.plant.mujoco.machine import Machine
from omnimj.signals import Array

_KEPT = 64  # rigid-body forces along the motion that are remembered
_STIFF = 0.9999  # impedance of dry friction: a joint at rest does not creep
_STEP = 0.005  # [s] shortest step of the windows
_HALVES = (0.05, 0.075, 0.1, 0.15)  # [s] half widths of the filter of deflections, below a resonance
_CLEAR = 0.1  # noise of a deflection's acceleration over its RMS
_DEFLECTIONS = 2  # fixed-point steps of the deflection: its error falls by (rate / resonance)^2 in each
_OFF = mujoco.mjtDisableBit


@dataclass(frozen=True)
class Motion:
    """Motion of a machine under the position sensors of a setting, and its rigid-body forces."""

    position: Array
    speed: Array
    acceleration: Array
    """Motion of the motors, shape (n, j) each."""
    balanced_speed: Array
    """Their speed for balances of forces, see `MachineLog.balanced_speed`, shape (n, j)."""
    limited_speed: Array
    """Their speed that tells the direction, see `MachineLog.limited_speed`, shape (n, j)."""
    rigid: Array
    """Rigid-body forces, shape (n, j) [N or N.m]."""
    readings: Array
    """Readings of the sensors, shape (n, s)."""
    bent: tuple[Array, Array, Array] | None = None
    """Deflections of the springs, their speeds and accelerations, shape (n, j) each; None without any."""
    play: Play | None = None
    """Links behind their play; None without any."""


class Dynamics:
    """MuJoCo's model of a machine along its logs; equal rigid bodies are computed once."""

    def __init__(
        self,
        machine: Machine,
        log: MachineLog,
        sensors: tuple[str, ...],
        stated: Sequence[Mapping[Part, float]],
    ):
        """Prepare the models.

        Args:
          stated: Masses that a run states, for each stretch; those of the model everywhere when empty.
        """
        self._machine, self._log = machine, log
        self._bodies = RigidBodies(machine, log.stretches.tolist(), sensors, stated)
        self._on_link = np.array([name in machine.encoders_on_links for name in machine.joints])
        self._widths = [_deflection_width(log, j) for j in range(log.position.shape[1])]
        self._known: Remembered[Motion] = Remembered(_KEPT)
        substeps = max(1, int(np.ceil(log.period / max(machine.mj_model.opt.timestep, _STEP) - 1e-6)))
        self.substeps = substeps
        """Steps of MuJoCo per row that its own step, or 5 ms, asks for."""

    def motion(self, laws: Laws, commands: Array | None = None) -> Motion:
        """Motion and rigid-body forces under a setting.

        Args:
          commands: Effective inputs, shape (n, j); None: springs are loaded by the links' motion alone.
        """
        if not laws.joints[:, COMPLIANCE].any() and not laws.joints[self._on_link, PLAY].any():
            commands = None
        key = (
            self._readings_of(laws),
            self._key(laws),
            None if commands is None else hash((laws.joints.tobytes(), commands.tobytes())),
        )
        if (found := self._known.get(key)) is None:
            found = self._along(laws, commands)
            self._known.keep(key, found)
        return found

    def _readings_of(self, laws: Laws) -> tuple[ChannelEffect, ...]:
        """Changes of the position sensors: the motion of the motors depends on nothing else."""
        return tuple(laws.channel(f"position:{name}") for name in self._machine.joints)

    def _key(self, laws: Laws) -> Hashable:
        masses = tuple(value for (kind, _, _), value in laws.masses.items() if kind == BODY)
        compliance = tuple(laws.joints[:, COMPLIANCE].tolist())
        armature = tuple(laws.joints[:, ARMATURE].tolist()) if any(compliance) else ()
        if laws.joints[:, PLAY].any():
            armature += tuple(laws.joints.ravel().tolist())
        return masses, laws.payloads, tuple(laws.gravity.tolist()), compliance, armature

    def _along(self, laws: Laws, commands: Array | None) -> Motion:
        log = self._log
        measured = log.position, log.speed, log.acceleration, log.balanced_speed, log.limited_speed
        columns = [
            [
                self._true(values[:, j], reading, order, laws.has_force(j))
                for j, reading in enumerate(self._readings_of(laws))
            ]
            for order, values in enumerate(measured)
        ]
        position, speed, acceleration, balanced, limited = (
            np.ascontiguousarray(np.stack(c, axis=1)) for c in columns
        )
        plain = position, speed, acceleration
        rigid, readings = self._bodies.forces(laws, plain, self._readings_of(laws))
        bent, motor = None, (*plain, balanced, limited)
        if laws.joints[:, COMPLIANCE].any():
            share = self._motor_shares(laws, motor, rigid) if commands is not None else 0.0
            for _ in range(_DEFLECTIONS):
                loads = rigid
                if commands is not None:
                    loads = rigid - share * self._lacking(laws, motor, rigid, commands)
                bent = self._bent(loads, laws.joints[:, COMPLIANCE])
                one, two, three = (part - change for part, change in zip(plain, bent, strict=True))
                rigid, readings = self._bodies.forces(laws, (one, two, three))
        play = None
        if laws.joints[:, PLAY].any():
            play = self._behind_play(laws, plain, rigid, commands)
        return Motion(*plain, balanced, limited, rigid, readings, bent, play)

    def _behind_play(
        self, laws: Laws, plain: tuple[Array, Array, Array], rigid: Array, commands: Array | None
    ) -> Play:
        """Links behind the play of measured motors, and motors before that of measured links.

        Without inputs the latter are not known, and their play has no effect.
        """
        on_motor, on_link = laws.joints.copy(), laws.joints.copy()
        on_motor[self._on_link, PLAY] = on_link[~self._on_link, PLAY] = 0.0
        inertia = self._inertias(laws, plain, rigid, PLAY)
        play = links_behind_play(on_motor, self._log, plain, rigid, inertia)
        if commands is not None:
            motors_before_play(on_link, self._log, play, (commands, *plain, rigid, inertia))
        return play

    def _motor_shares(self, laws: Laws, motor: tuple[Array, ...], rigid: Array) -> Array:
        """Weight of the motor's side in the force of each spring, shape (n, j).

        The links' need and what the motor leaves of its drive are both the spring's force. The noise of q̈
        is in the first times the inertia I of the links, in the second times −J of the motor: with the
        weights J/(I + J) and I/(I + J) it cancels.
        """
        position, speed, acceleration, *_ = motor
        inertia = self._inertias(laws, (position, speed, acceleration), rigid, COMPLIANCE)
        return inertia / (inertia + laws.joints[:, ARMATURE])

    def _lacking(self, laws: Laws, motor: tuple[Array, ...], rigid: Array, commands: Array) -> Array:
        """Force that the links need beyond what the motors leave them, shape (n, j) [N or N.m]."""
        position, speed, acceleration, balanced, limited = motor
        moved = self._log.times, position, balanced, acceleration
        links = rigid, speed, limited, np.ones(speed.shape)
        found, friction = np.empty(rigid.shape), np.empty(rigid.shape)
        given = kernels.Balance(*moved, *links, commands, self._log.enabled)
        kernels.missing_forces(laws.joints, kernels.no_curve(), given, found, friction)
        return np.where(self._log.valid, found + friction, 0.0)

    def _inertias(self, laws: Laws, plain: tuple[Array, Array, Array], rigid: Array, term: int) -> Array:
        """Inertia of the links about each joint with a term in its law, shape (n, j) [kg or kg.m2]."""
        position, speed, acceleration = plain
        found, key = np.ones(rigid.shape), self._readings_of(laws)
        for j in np.flatnonzero(laws.joints[:, term]):
            faster = acceleration.copy()
            faster[:, j] += 1.0
            forces, _ = self._bodies.forces(laws, (position, speed, faster), (key, int(j)))
            found[:, j] = forces[:, j] - rigid[:, j]
        return found

    def _true(self, values: Array, reading: ChannelEffect, order: int, is_smooth: bool) -> Array:
        """Motion of a joint from readings of its encoder; order 0: position, otherwise a derivative of it."""
        if reading == ChannelEffect():
            return values
        offset = reading.offset if order == 0 else 0.0
        true = (values - offset) / reading.scale
        if reading.delay:
            found = np.empty(len(true))
            rows = reading.delay / self._log.period
            shifted(true, self._log.stretches, rows, is_smooth, found)
            return found
        return true

    def _bent(self, rigid: Array, compliance: Array) -> tuple[Array, Array, Array]:
        """Deflection of each joint's spring under the force that it transmits, and its two derivatives.

        Noise that grows with the compliance would bias its fitted value to 0; the filter is wide for this.
        """
        log = self._log
        found = np.zeros((3, *rigid.shape))
        for j in np.flatnonzero(compliance):
            for first, last, _, _ in log.stretches:
                width = min(self._widths[j], int(last - first) - 1 | 1)
                for order in range(3):
                    bent = local_cubic(rigid[first:last, j], width, order, log.period)
                    found[order, first:last, j] = compliance[j] * bent
        return found[0], found[1], found[2]

    def _simulated(
        self, laws: Laws, stated: Mapping[Part, float], substeps: int
    ) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Model of the free windows and its data."""
        model = self._bodies.model(laws, stated)
        model.opt.timestep = self._log.period / substeps
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.opt.disableflags |= int(_OFF.mjDSBL_SENSOR)
        model.dof_armature[:] = laws.joints[:, ARMATURE]
        model.jnt_stiffness[:] = laws.joints[:, SPRING]
        model.qpos_spring[:] = laws.joints[:, SPRING_REST]
        model.dof_dampingpoly[:, 0] = 0.0
        model.dof_solimp[:, :2] = _STIFF
        model.dof_solref[:] = (2.0 * model.opt.timestep, 1.0)
        mj_data = mujoco.MjData(model)
        mujoco.mj_setConst(model, mj_data)
        return model, mj_data

    def windows(
        self,
        laws: Laws,
        motion: Motion,
        curve: Array,
        commands: Array,
        chosen: NDArray[np.int64],
        substeps: int,
    ) -> Array:
        """Mean positions and speeds in free windows, NaN elsewhere, shape (blocks, 2 j).

        Args:
          commands: Effective inputs, shape (n, j).
          chosen: Windows to simulate, shape (w, WINDOW).
          substeps: Steps per row.
        """
        log = self._log
        found = np.full((log.blocks, 2 * len(laws.joints)), np.nan)
        links, speeds, loads = motion.position, motion.speed, np.zeros(motion.position.shape)
        braking = loads
        if motion.bent is not None:
            links, speeds = links - motion.bent[0], speeds - motion.bent[1]
            loads = motion.rigid * (laws.joints[:, COMPLIANCE] > 0.0)
            electric = -laws.joints[:, VELOCITY_GAIN] * laws.joints[:, GEAR] ** 2
            damping = laws.joints[:, DAMPING] + np.where(log.enabled, electric, 0.0)
            braking = damping * motion.bent[1] + laws.joints[:, ARMATURE] * motion.bent[2]
        gaps, braking = np.zeros(links.shape), np.array(braking)
        if (play := motion.play) is not None:
            gaps = play.gap[0]
            links, speeds = links - gaps, speeds - play.gap[1]
            braking += laws.joints[:, ARMATURE] * play.gap[2]
            electric = laws.joints[:, VELOCITY_GAIN] * laws.joints[:, GEAR] ** 2
            braking -= np.where(log.enabled, electric, 0.0) * play.gap[1]
        start = links, speeds, loads, gaps, braking
        given = kernels.WindowInputs(log.times, *start, commands, log.enabled)
        for load in self._bodies.loads:
            inside = [(p.start <= chosen[:, FIRST]) & (chosen[:, FIRST] < p.stop) for p in load.parts]
            own = kernels.Windows(chosen[np.any(inside, axis=0)], substeps, log.size)
            if (body := self._bodies.one_joint(laws, load.stated)) is not None:
                step = log.period / substeps
                free_windows_of_one_joint(body, laws.joints[0], curve, own, step, given, found)
                continue
            simulated = self._simulated(laws, load.stated, substeps)
            kernels.free_windows(arrays_of(*simulated), laws.joints, curve, own, given, found)
        return found


def _deflection_width(log: MachineLog, joint: int) -> int:
    """Width of the narrowest filter whose fourth derivative of the position is clear of noise [rows].

    A deflection follows the acceleration, so that its own acceleration is that derivative.
    """
    period = log.period
    own = max(2 * round(float(log.reach[joint]) / period) + 1, 5)
    bends = savgol_coeffs(own, 3, deriv=2, delta=period)
    width = own
    for half in _HALVES:
        width = max(2 * round(half / period) + 1, own)
        parts = [log.acceleration[first:last, joint] for first, last, _, _ in log.stretches]
        parts = [
            np.asarray(savgol_filter(p, width, 3, deriv=2, delta=period)) for p in parts if len(p) > width
        ]
        if not parts:
            break
        both = np.convolve(bends, savgol_coeffs(width, 3, deriv=2, delta=period))
        scatter = float(log.position_noise[joint] * np.linalg.norm(both))
        if scatter < _CLEAR * float(np.sqrt(np.mean(np.concatenate(parts) ** 2))):
            break
    return width


def effective_inputs(laws: Laws, log: MachineLog) -> Array:
    """Inputs as the actuators receive them, shape (n, j)."""
    found = np.zeros(log.inputs.shape)
    for j, law in enumerate(laws.inputs):
        if law is None:
            continue
        raw = (log.inputs[:, j] - law.reading.offset) / law.reading.scale
        late = law.delay + laws.clock - law.reading.delay
        path = CommandPath(late, law.lag, *law.limits)
        raw, commands = np.ascontiguousarray(raw), np.empty(len(raw))
        effective_commands(raw, log.stretches, log.period, path, laws.has_force(j), commands)
        found[:, j] = commands
    return found
