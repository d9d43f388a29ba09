"""Steady traction curve F/F_N over slip: the fitted curve, the covered slip, and the points of Eq. (4.26)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from omnimj.estimate.identification.floor_fit import MU_C, MU_S, RADIUS_SCALE, SIGMA_2, V_S, FloorFit
from omnimj.estimate.identification.records import Points
from omnimj.estimate.identification.runs import CarriageRun
from omnimj.parameters.parts import GRAVITY
from omnimj.physics import carriage
from omnimj.signals import Array

_SETTLED = 0.75  # smallest deflection of a settled bristle relative to its final one
_BEYOND = 1.5  # largest deflection of a settled bristle relative to its final one
_EDGES = (0.05, 0.98)  # quantiles of the slip of settled blocks: the covered range
_FEWEST = 5  # smallest number of settled blocks for a covered range
_SLIDES = 0.02  # [m/s] smallest slip of the points for the starting values
_EPSILON = 1e-4


def stribeck(shared: Array, slip: Array) -> Array:
    """g(V_r) [1], Eq. 3.43, at V_r of shape (n,) [m/s]; `shared` are logarithms, shape (SHARED,)."""
    mu_c, mu_s, speed = np.exp(shared[[MU_C, MU_S, V_S]])
    return mu_c + (mu_s - mu_c) * np.exp(-np.sqrt(np.abs(slip) / speed))


def steady_curve(shared: Array, slip: Array) -> Array:
    """F/F_N = g(V_r) sign V_r + σ2 V_r [1]; shapes as for `stribeck`."""
    return stribeck(shared, slip) * np.sign(slip) + np.exp(shared[SIGMA_2]) * slip


def slope(function, shared: Array, slip: Array) -> Array:
    """Derivative of `stribeck` or `steady_curve` by the shared unknowns, shape (slips, SHARED)."""
    steps = _EPSILON * np.eye(len(shared))
    return np.stack(
        [(function(shared + s, slip) - function(shared - s, slip)) / (2 * _EPSILON) for s in steps], 1
    )


def points(fit: FloorFit) -> Points:
    """Block means of all runs by Eq. (4.26), with the fitted model in the same blocks."""
    found = []
    for run, blocks in zip(fit.problem.runs, fit.problem.simulated(fit.shared, fit.own), strict=True):
        radius = run.parameters.radius * np.exp(fit.shared[RADIUS_SCALE])
        slip, ratio = measured_points(run, radius)
        found.append(np.stack((slip, ratio, blocks[:, carriage.SLIP], blocks[:, carriage.RATIO]), axis=1))
    table = np.concatenate(found)
    table = table[np.isfinite(table).all(axis=1)]
    return Points(*(np.ascontiguousarray(column) for column in table.T))


def measured_points(run: CarriageRun, radius: float) -> tuple[Array, Array]:
    """Block means by Eq. (4.26): V_r = r φ̇ − V [m/s] and F/F_N = (m V̇ + F_rail + F_roll)/(m g) [1].

    Returns:
      V_r and F/F_N in blocks, each of shape (m,); NaN where not measured.
    """
    speed, acceleration = run.measured.T
    wheel = run.wheel_speed.reshape(-1, run.per_block).mean(axis=1)
    mass, dry, viscous = run.parameters.mass, run.parameters.dry, run.parameters.viscous
    force = mass * acceleration + dry * np.sign(speed) + viscous * speed
    return radius * wheel - speed, force / (mass * GRAVITY)


def start_values(runs: Sequence[CarriageRun]) -> Array:
    """Initial parameters from a straight line through the sliding points of Eq. (4.26), shape (SHARED,).

    The line is biased where slip is small against its noise, but good enough to start from.
    """
    shared = np.log([0.1, 0.1, 0.05, 30.0, 0.3, 2.5, 1.0])
    pairs = [measured_points(run, run.parameters.radius) for run in runs]
    slip = np.concatenate([pair[0] for pair in pairs])
    ratio = np.concatenate([pair[1] for pair in pairs])
    slides = np.isfinite(slip) & np.isfinite(ratio) & (np.abs(slip) > _SLIDES) & (slip * ratio > 0.0)
    if slides.sum() >= 2 * _FEWEST:
        table = np.stack((np.ones(slides.sum()), np.abs(slip[slides])), axis=1)
        level, viscous = np.linalg.lstsq(table, np.abs(ratio[slides]), rcond=None)[0]
        shared[MU_C] = shared[MU_S] = np.log(np.clip(level, 0.01, 1.0))
        shared[SIGMA_2] = np.log(np.clip(viscous, 0.05, 20.0))
    return shared


def covered_slip(fit: FloorFit) -> tuple[float, float] | None:
    """Range of slip over which the runs slide with a settled bristle [m/s]; None if they never do.

    While the bristle is still being stretched, F/F_N depends on its stiffness and not on g.
    """
    slips = []
    for run, blocks in zip(fit.problem.runs, fit.problem.simulated(fit.shared, fit.own), strict=True):
        slip, ratio = blocks[:, carriage.SLIP], blocks[:, carriage.RATIO]
        viscous = np.exp(fit.shared[SIGMA_2])
        # steady: σ0 z = g sign V_r; σ1 ż fades with the rest
        share = (ratio - viscous * slip) * np.sign(slip) / stribeck(fit.shared, slip)
        counts = np.isfinite(run.measured[:, 0]) & (share > _SETTLED) & (share < _BEYOND)
        slips.append(np.abs(slip[counts]))
    found = np.concatenate(slips)
    if len(found) < _FEWEST:
        return None
    low, high = np.quantile(found, _EDGES)
    return float(low), float(high)
