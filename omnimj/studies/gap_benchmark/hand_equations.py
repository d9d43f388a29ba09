"""Recordings of a true machine by equations written by hand and integrated by scipy, not by MuJoCo.

A slide, a pendulum, and two links in a vertical plane whose joints turn about −y and that hang down at 0:
  M(q) q̈ + C(q, q̇) + G(q) = drive + outer force − friction − J q̈
Dry friction is D tanh(q̇/ε).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.integrate import solve_ivp

from omnimj.physics.native import kernel
from omnimj.plant.mujoco.machine import Machine
from omnimj.signals import Array
from omnimj.simulate.machine.drive import STEP, Loop, Plan
from omnimj.simulate.machine.truth import (
    MachineTruth,
    actuator_force,
    behind_gear,
    friction_bounds,
    outer_force,
)

_SHARP = 2e-3  # ε over the largest planned speed
_LOADS = 3  # fixed-point steps of the transmitted force
_TOLERANCE, _LONGEST = 1e-7, 0.01  # of the integration, and its longest step [s]


class Links(NamedTuple):
    """Masses and lengths, shape (j,) each, and gravity in the plane of the links."""

    is_slide: bool
    mass: Array
    centre: Array
    """Distance of each centre of mass from its joint [m]."""
    inertia: Array
    """About the centre of mass [kg.m2]."""
    length: float
    """From the first joint to the second [m]."""
    gravity_x: float
    gravity_z: float


def has_hand_equations(machine: Machine) -> bool:
    """True for one slide along x, and for one or two links that hang down and turn about −y."""
    m = machine.mj_model
    hinges = bool((np.asarray(m.jnt_type) == mujoco.mjtJoint.mjJNT_HINGE).all())
    if m.njnt == 1 and not hinges:
        return bool(np.allclose(m.jnt_axis[0], (1.0, 0.0, 0.0)))
    bodies = np.asarray(m.jnt_bodyid)
    hang = np.abs(np.asarray(m.body_ipos)[bodies][:, :2]).max() < 1e-9
    is_chain = m.njnt == 1 or (m.njnt == 2 and m.body_parentid[bodies[1]] == bodies[0])
    lies_below = m.njnt == 1 or bool(np.abs(m.body_pos[bodies[1]][:2]).max() < 1e-9)
    turn = np.allclose(m.jnt_axis, (0.0, -1.0, 0.0)) and not np.any(m.jnt_pos)
    return bool(hinges and is_chain and hang and lies_below and turn and m.nbody == m.njnt + 1)


def _links(truth: MachineTruth) -> Links:
    model = truth.rigid_model(STEP)
    bodies = np.asarray(model.jnt_bodyid)
    inertia = np.empty(len(bodies))
    for k, body in enumerate(bodies):
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.body_iquat[body])
        axis = turn.reshape(3, 3).T @ np.array([0.0, 1.0, 0.0])
        inertia[k] = float(axis**2 @ model.body_inertia[body])
    length = -float(model.body_pos[bodies[1]][2]) if len(bodies) == 2 else 0.0
    x, _, z = truth.gravity.tolist()
    is_slide = bool(model.jnt_type[0] == mujoco.mjtJoint.mjJNT_SLIDE)
    centre = -np.array(model.body_ipos)[bodies][:, 2]
    return Links(is_slide, np.array(model.body_mass)[bodies], centre, inertia, length, x, z)


@kernel
def _rigid(links, place, speed):
    """Mass matrix and bias force M, C + G of the links."""
    n = len(place)
    mass, bias = np.zeros((n, n)), np.zeros(n)
    if links.is_slide:
        mass[0, 0], bias[0] = links.mass[0], -links.mass[0] * links.gravity_x
        return mass, bias
    first = links.mass[0] * links.centre[0]
    mass[0, 0] = links.inertia[0] + first * links.centre[0]
    angle = place[0]
    bias[0] = -first * (links.gravity_x * math.cos(angle) + links.gravity_z * math.sin(angle))
    if n == 1:
        return mass, bias
    m, r, length = links.mass[1], links.centre[1], links.length
    own = links.inertia[1] + m * r * r
    cross = m * length * r * math.cos(place[1])
    mass[0, 0] += own + m * length * length + 2.0 * cross
    mass[0, 1] = mass[1, 0] = own + cross
    mass[1, 1] = own
    swing = m * length * r * math.sin(place[1])
    both = angle + place[1]
    outer = m * r * (links.gravity_x * math.cos(both) + links.gravity_z * math.sin(both))
    inner = m * length * (links.gravity_x * math.cos(angle) + links.gravity_z * math.sin(angle))
    bias[0] += -swing * speed[1] * (2.0 * speed[0] + speed[1]) - inner - outer
    bias[1] = swing * speed[0] * speed[0] - outer
    return mass, bias


@kernel
def _row(rows, place, j):
    """Value of a planned column at a place between its rows, by straight lines."""
    at = min(max(place, 0.0), len(rows) - 1.000001)
    k = int(at)
    return (1.0 - at + k) * rows[k, j] + (at - k) * rows[k + 1, j]


@kernel
def _command(loop, plan, time, j, place, speed):
    """Command of the position loop."""
    known, row = loop.nominal[j], time / plan.period
    wanted = _row(plan.force, row, j) + loop.stiffness[j] * (_row(plan.goal, row, j) - place)
    wanted += loop.damping[j] * (_row(plan.rate, row, j) - speed)
    if known.gain == 0.0:
        return 0.0
    electric = known.position_gain * place + known.velocity_gain * speed
    value = (wanted / known.gear - known.bias - known.gear * electric) / known.gain
    return min(max(value, known.lowest), known.highest)


@kernel
def rates(time, state, joints, links, loop, plan, sharp, drives):
    """Derivative of position, speed and received command, shape (3 j,); fills the forces `drives`."""
    n = len(joints)
    place, speed, received = state[:n], state[n : 2 * n], state[2 * n :]
    found, driven, lost = np.empty(3 * n), np.empty(n), np.empty(n)
    mass, bias = _rigid(links, place, speed)
    whole = mass.copy()
    for j in range(n):
        own = joints[j]
        whole[j, j] += own.armature
        command = _command(loop, plan, time, j, place[j], speed[j])
        if own.lag > 0.0:
            found[2 * n + j] = (command - received[j]) / own.lag
            command = received[j]
        else:
            found[2 * n + j] = 0.0
        drives[j] = actuator_force(own, command, place[j], speed[j])
        passed, lost[j] = behind_gear(own, drives[j], speed[j])
        driven[j] = passed + outer_force(own, place[j]) - bias[j]
    load, bend = bias.copy(), np.zeros(n)
    for _ in range(_LOADS):
        push = driven.copy()
        for j in range(n):
            forward, backward, smooth = friction_bounds(joints[j], place[j], speed[j], load[j])
            side = math.tanh(speed[j] / sharp[j])
            push[j] -= smooth + ((forward if side > 0.0 else backward) + lost[j]) * side
        bend = np.linalg.solve(whole, push)
        load = mass @ bend + bias
    found[:n], found[n : 2 * n] = speed, bend
    return found


def integrated_rows(truth: MachineTruth, loop: Loop, plan: Plan) -> Array:
    """Position, speed, command and force of a run by scipy, shape (n − 1, 4, j), for rigid joints."""
    n = plan.goal.shape[1]
    links, sharp, drives = _links(truth), _SHARP * np.abs(plan.rate).max(axis=0), np.empty(n)
    times = np.arange(len(plan.goal) - 1) * plan.period
    extra = (truth.joints, links, loop, plan, sharp, drives)
    start = np.concatenate([plan.goal[0], np.zeros(2 * n)])
    found = solve_ivp(
        rates,
        (0.0, float(times[-1])),
        start,
        method="LSODA",
        t_eval=times,
        args=extra,
        rtol=_TOLERANCE,
        atol=_TOLERANCE * 1e-2,
        max_step=_LONGEST,
    )
    rows = np.empty((len(times), 4, n))
    for k, (time, state) in enumerate(zip(times.tolist(), found.y.T, strict=True)):
        rates(time, state, *extra)
        rows[k, 0], rows[k, 1], rows[k, 3] = state[:n], state[n : 2 * n], drives
        rows[k, 2] = [_command(loop, plan, time, j, state[j], state[n + j]) for j in range(n)]
    return rows
