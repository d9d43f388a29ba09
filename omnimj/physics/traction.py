"""Traction between wheel and floor: LuGre, LuGre with a ceiling, Magic Formula.

All laws share one internal state z per wheel with ż = V_r − λ z, where λ ≥ 0 depends on the slip, and a
force over the normal force f(z, ż, V_r). For frozen slip the state is stepped exactly, hence stable at any
slip speed: z⁺ = z e^(−λh) + V_r (1 − e^(−λh))/λ.

A floor comes as its row of numbers (`parameters.Floor.row`).
"""

from __future__ import annotations

import math

from omnimj.parameters.floor import MAGIC_FORMULA
from omnimj.physics.native import kernel

_SMALL = 1e-12


@kernel
def stribeck(row, slip):
    """g(V_r) = μ_c + (μ_s − μ_c) exp(−|V_r/V_s|^½), Eq. 3.43 [1]."""
    return row[1] + (row[2] - row[1]) * math.exp(-math.sqrt(abs(slip) / row[3]))


@kernel
def relaxation_rate(row, slip, reference_speed):
    """λ of ż = V_r − λ z [1/s]: σ0 |V_r|/g for LuGre (Eq. 3.41), speed over relaxation length else.

    Args:
      row: A floor's numbers.
      slip: V_r = r φ̇ − V [m/s].
      reference_speed: max(|r φ̇|, |V|) [m/s], the denominator of the slip ratio, Eq. 3.17.
    """
    if row[0] == MAGIC_FORMULA:
        return reference_speed / row[5]
    return row[4] * abs(slip) / stribeck(row, slip)


@kernel
def exact_step(z, slip, rate, h):
    """State after h seconds of constant slip, exact for any rate [m]."""
    x = rate * h
    if x < 1e-9:
        return z + slip * h
    # expm1: 1 − e^(−x) would lose its digits at small x
    return z + (slip / rate - z) * -math.expm1(-x)


@kernel
def force_ratio(row, z, slip, rate):
    """Traction over normal force F/F_N [1], Eqs. 3.42 and 3.18.

    Args:
      row: A floor's numbers.
      z: Bristle deflection [m].
      slip: V_r [m/s].
      rate: λ from `relaxation_rate` [1/s].
    """
    z_dot = slip - rate * z
    if row[0] == MAGIC_FORMULA:
        s = row[1] * (z + row[6] * z_dot) / row[5]
        return row[3] * math.sin(row[2] * math.atan(s - row[4] * (s - math.atan(s))))
    ratio = row[4] * z + row[5] * z_dot + row[6] * slip
    return min(max(ratio, -row[7]), row[7])


@kernel
def steady_ratio(row, slip, reference_speed):
    """F/F_N once the bristle has settled: g sign(V_r) + σ2 V_r, or the Magic Formula of V_r/speed [1]."""
    rate = relaxation_rate(row, slip, reference_speed)
    if rate < _SMALL:
        return 0.0
    return force_ratio(row, slip / rate, slip, rate)
