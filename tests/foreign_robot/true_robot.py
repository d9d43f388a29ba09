"""The true constants of a four-wheel omni robot that no model file states, and its faults.

A robot is drawn: parts differ from wheel to wheel, a payload sits somewhere, the floor is its own. Nominal
values are those that a data sheet would state. SI units; body frame x ahead, y left; wheels 1-4 ahead, right,
behind, left.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

GearLaw: TypeAlias = Literal["multiplies", "divides", "own"]

GRAVITY = 9.81
ARM = 0.25
"""Distance of a wheel from the centre [m]."""
PLACES = np.array([[ARM, 0.0], [0.0, -ARM], [-ARM, 0.0], [0.0, ARM]])
"""Positions of the wheels in the body frame [m]."""
DIRECTIONS = np.array([[0.0, -1.0], [-1.0, 0.0], [0.0, 1.0], [1.0, 0.0]])
"""Driving directions of the wheels in the body frame: traction on wheel i pushes the body along them."""
NOMINAL_RADIUS = 0.050
"""Wheel radius that the robot's own controller takes for true [m]."""

Four: TypeAlias = tuple[float, float, float, float]


def four(value: float) -> Four:
    """One value at all four wheels."""
    return (value, value, value, value)


@dataclass(frozen=True)
class Sensors:
    """Constants of the sensors between the motion and the log."""

    encoder_counts: float = 1024.0
    """Counts per turn of the motor shaft."""
    speed_filter: float = 4e-3
    """First-order lag of the wheel speed [s]."""
    current_noise: float = 0.01
    current_offset: Four = field(default_factory=lambda: four(0.0))
    """Offsets of the four current monitors [A]."""
    acceleration_noise: float = 0.10
    acceleration_bias: tuple[float, float] = (0.0, 0.0)
    """Bias of the two axes [m/s²]."""
    acceleration_bandwidth: float = 70.0
    """First-order corner of the accelerometer [Hz]."""
    acceleration_place: tuple[float, float] = (0.0, 0.0)
    """Where the accelerometer sits in the body frame [m]."""
    acceleration_tilt: tuple[float, float] = (0.0, 0.0)
    """Angles by which the unit is mounted out of level: a share of gravity on each axis [rad]."""
    gyro_noise: float = 0.0037
    gyro_bias: float = 0.0
    gyro_bandwidth: float = 140.0
    heading_noise: float = 1.5e-3
    heading_rate: float = 200.0
    """Updates of the measured heading per second; between them it is held [Hz]."""
    camera_rate: float = 30.0
    camera_delay: float = 0.03
    camera_noise: tuple[float, float] = (2e-3, 3e-3)
    """Noise of a measured pose: position [m], heading [rad]."""


IDEAL_SENSORS = Sensors(
    encoder_counts=1e7,
    current_noise=0.0,
    acceleration_noise=0.0,
    gyro_noise=0.0,
    heading_noise=0.0,
    heading_rate=1000.0,
    acceleration_bandwidth=1e9,
    gyro_bandwidth=1e9,
    camera_noise=(0.0, 0.0),
)
"""No noise, no bias, no lag except that of the wheel speed."""


