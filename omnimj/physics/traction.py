"""Traction between wheel and floor: LuGre, Magic Formula, creep ratio; rolling resistance of the floor.

All laws share one internal state z per wheel with ż = V_r − λ z, where λ ≥ 0 depends on slip and rolling
speed, and a force F = f(z, ż, V_r) F_N (F_N/F_ref)^(p−1), |f| ≤ μ_cap. For frozen slip the state is stepped
exactly, hence stable at any slip velocity: z⁺ = z e^(−λh) + V_r (1 − e^(−λh))/λ. At standstill λ = 0: z is
then the deflection of a spring between wheel and floor, which holds.

Kernels take a `floor` as `parameters.floor.TractionParameters`; packed rows are read with `traction_at`.
Their `slip` is V_r = r φ̇ − V [m/s], `rolling_speed` V_roll from the kernel of that name [m/s], `rate` λ from
`relaxation_rate` [1/s], z the bristle deflection [m], `sideways` the velocity u that turns the roller [m/s],
and h the step [s].
"""

from __future__ import annotations

import math

from omnimj.parameters.floor import CREEP_RATIO, LUGRE, TRACTION_SIZE, TractionParameters
from omnimj.physics.native import first_numbers, kernel

_REST = 1e-3  # [m/s] ε: below it a contact counts as one that rolls in no direction yet


@kernel
def traction_at(row):
    """`TractionParameters` of a packed row, shape (TRACTION_SIZE,)."""
    return TractionParameters(*first_numbers(row, TRACTION_SIZE))


@kernel
def stribeck(floor, slip):
    """g(V_r) = μ_c + (μ_s − μ_c) exp(−|V_r/V_s|^½), Eq. 3.43 [1]."""
    return floor.mu_c + (floor.mu_s - floor.mu_c) * math.exp(-math.sqrt(abs(slip) / floor.V_s))


@kernel
def full_sliding(floor):
    """Creep ratio ξ_s = 3 μ/C from which the whole contact slides [1]."""
    return 3.0 * floor.mu / floor.creep_stiffness


@kernel
def rolling_speed(floor, rim, along, sideways):
    """V_roll, the denominator of the slip ratio [m/s]: √(p² + u²) for creep ratio and turnover, else p.

    p = max(|r φ̇|, |V|) along the drive, Eq. 3.17, and u across it on the rollers. By creep ratio, bristles
    leave the contact with its rolling in any direction, along the drive or across on the rollers: measured on
    a real robot with three wheels on soft floors.

    Args:
      rim: r φ̇ [m/s].
      along: Velocity V of the wheel along its drive [m/s].
    """
    rolling = max(abs(rim), abs(along))
    if floor.law == CREEP_RATIO or floor.turnover > 0.0:
        return math.hypot(rolling, sideways)
    return rolling


@kernel
def rolling_resistance(floor, rolling, sideways):
    """Rolling resistance over F_N: μ_r |p|_ε/V_ε on wheels, μ_rd + (μ_r + μ_rr) |u|_ε/V_ε on rollers [1].

    A soft floor resists rolling in the direction (p, u) of the contact: the turning of wheels with μ_r F_N,
    that of their rollers, which are small and sink in deeper, with (μ_r + μ_rr) F_N. |x|_ε = √(x² + ε²) and
    V_ε = √(p² + u² + ε²) with ε = 1 mm/s: at rest both parts hold in full, and a wheel that rolls along its
    drive has little drag across. What rubs on the rollers adds μ_rd in any direction.

    Args:
      rolling: p = max(|r φ̇|, |V|) along the drive [m/s].
    """
    on_wheel, on_rollers = floor.rolling_resistance, floor.rolling_resistance + floor.roller_resistance
    if on_rollers == 0.0:
        return 0.0, floor.roller_dry
    ahead, aside = rolling * rolling, sideways * sideways
    speed = math.sqrt(ahead + aside + _REST * _REST)
    on_wheel *= math.sqrt(ahead + _REST * _REST) / speed
    return on_wheel, floor.roller_dry + on_rollers * math.sqrt(aside + _REST * _REST) / speed


