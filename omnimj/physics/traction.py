"""Traction between wheel and floor: LuGre, LuGre with a ceiling, Magic Formula.

All laws share one internal state z per wheel with ż = V_r − λ z, where λ ≥ 0 depends on the slip velocity,
and a force over the normal force f(z, ż, V_r). For frozen slip the state is stepped exactly, hence stable at
any slip velocity: z⁺ = z e^(−λh) + V_r (1 − e^(−λh))/λ.

Kernels take a floor as `parameters.floor.TractionParameters`; packed rows are read with `traction_at`.
"""

from __future__ import annotations

import math

from omnimj.parameters.floor import MAGIC_FORMULA, TRACTION_SIZE, TractionParameters
from omnimj.physics.native import first_numbers, kernel

_SMALL = 1e-12


@kernel
def traction_at(row):
    """`TractionParameters` of a packed row, shape (TRACTION_SIZE,)."""
    return TractionParameters(*first_numbers(row, TRACTION_SIZE))


@kernel
def stribeck(floor, slip):
    """g(V_r) = μ_c + (μ_s − μ_c) exp(−|V_r/V_s|^½), Eq. 3.43 [1]."""
    return floor.mu_c + (floor.mu_s - floor.mu_c) * math.exp(-math.sqrt(abs(slip) / floor.V_s))


@kernel
def relaxation_rate(floor, slip, reference_speed):
    """λ of ż = V_r − λ z [1/s]: σ0 |V_r|/g for LuGre (Eq. 3.41), speed over relaxation length otherwise.

    Args:
      floor: `TractionParameters`.
      slip: V_r = r φ̇ − V [m/s].
      reference_speed: max(|r φ̇|, |V|) [m/s], the denominator of the slip ratio, Eq. 3.17.
    """
    if floor.law == MAGIC_FORMULA:
        return reference_speed / floor.relaxation_length
    return floor.sigma_0 * abs(slip) / stribeck(floor, slip)


@kernel
def exact_step(z, slip, rate, h):
    """Bristle deflection after h seconds of constant slip, exact for any rate [m].

    Args:
      z: Bristle deflection [m].
      slip: V_r [m/s].
      rate: λ from `relaxation_rate` [1/s].
      h: Step [s].
    """
    x = rate * h
    if x < 1e-9:
        return z + slip * h
    # expm1: 1 − e^(−x) would lose its digits at small x
    return z + (slip / rate - z) * -math.expm1(-x)


@kernel
def mean_deflection(z, z_next, slip, rate, h):
    """Mean bristle deflection over an exact step, (V_r h − (z⁺ − z))/(λ h) [m].

    With this z, σ0 z + σ1 (V_r − λ z) is the mean force of the step, however fast the bristle is.

    Args:
      z: Deflection before the step [m].
      z_next: Deflection after the step, from `exact_step` [m].
      slip: V_r [m/s].
      rate: λ [1/s].
      h: Step [s].
    """
    x = rate * h
    if x < 1e-3:  # a series, where the difference below would lose its digits
        return z + (slip - rate * z) * h * (0.5 - x / 6.0 + x * x / 24.0)
    return (slip * h - (z_next - z)) / x


@kernel
def force_ratio(floor, z, slip, rate):
    """Traction over normal force F/F_N [1], Eqs. 3.42 and 3.18.

    Args:
      floor: `TractionParameters`.
      z: Bristle deflection [m].
      slip: V_r [m/s].
      rate: λ from `relaxation_rate` [1/s].
    """
    z_dot = slip - rate * z
    if floor.law == MAGIC_FORMULA:
        s = floor.B * (z + floor.damping_time * z_dot) / floor.relaxation_length
        return floor.D * math.sin(floor.C * math.atan(s - floor.E * (s - math.atan(s))))
    ratio = floor.sigma_0 * z + floor.sigma_1 * z_dot + floor.sigma_2 * slip
    return min(max(ratio, -floor.mu_cap), floor.mu_cap)


@kernel
def steady_ratio(floor, slip, reference_speed):
    """F/F_N with a settled bristle: g sign(V_r) + σ2 V_r, or the Magic Formula of V_r/speed [1].

    Args:
      floor: `TractionParameters`.
      slip: V_r [m/s].
      reference_speed: max(|r φ̇|, |V|) [m/s].
    """
    rate = relaxation_rate(floor, slip, reference_speed)
    if rate < _SMALL:
        return 0.0
    return force_ratio(floor, slip / rate, slip, rate)