@dataclass(frozen=True)
class ForeignRobot:
    """All true constants of one robot on one floor."""

    gear_law: GearLaw = "divides"
    # body, with what it carries
    mass: float = 15.837
    yaw_inertia: float = 0.55
    """About the centre of mass [kg.m²]."""
    com: tuple[float, float] = (0.0, 0.0)
    """Centre of mass in the body frame [m]."""
    com_height: float = 0.09
    twist_load: float = 0.0
    """Share of the weight that wheels 1 and 3 carry more than 2 and 4: no floor is flat."""
    floor_slope: tuple[float, float] = (0.0, 0.0)
    """Downhill slope of the floor along world x and y [rad]: gravity pushes with m g slope."""
    # wheels, motors and gears
    radius: Four = field(default_factory=lambda: four(NOMINAL_RADIUS))
    wheel_inertia: Four = field(default_factory=lambda: four(4.0e-4))
    bearing: Four = field(default_factory=lambda: four(1.4e-4))
    """Friction torque of the wheel bearings per load [m]: 0.01 × 6 mm, times the leverage of the overhang."""
    torque_constant: Four = field(default_factory=lambda: four(0.040))
    no_load_torque: Four = field(default_factory=lambda: four(5.0e-3))
    viscous: Four = field(default_factory=lambda: four(3.0e-6))
    rotor_inertia: Four = field(default_factory=lambda: four(1.5e-6))
    resistance: float = 5.0
    supply: float = 24.0
    current_limit: float = 1.5
    current_lag: float = 1.5e-3
    gear_ratio: float = 20.25
    efficiency: float = 0.81
    """E of the gear where the motor drives the floor."""
    back_efficiency: float = 0.6
    """E_b of the gear where the floor drives the motor; only the law 'own' uses it."""
    # floor
    grip: float = 0.45
    """Ceiling of traction over load."""
    slope: float = 2.5
    """Growth of traction over load with the slip velocity, below the ceiling [s/m]."""
    dry: float = 0.0
    """Part of traction over load that is there from a slip of some cm/s on."""
    drop: float = 0.1
    """Share of the ceiling that is lost at high slip velocity."""
    relaxation: float = 1.5e-3
    """Time in which traction follows the slip velocity [s]; from 3 ms on the yaw-rate loop rings."""
    roller_dry: float = 0.02
    roller_viscous: float = 0.02
    """Drag of the rollers along the axle over load: constant part, and per lateral speed [s/m]."""
    # controller
    speed_proportional: float = 0.296
    speed_integral: float = 3.325
    yaw_rate_gain: float = 6.0
    heading_gain: float = 4.4
    sensors: Sensors = field(default_factory=Sensors)

    def machine(self) -> Machine:
        """The constants as the compiled equations take them."""
        efficiency = self.efficiency
        back = {"multiplies": efficiency, "divides": 1.0 / efficiency, "own": 1.0 / self.back_efficiency}
        return Machine(
            *(self.mass, self.yaw_inertia, np.array(self.com), self.com_height, self.twist_load),
            np.array(self.floor_slope) * GRAVITY,
            *(np.array(self.radius), np.array(self.wheel_inertia), np.array(self.bearing)),
            *(np.array(self.torque_constant), np.array(self.no_load_torque), np.array(self.viscous)),
            *(np.array(self.rotor_inertia), self.resistance, self.supply),
            *(self.current_limit, self.current_lag),
            *(self.gear_ratio, efficiency, back[self.gear_law]),
            *(self.grip, self.slope, self.dry, self.drop, self.relaxation),
            *(self.roller_dry, self.roller_viscous),
        )


class Machine(NamedTuple):
    """Constants of the compiled equations; the names of `ForeignRobot`, and two that it derives."""

    mass: float
    yaw_inertia: float
    com: np.ndarray
    com_height: float
    twist_load: float
    gravity: np.ndarray
    """Pull of gravity along the floor, world frame [m/s²]."""
    radius: np.ndarray
    wheel_inertia: np.ndarray
    bearing: np.ndarray
    torque_constant: np.ndarray
    no_load_torque: np.ndarray
    viscous: np.ndarray
    rotor_inertia: np.ndarray
    resistance: float
    supply: float
    current_limit: float
    current_lag: float
    gear_ratio: float
    efficiency: float
    back_factor: float
    """Factor in place of E where the floor drives the motor: E, 1/E or 1/E_b."""
    grip: float
    slope: float
    dry: float
    drop: float
    relaxation: float
    roller_dry: float
    roller_viscous: float


@dataclass(frozen=True)
class Fault:
    """A wheel that slips or a motor that is weak, from `onset` to `end` [s].

    slip: the wheel's ceiling of traction is `amount` times the healthy one (0.1 … 0.3).
    motor: the motor's torque constant has lost the share `amount` (0.3 … 0.8).
    """

    kind: Literal["slip", "motor"]
    wheel: int
    """1 … 4."""
    onset: float
    amount: float
    end: float = float("inf")


def fault_table(faults: tuple[Fault, ...]) -> np.ndarray:
    """One row per fault: is it a motor's, index of the wheel, onset, end, factor that remains."""
    rows = [
        (f.kind == "motor", f.wheel - 1, f.onset, f.end, 1.0 - f.amount if f.kind == "motor" else f.amount)
        for f in faults
    ]
    return np.array(rows, dtype=float).reshape(-1, 5)