@kernel
def relaxation_rate(floor, slip, rolling_speed):
    """λ of ż = V_r − λ z [1/s]: σ0 |V_r|/g + κ V_roll for LuGre, speed over relaxation length otherwise.

    LuGre: Eq. 3.41, and bristles that leave the contact as it rolls, κ per distance. Without κ traction
    follows the slip speed, with it at small slip the creep ratio, F/F_N = (σ0/κ) V_r/V_roll (averaged lumped
    LuGre: Deur, Asgari and Hrovat, *A 3D brush-type dynamic tire friction model*, 2004).

    Creep ratio: L dξ/dt = V_r − max(V_roll, |V_r|/ξ_s) ξ with ξ = z/L, the first-order lag of a rolling
    contact (Pacejka, *Tire and Vehicle Dynamics*, chapter 7). In full sliding, ξ ≥ ξ_s, the contact deflects
    no further than L ξ_s, so that it grips again at once when sliding ends.
    """
    if floor.law == LUGRE:
        return floor.sigma_0 * abs(slip) / stribeck(floor, slip) + floor.turnover * rolling_speed
    if floor.law == CREEP_RATIO:
        rolling_speed = max(rolling_speed, abs(slip) / full_sliding(floor))
    return rolling_speed / floor.relaxation_length


@kernel
def exact_step(z, slip, rate, h):
    """Bristle deflection after h seconds of constant slip, exact for any rate [m]."""
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
    """
    x = rate * h
    if x < 1e-3:  # a series, where the difference below would lose its digits
        return z + (slip - rate * z) * h * (0.5 - x / 6.0 + x * x / 24.0)
    return (slip * h - (z_next - z)) / x


@kernel
def force_ratio(floor, z, slip, rate):
    """Traction over normal force f = F/F_N at the reference load, |f| ≤ μ_cap [1], Eqs. 3.42 and 3.18.

    LuGre: σ0 z + σ1' ż + σ2 V_r with σ1' from `passive_damping`.
    """
    z_dot = slip - rate * z
    if floor.law == LUGRE:
        ratio = floor.sigma_0 * z + passive_damping(floor, rate) * z_dot + floor.sigma_2 * slip
    elif floor.law == CREEP_RATIO:
        ahead = z + floor.damping_time * z_dot / (1.0 + floor.damping_time * rate)
        ratio = creep_traction(floor, ahead / floor.relaxation_length)
    else:
        s = floor.B * (z + floor.damping_time * z_dot) / floor.relaxation_length
        ratio = floor.D * math.sin(floor.C * math.atan(s - floor.E * (s - math.atan(s))))
    return min(max(ratio, -floor.mu_cap), floor.mu_cap)


@kernel
def passive_damping(floor, rate):
    """Damping of the bristle σ1' = min(σ1, 2a + 2√(a² + a σ2)), a = σ0/λ, with which LuGre is passive [s/m].

    With V_r = ż + λ z the power f V_r − d(σ0 z²/2)/dt is a quadratic form in ż and λ z, which is never
    negative exactly if σ1²/4 ≤ (σ1 + σ2) a. A constant σ1 breaks that at high slip, where the bristle
    springs back faster than the wheel slides and the model would make energy. Source: Barahona and Canudas de
    Wit, *Necessary and sufficient conditions for passivity of the LuGre friction model*, 2000.

    Args:
      floor: `TractionParameters` with the law `lugre`.
    """
    if floor.sigma_1 * floor.sigma_1 * rate <= 4.0 * floor.sigma_0 * (floor.sigma_1 + floor.sigma_2):
        return floor.sigma_1
    a = floor.sigma_0 / rate
    return 2.0 * (a + math.sqrt(a * (a + floor.sigma_2)))


@kernel
def creep_traction(floor, creep):
    """F/F_N = μ [1 − (1 − |ξ|/ξ_s)³] sign ξ up to ξ_s = 3 μ/C, μ sign ξ beyond [1].

    The brush model: slope C at zero, one smooth curve to full sliding. Source: Pacejka, *Tire and Vehicle
    Dynamics*, chapter 3; for creep of elastic bodies Johnson, *Contact Mechanics*, chapter 8.

    Args:
      floor: `TractionParameters` with the law `creep_ratio`.
      creep: Creep ratio ξ = V_r/V_roll [1].
    """
    sliding = min(abs(creep) / full_sliding(floor), 1.0)  # share of the contact
    return math.copysign(floor.mu * sliding * (3.0 + sliding * (sliding - 3.0)), creep)


@kernel
def load_factor(floor, normal_force):
    """(F_N/F_ref)^(p−1), by which the normal force is multiplied; 1 for p = 1, 0 without load [1].

    Args:
      normal_force: F_N of the whole wheel [N].
    """
    if floor.load_exponent == 1.0:
        return 1.0
    if normal_force <= 0.0:  # a negative exponent
        return 0.0
    return (normal_force / floor.reference_load) ** (floor.load_exponent - 1.0)
