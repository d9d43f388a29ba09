"""Compiled replay of any machine: balance of forces along the measured motion, and free windows.

Balance at a joint, with the rigid-body force R of its links, and for a joint at rest the friction that the
balance asks for, within the bounds of dry friction:
  J q̈ + R(q, q̇, q̈) + (b ± Δb/2 + c |q̇|) q̇ + k (q − q_0) + D sgn q̇ − F_0 = gear · force
A gear with the efficiency η passes on 1/η of the force F where F q̇ < 0. This is a dry friction beside a
larger force, (1 + β/2) F − β/2 |F| sgn q̇ with β = 1/η − 1, so that a joint at rest may have any in between.
Free window: MuJoCo steps from the measured state, driven by the measured input alone; dry friction is that of
its solver, with the level of the present state, and what MJCF has no word for is an applied force. Its steps
  (M + h b/2) Δv = h f(q, v),   q⁺ = q + h (v + Δv)
are those of a leapfrog: v is the speed half a step before q, and b is taken by the trapezoidal rule. A window
begins with half a kick, v₀ + Δv/2. Without either the position after a time T would be off by h a T/2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnimj.estimate.replay.stretches import FIRST, FIRST_BLOCK, LAST
from omnimj.physics.native import kernel
from omnimj.plant.mujoco.step import call_step
from omnimj.signals import Array

(
    DAMPING,
    QUADRATIC,
    DRY,
    ARMATURE,
    SPRING,
    SPRING_REST,
    CABLE,
    CABLE_REST,
    ASYMMETRIC_DRY,
    ASYMMETRIC_DAMPING,
    STRIBECK_FORCE,
    STRIBECK_VELOCITY,
    PLACE_FORCE,
    PLACE,
    PLACE_WIDTH,
    LOAD_SHARE,
    OFFSET,
    COMPLIANCE,
    GEAR,
    GAIN,
    BIAS,
    POSITION_GAIN,
    VELOCITY_GAIN,
    FADING,
    BRAKING,
    LOW,
    HIGH,
    DECLARED_LOW,
    DECLARED_HIGH,
    REST_SPEED,
    FORCE_PER_UNIT,
    PLAY,
    STILL,
) = range(33)
LAW = 33
"""Numbers of a joint's law. `BRAKING`: β of its gear. `LOW`, `HIGH`: limits of the actuator's force; those of
the model are `DECLARED_LOW` and `DECLARED_HIGH`. `FORCE_PER_UNIT`: force on the joint per unit of its
channel. `STILL`: share of the rest speed up to which any friction within its bounds is possible."""

KNOTS = 8
CURVE_JOINT, CURVE_KIND, CURVE_LOW, CURVE_HIGH = range(4)
CURVE = 4 + KNOTS
"""Numbers of a free curve: joint (−1: none), variable, range, force at the knots."""
OVER_SPEED, OVER_POSITION, OVER_TIME = range(3)
_DIVERGED = 1e6  # [rad/s² or m/s²] beyond which MuJoCo soon gives up with a warning
_LEAST_KEPT = 0.05  # share of a force that fading leaves
_NEAR_LIMIT = 0.5  # share below a limit from which the whole force beyond it counts as an error


@kernel
def _curve_force(curve, joint, position, speed, time):
    """Force of a free curve on a joint [N or N.m]."""
    if curve[CURVE_JOINT] != joint:
        return 0.0
    kind = curve[CURVE_KIND]
    x = speed if kind == OVER_SPEED else (position if kind == OVER_POSITION else time)
    place = (x - curve[CURVE_LOW]) / (curve[CURVE_HIGH] - curve[CURVE_LOW]) * (KNOTS - 1)
    place = min(max(place, 0.0), KNOTS - 1.0)
    below = min(int(place), KNOTS - 2)
    share = place - below
    return (1.0 - share) * curve[4 + below] + share * curve[5 + below]


@kernel
def dry_friction(law, position, speed, load):
    """Dry friction in forward and in backward motion, both ≥ 0 [N or N.m].

    D± = C ± ΔC/2 + S exp(−(v/v_s)²) + P exp(−((q − q_P)/w)²/2) + μ |R|
    """
    dry = law[DRY] + law[LOAD_SHARE] * abs(load)
    if law[STRIBECK_FORCE] != 0.0:
        dry += law[STRIBECK_FORCE] * math.exp(-((speed / law[STRIBECK_VELOCITY]) ** 2))
    if law[PLACE_FORCE] != 0.0:
        dry += law[PLACE_FORCE] * math.exp(-0.5 * ((position - law[PLACE]) / law[PLACE_WIDTH]) ** 2)
    half = 0.5 * law[ASYMMETRIC_DRY]
    return max(dry + half, 0.0), max(dry - half, 0.0)


@kernel
def damping(law, speed):
    """Damping coefficient b ± Δb/2 + c |v|."""
    half = 0.5 * law[ASYMMETRIC_DAMPING]
    side = half if speed > 0.0 else (-half if speed < 0.0 else 0.0)
    return law[DAMPING] + side + law[QUADRATIC] * abs(speed)


@kernel
def _declared_force(law, command, position, speed):
    """Force F of the actuator without fading and limits [N or N.m]."""
    force = law[GAIN] * command + law[BIAS]
    return force + law[GEAR] * (law[POSITION_GAIN] * position + law[VELOCITY_GAIN] * speed)


@kernel
def drive_force(law, command, position, speed):
    """Force of the actuator on its joint [N or N.m], gear · F/(1 + c |F|) within its limits."""
    force = _declared_force(law, command, position, speed)
    return law[GEAR] * min(max(force / (1.0 + law[FADING] * abs(force)), law[LOW]), law[HIGH])


@kernel
def passed_on(law, force, speed):
    """Force of the actuator behind its gear, in motion [N or N.m]."""
    return force * (1.0 + law[BRAKING]) if force * speed < 0.0 else force


@kernel
def _error_before_limits(law, force, lacking):
    """Error of an actuator's force F without fading and limits, by what its force on the gear lacks.

    Fading gives G = F/(1 + c |F|). If the motion needs N, the error is (N - G) (1 + c |F|)/(1 - c |N|): the
    secant, or the tangent where it needs more than G. A limit L gives the same force for every G beyond. If
    the motion needs 0 < L - N < L/2, the share 2 (L - N)/L of G - L is part of the error, and all of it where
    less is needed. Otherwise the error would vanish for large gains, or for a low limit of an actuator that
    moves light links, whatever its input.
    """
    side = 1.0 if force > 0.0 else -1.0
    kept = 1.0 + law[FADING] * abs(force)
    declared = min(max(force / kept, law[DECLARED_LOW]), law[DECLARED_HIGH])
    given = min(max(declared, law[LOW]), law[HIGH])
    most = abs(given)
    needed = min(max(most + lacking * side, 0.0), most)
    if given != declared:
        lacking += (given - declared) * min((most - needed) / (_NEAR_LIMIT * most), 1.0)
    return lacking * kept / (1.0 - law[FADING] * needed)


@kernel
def to_input_errors(laws, commands, position, speed, enabled, forces):
    """Turn missing forces, shape (n, j), into errors of the inputs, in place.

    They are divided by the force per unit, behind fading and limits (`_error_before_limits`), and multiplied
    by η where the motion drives the motor.
    """
    for k in range(len(forces)):
        for j in range(len(laws)):
            law, changes = laws[j], False
            if enabled[k, j]:
                is_limited = law[LOW] > law[DECLARED_LOW] or law[HIGH] < law[DECLARED_HIGH]
                changes = is_limited or law[FADING] != 0.0 or law[BRAKING] != 0.0
            if changes:
                force, gear = _declared_force(law, commands[k, j], position[k, j], speed[k, j]), law[GEAR]
                if gear * force * speed[k, j] < 0.0:
                    forces[k, j] /= 1.0 + law[BRAKING]
                forces[k, j] = gear * _error_before_limits(law, force, forces[k, j] / gear)
            forces[k, j] /= law[FORCE_PER_UNIT]


@kernel
def to_inputs(laws, position, speed, enabled, forces):
    """Turn forces that are missing with commands of 0, shape (n, j), into inputs that give them, in place.

    The inverse of `drive_force` without its limits, behind the gear.
    """
    for k in range(len(forces)):
        for j in range(len(laws)):
            law, q, v, declared, own = laws[j], position[k, j], speed[k, j], 0.0, 0.0
            if enabled[k, j]:
                declared, own = _declared_force(law, 0.0, q, v), drive_force(law, 0.0, q, v)
            force = forces[k, j] + passed_on(law, own, v)
            force /= law[GEAR] * (1.0 + law[BRAKING] if force * v < 0.0 else 1.0)
            kept = max(1.0 - law[FADING] * abs(force), _LEAST_KEPT)
            forces[k, j] = (force / kept - declared) * law[GEAR] / law[FORCE_PER_UNIT]


@kernel
def steady_force(law, position):
    """Force of springs and offset that the joint takes [N or N.m]."""
    spring = law[SPRING] * (position - law[SPRING_REST]) + law[CABLE] * (position - law[CABLE_REST])
    return spring - law[OFFSET]


class Balance(NamedTuple):
    """Motion of motors and links whose forces are balanced, n rows, j joints, shape (n, j) each."""

    times: Array
    """Time since the start of the run, shape (n,) [s]."""
    position: Array
    speed: Array
    acceleration: Array
    rigid: Array
    """Rigid-body forces without armature, springs and friction, with what play changes of them [N or N.m]."""
    sliding: Array
    """Speed of the links behind their play."""
    limited: Array
    """Speed that tells their direction."""
    contact: Array
    """1 where the links touch the motor, otherwise 0."""
    commands: Array
    """Effective inputs of the actuators."""
    enabled: NDArray[np.bool_]
    """Whether the actuators are on."""


@kernel
def missing_forces(laws, curve, given, missing, friction):
    """Force that each joint's balance lacks along the measured motion, and the dry friction apart.

    Args:
      laws: Laws of the joints, shape (j, LAW).
      curve: Free curve, shape (CURVE,).
      given: `Balance`.
      missing: Filled with needed − produced force without dry friction, shape (n, j) [N or N.m].
      friction: Filled with the dry friction, shape (n, j) [N or N.m].
    """
    for k in range(len(given.times)):
        for j in range(len(laws)):
            law = laws[j]
            q, v, rigid, sliding = (
                given.position[k, j],
                given.speed[k, j],
                given.rigid[k, j],
                given.sliding[k, j],
            )
            limited = given.limited[k, j]
            needed = law[ARMATURE] * given.acceleration[k, j] + rigid + damping(law, v) * v
            needed += steady_force(law, q) - _curve_force(curve, j, q, v, given.times[k])
            produced = drive_force(law, given.commands[k, j], q, v) if given.enabled[k, j] else 0.0
            lost = 0.5 * law[BRAKING] * abs(produced)
            produced *= 1.0 + 0.5 * law[BRAKING]
            forward, backward = dry_friction(law, q, sliding, rigid)
            forward, backward = forward + lost, backward + lost
            still = law[STILL]
            share = (abs(limited) / law[REST_SPEED] - still) / (1.0 - still)
            share = min(max(share, 0.0), 1.0)  # 0 at rest, 1 in motion
            share = share if limited > 0.0 else -share
            low, high = -backward, forward
            if share > 0.0:
                low += share * (forward + backward)
            else:
                high += share * (forward + backward)
            missing[k, j] = needed - produced
            low, high = min(low, high), max(low, high)  # a gear with η > 1 can outweigh friction
            friction[k, j] = given.contact[k, j] * min(max(produced - needed, low), high)


class Simulation(NamedTuple):
    """MuJoCo's arrays of one model, and the addresses of its functions."""

    step: int
    """Address of `mj_step`."""
    inverse: int
    """Address of `mj_inverse`."""
    model: int
    data: int
    time_step: float
    """Time step of the model [s]."""
    qpos: Array
    qvel: Array
    qacc: Array
    applied: Array
    """`qfrc_applied`, shape (j,)."""
    passive: Array
    constraint: Array
    needed: Array
    """`qfrc_inverse`, shape (j,)."""
    warm: Array
    """`qacc_warmstart`."""
    readings: Array
    """`sensordata`."""
    damping: Array
    """`dof_damping` of the model, shape (j,)."""
    friction: Array
    """`dof_frictionloss` of the model, shape (j,)."""


