"""Parameters that a drive did not excite, and for each the manoeuvre that is most informative about it.

A number is not excited if the data leave more than `NOT_EXCITED` of its prior deviation. Manoeuvres are
planned kinematically, the currents follow from the estimated balance; the information matrix of each
shows how far it would narrow the number.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from omnimj.estimate.robot.balance import felt_by_turning, inertia_matrix, roller_speeds
from omnimj.estimate.robot.blocks import PERIOD, RunRows
from omnimj.estimate.robot.fit import RobotFit, run_sums
from omnimj.estimate.robot.quantities import Quantity
from omnimj.estimate.robot.records import NOT_EXCITED, RobotEstimate, Unexcited
from omnimj.estimate.robot.smoothing import Shafts
from omnimj.estimate.robot.uncertainty import gradient
from omnimj.signals import Array

_REPEATS = 10
"""Number of repetitions of a manoeuvre."""
_HELPS = 0.85  # of the deviation: a manoeuvre that leaves more does not help
_ROUNDING, _NEAR = 0.1, 0.12  # [s]


class Manoeuvre(NamedTuple):
    """A manoeuvre of equal moves from rest to rest."""

    words: str
    twists: tuple[tuple[float, float, float], ...]
    """Top twist of each move [m/s, m/s, rad/s]."""
    acceleration: float
    """Acceleration of the rim of the fastest wheel [m/s²]."""
    held: float
    """Time at top speed [s]."""


def _square(speed: float) -> tuple[tuple[float, float, float], ...]:
    c = speed * np.sqrt(0.5)
    return ((c, c, 0.0), (-c, c, 0.0), (-c, -c, 0.0), (c, -c, 0.0))


MANOEUVRES = (
    Manoeuvre("drive a square across the axes, 0.5 m/s, 0.3 m/s²", _square(0.5), 0.3, 1.0),
    Manoeuvre("drive a square across the axes, brake hard at each corner, 1 m/s²", _square(0.8), 1.0, 0.5),
    Manoeuvre("drive a square across the axes, slowly, 0.25 m/s, 0.2 m/s²", _square(0.25), 0.2, 2.0),
    Manoeuvre("drive a square across the axes, fast, 1 m/s held for 2 s", _square(1.0), 0.5, 2.0),
    Manoeuvre("turn on the spot both ways, 1.5 rad/s", ((0.0, 0.0, 1.5), (0.0, 0.0, -1.5)), 0.5, 1.5),
    Manoeuvre(
        "drive ahead and back, left and right, while turning at 1 rad/s, 0.5 m/s²",
        ((0.5, 0.0, 1.0), (-0.5, 0.0, 1.0), (0.0, 0.5, -1.0), (0.0, -0.5, -1.0)),
        0.5,
        1.5,
    ),
)  # fmt: skip


def unexcited(fit: RobotFit, found: Sequence[tuple[Quantity, RobotEstimate]]) -> tuple[Unexcited, ...]:
    """Numbers that the drive did not excite, each with the manoeuvre that narrows it most."""
    open_ones = [
        (quantity, estimate)
        for quantity, estimate in found
        if quantity.is_parameter and estimate.left_of_prior > NOT_EXCITED
    ]
    if not open_ones:
        return ()
    hessian = fit.information + np.diag(fit.precision)
    after = [
        (m.words, np.asarray(np.linalg.inv(hessian + _REPEATS * information(fit, m)), float))
        for m in MANOEUVRES
    ]
    return tuple(_advised(fit, quantity, estimate, after) for quantity, estimate in open_ones)


def _advised(
    fit: RobotFit, quantity: Quantity, estimate: RobotEstimate, after: Sequence[tuple[str, Array]]
) -> Unexcited:
    slope = gradient(fit, quantity.of)
    before = float(np.sqrt(np.sum(slope**2 / fit.precision)))
    left = [(float(np.sqrt(slope @ cov @ slope)) / before, words) for words, cov in after]
    least, words = min(left)
    helps = least < _HELPS * estimate.left_of_prior
    return Unexcited(estimate, words if helps else "", least)


def information(fit: RobotFit, manoeuvre: Manoeuvre) -> Array:
    """Information on the unknowns that a manoeuvre would give at the fit's noise, shape (p, p)."""
    return run_sums(fit.unknowns, fit.x, fit.noise * np.sqrt(fit.memory), planned_rows(fit, manoeuvre)).gram


def planned_rows(fit: RobotFit, manoeuvre: Manoeuvre) -> RunRows:
    """Rows that a robot without slip would log in a manoeuvre."""
    c = fit.unknowns.constants(fit.x).robot
    twist = np.vstack([*_profile(manoeuvre, float(np.abs(c.forces[2]).max()))])
    twist = uniform_filter1d(twist, round(_ROUNDING / PERIOD), axis=0, mode="constant")
    rate = np.gradient(twist, PERIOD, axis=0)
    speed, change = twist @ c.forces / c.radius, rate @ c.forces / c.radius
    spin = twist[:, 2]
    # the origin of a turning frame
    felt = rate[:, :2] + spin[:, None] * np.column_stack([-twist[:, 1], twist[:, 0]])
    rows = RunRows(
        manoeuvre.words,
        "",
        PERIOD * np.arange(len(twist), dtype=float),
        np.zeros_like(speed),
        Shafts(np.zeros_like(speed), speed, change, np.zeros_like(speed)),
        speed,
        change,
        felt + felt_by_turning(c.accelerometer, spin, rate[:, 2]),
        spin,
        rate[:, 2],
        minimum_filter1d(np.abs(speed), 2 * round(_NEAR / PERIOD) + 1, axis=0),
        np.zeros(len(twist), int),
        np.ones(len(twist), bool),
        np.abs(speed).max(axis=1) < 0.1,
    )
    return _with_currents(fit, rows, np.column_stack([felt, rate[:, 2]]))


def _profile(manoeuvre: Manoeuvre, arm: float) -> Iterator[Array]:
    for twist in manoeuvre.twists:
        rim = float(np.hypot(twist[0], twist[1])) + arm * abs(twist[2])
        rise = max(round(rim / manoeuvre.acceleration / PERIOD), 2)
        up = np.linspace(0.0, 1.0, rise, endpoint=False)
        share = np.concatenate([up, np.ones(round(manoeuvre.held / PERIOD)), 1.0 - up, np.zeros(10)])
        yield share[:, None] * np.array(twist)


def _with_currents(fit: RobotFit, rows: RunRows, motion: Array) -> RunRows:
    """Currents that make the motion, of all that do the smallest forces."""
    c, axle, rotor = fit.unknowns.constants(fit.x)
    side = roller_speeds(c, rows)
    drag = c.load * (c.roller_dry * np.tanh(side / 0.01) + c.roller_viscous * side)
    push = motion @ inertia_matrix(c).T + drag @ c.across
    sign = np.tanh(rows.wheel_speed / 0.3)
    behind = push @ np.linalg.pinv(c.forces).T + axle * sign
    behind = behind + (c.inertia - rotor) * rows.wheel_acceleration
    shaft = np.where(behind * sign < 0.0, behind / c.driven, behind)
    shaft = shaft + rotor * rows.wheel_acceleration + (c.dry - axle) * sign + c.viscous * rows.wheel_speed
    current = shaft / c.torque
    return dataclasses.replace(rows, current=current, shafts=rows.shafts._replace(current=current))
