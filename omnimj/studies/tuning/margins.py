"""Stability of the control loops: crossover, phase margin and overshoot in closed form.

A wheel on the floor, linear about rest, with s = iω and F_N the load of one wheel:
  F = Z (r φ̇ − V),  Z = F_N (σ0/s + σ1 + σ2),  (I s + b) φ̇ = K_t E G_r i − r F,
and the body's speeds at the wheels V = P F/s with P = A M⁻¹ Aᵀ, shape (n, n). All wheels have the same loop,
so that the eigenvectors of P decouple them: one loop per eigenvalue p [1/kg], p = 0 where the wheels push
against each other, and one for a wheel in the air (Z = 0):
  G = K_t E G_r/(I s + b + r²/(1/Z + p/s)).
Around it the amplifier 1/(1 + τ s), the command held over a period h, and in z = e^(sh) the PI law
K_P + K_I h/(z − 1) and the encoder's speed, (1 − z⁻¹)/(s h) of the angle's difference through its one-pole
filter. The yaw-rate loop contains the wheel loops, the gyro's filter and the lag of its gain
K (1 + (ρ − 1) (1 − d)/(1 − d z⁻¹))/ρ, d its decay over a period; the heading loop contains the yaw-rate loop.
The step response of a wheel's speed, T(s) = C G/(1 + L): y(t) = 2/π ∫ Re T(iω) sin(ωt)/ω dω.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnimj.control.cascade.heading import yaw_rate_gain
from omnimj.errors import InputError
from omnimj.parameters import Control, Floor, Robot
from omnimj.parameters.parts import GRAVITY
from omnimj.physics.kinematics import rolling_matrix
from omnimj.physics.traction import load_factor
from omnimj.signals import Array

Complex = NDArray[Any]

FLOORS = ("natural_stone", "pvc", "paperboard")
"""Floors of Table 4.1; the friction laws of others have no σ."""
AIR = "in the air"
SPEED, YAW_RATE, HEADING = "wheel speed", "yaw rate", "heading"
_LOWEST, _POINTS = 0.02, 800  # lowest frequency [Hz] and number of points of the sweep
_SAME = 1e-9  # relative to the largest eigenvalue
_LONGEST, _STEPS = 1.0, 250  # duration [s] and number of instants of the step response
_FINE = 4000  # points of the integral over ω


@dataclass(frozen=True)
class Margin:
    """Phase margin of one loop."""

    loop: str
    """`wheel speed`, `yaw rate` or `heading`."""
    where: str
    """`pvc, 2.2 kg per wheel`, `in the air`."""
    crossover: float
    """Crossover frequency |L| = 1 [Hz]; of several, that with the smallest margin; 0: none."""
    phase: float
    """Phase margin 180° + arg L, unwrapped from low frequencies, at most 180; 180 without crossover [°]."""


def margins(robot: Robot, control: Control, floors: Iterable[Floor]) -> tuple[Margin, ...]:
    """Return the margin of every loop; those of the wheels on every floor and in the air.

    Raises:
      InputError: A floor with another law.
    """
    chain = _LoopModel(robot, control)
    found = [_margin(SPEED, AIR, chain, lambda s: chain.open_loop(s, None, 0.0))]
    for floor in floors:
        stiff = _impedance(floor, robot)
        for p in _distinct(chain.mobilities):
            where = f"{floor.name}, {_mass_words(p)}"
            found.append(_margin(SPEED, where, chain, lambda s, p=p, z=stiff: chain.open_loop(s, z, p)))
        if control.yaw_rate_proportional > 0.0:
            found.append(_margin(YAW_RATE, floor.name, chain, lambda s, z=stiff: chain.yaw_loop(s, z)))
        if control.heading_proportional > 0.0:
            found.append(_margin(HEADING, floor.name, chain, lambda s, z=stiff: chain.heading_loop(s, z)))
    return tuple(found)


@dataclass(frozen=True)
class LoopStability:
    """Stability of all loops together."""

    phase: float
    """Smallest phase margin [°]."""
    overshoot: float
    """Largest overshoot of the wheel speed, relative to the step."""


def loop_stability(robot: Robot, control: Control, floors: Sequence[Floor]) -> LoopStability:
    """Return smallest phase margin and largest overshoot; arguments as for `margins`."""
    phase = smallest_margin(margins(robot, control, floors)).phase
    return LoopStability(phase, max(overshoots(robot, control, floors).values()))


def overshoots(robot: Robot, control: Control, floors: Iterable[Floor]) -> dict[str, float]:
    """Return the overshoot of the wheel speed after a step, relative to the step, by floor and load.

    It applies to a wheel that moves the body, linearised about rest like the margins; current limit and
    friction reduce the overshoot of a real step. Arguments as for `margins`.
    """
    chain = _LoopModel(robot, control)
    omega, weights, below = _sine_integral(chain.period)
    found = {}
    for floor in floors:
        stiff = _impedance(floor, robot)
        for p in _distinct([p for p in chain.mobilities if 1.0 / max(p, 1e-12) < robot.body.mass]):
            real = chain.step_response(1j * omega, stiff, p).real
            response = 2.0 / np.pi * (weights @ real + below)
            found[f"{floor.name}, {_mass_words(p)}"] = max(float(np.max(response)) - 1.0, 0.0)
    return found


@lru_cache(maxsize=4)
def _sine_integral(period: float) -> tuple[Array, Array, Array]:
    """Return ω [rad/s], shape (k,), and what ∫ Re T sin(ωt)/ω dω needs at m instants t.

    That is a weight per instant and ω by the trapezoidal rule, shape (m, k), and the part of the integral
    below the sweep, shape (m,): T = 1 there, and Si(ω t) ≈ ω t.
    """
    time = np.linspace(0.0, _LONGEST, _STEPS + 1)[1:]
    omega = 2.0 * np.pi * np.geomspace(_LOWEST, 0.499 / period, _FINE)
    width = np.diff(omega, prepend=omega[0], append=omega[-1])
    weights = np.sin(np.outer(time, omega)) * (0.5 * (width[:-1] + width[1:]) / omega)
    return omega, weights, omega[0] * time


def smallest_margin(found: Sequence[Margin], loop: str | None = None) -> Margin:
    """Return the smallest phase margin of all loops, or of those with one name."""
    return min((m for m in found if loop is None or m.loop == loop), key=lambda m: m.phase)


def _impedance(floor: Floor, robot: Robot) -> Callable[[Complex], Complex]:
    """Return Z(s) of one wheel at rest [N.s/m]."""
    if floor.law != "lugre":
        raise InputError(f"floor {floor.name}", f"found law '{floor.law}'", "margins need the law 'lugre'")
    load = robot.body.mass * GRAVITY / len(robot.wheels)
    load *= load_factor(floor.traction, load)
    stiffness, damping = floor.numbers["sigma_0"], floor.numbers["sigma_1"] + floor.numbers["sigma_2"]
    return lambda s: load * (stiffness / s + damping)


def _distinct(values: Sequence[float]) -> list[float]:
    found: list[float] = []
    for value in sorted(values):
        if not found or value - found[-1] > _SAME * max(values):
            found.append(value)
    return found


def _mass_words(mobility: float) -> str:
    return "wheels against each other" if mobility <= 1e-6 else f"{1.0 / mobility:.3g} kg per wheel"


class _LoopModel:
    """Loop gains of the robot as functions of s = iω, shape (k,)."""

    def __init__(self, robot: Robot, control: Control):
        motor, sensors = robot.motor, robot.sensors
        self.period = 1.0 / sensors.sample_rate
        self._control, self._radius, self._lag = control, robot.wheel.radius, motor.current_loop
        gear = motor.gear_ratio * motor.gear_efficiency
        self._torque = motor.torque_constant * gear
        self._inertia = robot.wheel.inertia + motor.reflected_inertia
        self._friction = motor.viscous * motor.gear_ratio * gear
        self._decay = math.exp(-self.period / sensors.speed_filter)
        self._yaw_gain = yaw_rate_gain(control, self.period)
        self._gyro_decay = math.exp(-2.0 * math.pi * sensors.gyro_bandwidth * self.period)
        a = rolling_matrix(robot.wheel_positions, robot.rolling_directions)
        body = np.array([robot.body.mass, robot.body.mass, robot.body.yaw_inertia])
        values, vectors = np.linalg.eigh(a / body @ a.T)
        self.mobilities = [max(float(v), 0.0) for v in values]
        # yaw acceleration per force of a mode, times its share of a yaw-rate demand
        self._yaw_shares = (a[:, 2] @ vectors / body[2]) * (a[:, 2] @ vectors)

    def _held(self, s: Complex) -> Complex:
        """Return the zero-order hold over a period."""
        return (1.0 - np.exp(-s * self.period)) / (s * self.period)

    def _speed_law(self, s: Complex) -> Complex:
        step = self._control.speed_integral * self.period
        return self._control.speed_proportional + step / (np.exp(s * self.period) - 1.0)

    def _filtered(self, s: Complex, decay: float) -> Complex:
        return (1.0 - decay) / (1.0 - decay * np.exp(-s * self.period))

    def _wheel(self, s: Complex, z: Callable[[Complex], Complex] | None, p: float) -> Complex:
        """Return wheel speed over commanded current."""
        floor = 0.0 if z is None else self._radius**2 / (1.0 / z(s) + p / s)
        return (
            self._torque
            / (self._inertia * s + self._friction + floor)
            / (1.0 + self._lag * s)
            * self._held(s)
        )

    def open_loop(self, s: Complex, z: Callable[[Complex], Complex] | None, p: float) -> Complex:
        """Return L of the wheel-speed loop; the encoder's difference over a sample acts as another hold."""
        sensed = self._held(s) * self._filtered(s, self._decay)
        return self._speed_law(s) * self._wheel(s, z, p) * sensed

    def step_response(self, s: Complex, z: Callable[[Complex], Complex], p: float) -> Complex:
        """Return wheel speed over commanded wheel speed."""
        return self._speed_law(s) * self._wheel(s, z, p) / (1.0 + self.open_loop(s, z, p))

    def _turning(self, s: Complex, z: Callable[[Complex], Complex]) -> Complex:
        """Return yaw rate over yaw-rate demand, through the closed wheel loops."""
        total = np.zeros_like(s)
        for p, share in zip(self.mobilities, self._yaw_shares, strict=True):
            total += share / s * self.step_response(s, z, p) / (1.0 / z(s) + p / s)
        return total

    def _yaw_law(self, s: Complex) -> Complex:
        gain = self._yaw_gain
        lagging = (1.0 - gain.fast_share) * self._filtered(s, gain.decay)
        return gain.slow * (gain.fast_share + lagging)

    def yaw_loop(self, s: Complex, z: Callable[[Complex], Complex]) -> Complex:
        """Return L of the yaw-rate loop, through the gyro's filter."""
        return self._yaw_law(s) * self._turning(s, z) * self._filtered(s, self._gyro_decay)

    def heading_loop(self, s: Complex, z: Callable[[Complex], Complex]) -> Complex:
        """Return L of the heading loop around the closed yaw-rate loop; the heading integrates the gyro."""
        gain = self._control.heading_proportional * (1.0 + self._yaw_law(s))
        inner = self._turning(s, z) / (1.0 + self.yaw_loop(s, z))
        return gain * inner * self._filtered(s, self._gyro_decay) / s


def _margin(loop: str, where: str, chain: _LoopModel, gain: Callable[[Complex], Complex]) -> Margin:
    frequency = np.geomspace(_LOWEST, 0.499 / chain.period, _POINTS)
    found = gain(2j * np.pi * frequency)
    size, angle = np.log(np.abs(found)), np.unwrap(np.angle(found))
    crossings = np.flatnonzero(np.diff(np.sign(size)) != 0.0)
    worst = Margin(loop, where, 0.0, 180.0)
    for k in crossings:
        share = size[k] / (size[k] - size[k + 1])
        at = float(frequency[k] * (frequency[k + 1] / frequency[k]) ** share)
        # a leading loop has the full margin of 180°
        exact = float(np.unwrap([angle[k], np.angle(gain(np.array([2j * np.pi * at]))[0])])[1])
        turned = min(180.0 + math.degrees(exact), 180.0)
        if turned < worst.phase:
            worst = Margin(loop, where, at, turned)
    return worst