@kernel
def rigid_forces(simulation, position, speed, acceleration, places, rigid, readings):
    """Rigid-body forces and readings of sensors along a motion, by inverse dynamics.

    Args:
      simulation: A model without friction, springs and armature.
      position: Shape (n, j).
      speed: Shape (n, j).
      acceleration: Shape (n, j).
      places: Places of the sensors in `sensordata`, shape (s,).
      rigid: Filled with the forces, shape (n, j) [N or N.m].
      readings: Filled with the readings, shape (n, s).
    """
    for k in range(len(position)):
        simulation.qpos[:] = position[k]
        simulation.qvel[:] = speed[k]
        simulation.qacc[:] = acceleration[k]
        call_step(simulation.inverse, simulation.model, simulation.data)
        rigid[k] = simulation.needed
        for s in range(len(places)):
            readings[k, s] = simulation.readings[places[s]]


class Windows(NamedTuple):
    """Free windows to simulate."""

    table: NDArray[np.int64]
    """Shape (w, WINDOW)."""
    substeps: int
    """Steps per row."""
    size: int
    """Rows per block."""


class WindowInputs(NamedTuple):
    """Measured motion in which windows begin, and what acts on the joints during them, shape (n, j) each."""

    times: Array
    """Time since the start of the run, shape (n,) [s]."""
    position: Array
    """Positions of the links, behind the springs."""
    speed: Array
    """Speeds of the links."""
    loads: Array
    """Forces that the springs transmit, 0 without one."""
    gaps: Array
    """Positions of the motors minus those of the links by play."""
    braking: Array
    """Forces on the motors by play and the deflection of their springs."""
    commands: Array
    """Effective inputs of the actuators."""
    enabled: NDArray[np.bool_]
    """Whether the actuators are on."""