def draw_robot(
    seed: int,
    gear_law: GearLaw,
    *,
    torque_constant_spread: float = 0.0,
    payload: float = 1.5,
    doubled_bearings: int = 0,
) -> ForeignRobot:
    """A robot whose parts differ from the data sheets as those of a real one do.

    Args:
      seed: Of the draw.
      gear_law: What the gear does when the floor drives the wheel.
      torque_constant_spread: Half-width of the torque constants' spread over the wheels; 0 for four alike.
      payload: Largest mass that the robot carries unknown to anybody [kg].
      doubled_bearings: How many wheels have twice the bearing friction.
    """
    rng = np.random.default_rng([seed, 11])
    nominal = ForeignRobot()

    def spread(value: float, share: float) -> Four:
        a, b, c, d = value * (1.0 + rng.uniform(-share, share, 4))
        return (a, b, c, d)

    bearing = np.array(spread(nominal.bearing[0], 0.3))
    bearing[rng.permutation(4)[:doubled_bearings]] *= 2.0
    common = nominal.torque_constant[0] * (1.0 + rng.uniform(-0.02, 0.02))
    bare = replace(
        nominal,
        gear_law=gear_law,
        mass=nominal.mass + rng.uniform(-0.15, 0.15),
        yaw_inertia=nominal.yaw_inertia * rng.uniform(0.95, 1.05),
        twist_load=rng.uniform(-0.05, 0.05),
        floor_slope=(rng.normal(0.0, 1e-3), rng.normal(0.0, 1e-3)),
        radius=spread(NOMINAL_RADIUS, 0.003),
        bearing=(bearing[0], bearing[1], bearing[2], bearing[3]),
        torque_constant=spread(common, torque_constant_spread),
        no_load_torque=spread(nominal.no_load_torque[0], 0.15),
        viscous=spread(nominal.viscous[0], 0.5),
        rotor_inertia=spread(nominal.rotor_inertia[0], 0.05),
        current_lag=rng.uniform(1e-3, 2e-3),
        efficiency=nominal.efficiency * rng.uniform(0.98, 1.02),
        back_efficiency=rng.uniform(0.4, 0.9),
        grip=rng.uniform(0.35, 0.6),
        slope=rng.uniform(2.3, 2.7),
        dry=rng.uniform(0.0, 0.12),
        drop=rng.uniform(0.0, 0.2),
        relaxation=rng.uniform(1e-3, 2e-3),
        roller_dry=nominal.roller_dry * rng.uniform(0.8, 1.3),
        roller_viscous=nominal.roller_viscous * rng.uniform(0.8, 1.3),
        sensors=_drawn_sensors(rng),
    )
    return with_payload(bare, rng.uniform(0.0, payload), rng.uniform(0.0, 0.20), rng.uniform(-np.pi, np.pi))


def with_payload(robot: ForeignRobot, mass: float, distance: float, angle: float) -> ForeignRobot:
    """The robot with a mass on it, `distance` from its centre in the direction `angle`.

    Both inertias move to the common centre of mass (Steiner); the load itself is a disc of 6 cm radius.
    """
    total = robot.mass + mass
    place = distance * np.array([np.cos(angle), np.sin(angle)])
    com = (robot.mass * np.array(robot.com) + mass * place) / total
    inertia = robot.yaw_inertia + robot.mass * np.sum((np.array(robot.com) - com) ** 2)
    inertia += 0.5 * mass * 0.06**2 + mass * np.sum((place - com) ** 2)
    return replace(robot, mass=total, yaw_inertia=float(inertia), com=(float(com[0]), float(com[1])))


def _drawn_sensors(rng: np.random.Generator) -> Sensors:
    """Sensors with the biases that a real set would have."""
    a, b, c, d = rng.normal(0.0, 0.004, 4)
    return Sensors(
        current_offset=(a, b, c, d),
        acceleration_bias=(rng.normal(0.0, 0.01), rng.normal(0.0, 0.01)),
        acceleration_bandwidth=rng.uniform(50.0, 100.0),
        acceleration_tilt=(rng.normal(0.0, 1e-3), rng.normal(0.0, 1e-3)),
        gyro_bias=rng.normal(0.0, 0.001),
    )