@kernel
def free_windows(simulation, laws, curve, windows, given, blocks):
    """Simulate free windows from the measured state and average the positions over the blocks.

    Args:
      simulation: The model; its damping and dry friction are set in every step.
      laws: Laws of the joints, shape (j, LAW).
      curve: Free curve, shape (CURVE,).
      windows: `Windows`.
      given: `WindowInputs`.
      blocks: Filled with mean positions and speeds of these windows, shape (blocks, 2 j).
    """
    joints, size, substeps = len(laws), windows.size, windows.substeps
    commands, braking = given.commands, given.braking
    load = np.zeros(joints)
    before = np.zeros(joints)
    for w in range(len(windows.table)):
        first, last, at = windows.table[w, FIRST], windows.table[w, LAST], windows.table[w, FIRST_BLOCK]
        for j in range(joints):
            simulation.qpos[j], simulation.qvel[j] = given.position[first, j], given.speed[first, j]
            simulation.warm[j], load[j] = 0.0, given.loads[first, j]
        blocks[at : at + (last - first) // size] = 0.0
        diverged = False
        for k in range(first, last):
            block, after = at + (k - first) // size, min(k + 1, last - 1)
            for i in range(substeps):
                share = i / substeps
                for j in range(joints):
                    command = (1.0 - share) * commands[k, j] + share * commands[after, j]
                    is_on, time = given.enabled[k, j], given.times[k]
                    _set_forces(simulation, laws[j], curve, j, command, is_on, time, load)
                    simulation.applied[j] -= (1.0 - share) * braking[k, j] + share * braking[after, j]
                    before[j] = simulation.qvel[j]
                    if i == 0:
                        blocks[block, j] += (simulation.qpos[j] + given.gaps[k, j]) / size
                if diverged:  # the positions stay where they are
                    if i == 0:
                        blocks[block, joints:] += before / size
                    continue
                call_step(simulation.step, simulation.model, simulation.data)
                diverged = np.abs(simulation.qacc).max() > _DIVERGED
                for j in range(joints):
                    change = simulation.qvel[j] - before[j]
                    if k == first and i == 0:
                        simulation.qvel[j] -= 0.5 * change
                        simulation.qpos[j] -= 0.5 * simulation.time_step * change
                    load[j] = simulation.applied[j] + simulation.passive[j] + simulation.constraint[j]
                    load[j] -= laws[j, ARMATURE] * simulation.qacc[j]
                    if i == 0:
                        blocks[block, j] += laws[j, COMPLIANCE] * load[j] / size
                        blocks[block, joints + j] += (simulation.qvel[j] - 0.5 * change) / size


@kernel
def pushing_force(law, curve, joint, command, is_on, time, position, speed):
    """Force on a joint beside that of bodies, spring and friction; its damping; dry friction of its gear.

    The motor's own damping, by its voltage per speed, counts as damping.
    """
    slowing, lost = damping(law, speed), 0.0
    push = law[OFFSET] + _curve_force(curve, joint, position, speed, time)
    push -= law[CABLE] * (position - law[CABLE_REST])
    if is_on:
        force = drive_force(law, command, position, speed)
        lost = 0.5 * law[BRAKING] * abs(force)
        push += (1.0 + 0.5 * law[BRAKING]) * force
        limited = force <= law[GEAR] * law[LOW] or force >= law[GEAR] * law[HIGH]
        if law[GEAR] < 0.0:
            limited = force >= law[GEAR] * law[LOW] or force <= law[GEAR] * law[HIGH]
        if law[VELOCITY_GAIN] < 0.0 and not limited:
            faded = 1.0 + law[FADING] * abs(_declared_force(law, command, position, speed))
            electric = -(1.0 + 0.5 * law[BRAKING]) * law[VELOCITY_GAIN] * (law[GEAR] / faded) ** 2
            slowing += electric  # taken implicitly by the step
            push += electric * speed
    return push, slowing, lost


@kernel
def _set_forces(simulation, law, curve, j, command, is_on, time, load):
    """Set damping, dry friction and applied force of a joint for the next step."""
    q, v = simulation.qpos[j], simulation.qvel[j]
    forward, backward = dry_friction(law, q, v, load[j])
    push, slowing, lost = pushing_force(law, curve, j, command, is_on, time, q, v)
    if slowing < 0.0:
        push -= slowing * v
        slowing = 0.0
    simulation.damping[j] = 0.5 * slowing
    resistance = 0.5 * (forward + backward) + lost
    simulation.friction[j] = max(resistance, 0.0)
    simulation.applied[j] = push - 0.5 * slowing * v - 0.5 * (forward - backward)
    simulation.applied[j] -= min(resistance, 0.0) * np.sign(v)  # of a gear with η > 1


def no_curve() -> Array:
    """A free curve without a force, shape (CURVE,)."""
    found = np.zeros(CURVE)
    found[CURVE_JOINT], found[CURVE_HIGH] = -1.0, 1.0
    return found


def window_rows(windows: NDArray[np.int64], size: int) -> NDArray[np.intp]:
    """Rows of the blocks of some windows."""
    parts = [np.arange(w[2], w[2] + (w[1] - w[0]) // size) for w in windows]
    return np.concatenate(parts) if parts else np.zeros(0, np.intp)


@kernel
def since_reversal(direction):
    """Rows since a joint last reversed, or since the start of the stretch, shape (n,).

    Args:
      direction: −1, 0 at rest, or 1 in every row, shape (n,).
    """
    found, last, count = np.empty(direction.size), 0.0, 0.0
    for k in range(direction.size):
        if direction[k] != 0.0 and direction[k] != last:
            if last != 0.0:
                count = 0.0
            last = direction[k]
        found[k] = count
        count += 1.0
    return found
