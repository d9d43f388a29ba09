"""Parts common to robot and rig: wheel, bearing, motor, contact, sensors."""

from __future__ import annotations

from dataclasses import dataclass

from omnimj.parameters.reading import positive, quantity

GRAVITY = 9.81
"""[m/s²]"""


@dataclass(frozen=True)
class Wheel:
    """A universal omni wheel with rows of passive barrel rollers."""

    radius: float = positive("m")
    """Rolling radius R."""
    inertia: float = positive("kg.m2")
    """About the axle, rollers included."""
    mass: float = positive("kg")
    """Rollers included."""
    rows: int = quantity("1", 1, 4)
    """Rows of rollers, staggered."""
    rollers_per_row: int = quantity("1", 3, 32)
    """Rollers in one row."""
    roller_radius: float = positive("m")
    """b: largest radius of a roller; its half length is √(R b)."""
    roller_mass: float = quantity("kg", 1e-6)
    """One roller; MuJoCo turns no body that has almost no inertia."""
    row_offset: float = quantity("m", 0.0)
    """Distance of the outer rows from the wheel's mid plane."""
    roller_dry: float = quantity("1", 0.0)
    """μ_R,dry of Eq. 3.32: dry bearing friction of the rollers, as a share of the normal force."""
    roller_viscous: float = quantity("s/m", 0.0)
    """μ_R,vis of Eq. 3.32."""
    roller_bristle_stiffness: float = positive("1/m")
    """Micro-slip stiffness of the rollers' bearing friction over the normal force (gives stiction)."""
    roller_bristle_damping: float = quantity("s/m", 0.0)
    """Micro-slip damping of the same."""
    roller_grip: float = quantity("1", 0.0)
    """Largest lateral force between roller and floor over the normal force."""
    roller_coast_time: float = positive("s")
    """Time in which a lifted roller loses 63 % of its spin."""
    rolling_resistance: float = quantity("1", 0.0)
    """μ_rol of Eq. 4.12: constant resistance over the normal force."""


@dataclass(frozen=True)
class Bearing:
    """Wheel bearings, Eqs. 4.37-4.38."""

    dry: float = quantity("1", 0.0)
    """μ_bearing,dry."""
    viscous: float = quantity("s/rad", 0.0)
    """μ_bearing,vis."""
    pitch_diameter: float = positive("m")
    """p_d."""
    spacing: float = positive("m")
    """a of Fig. 4.6, between the bearings."""
    overhang: float = quantity("m", 0.0)
    """b of Fig. 4.6, from the outer bearing to the wheel's mid plane."""


@dataclass(frozen=True)
class Motor:
    """DC motor with gear and an amplifier in current mode, Eqs. 3.79-3.85."""

    torque_constant: float = positive("N.m/A")
    """K_t, also the back-EMF constant in V.s/rad."""
    resistance: float = positive("ohm")
    """R."""
    rotor_inertia: float = positive("kg.m2")
    """J_r + J_g at the motor shaft."""
    no_load_torque: float = quantity("N.m", 0.0)
    """T_nl: dry friction at the motor shaft."""
    viscous: float = quantity("N.m.s/rad", 0.0)
    """Viscous friction at the motor shaft."""
    supply: float = positive("V")
    """Supply voltage of the amplifier."""
    current_limit: float = positive("A")
    """Largest current of the amplifier."""
    gear_ratio: float = positive("1")
    """G_r."""
    gear_efficiency: float = positive("1", high=1.0)
    """E; inverts when the wheel drives the motor."""
    current_loop: float = positive("s")
    """Time constant of the amplifier's current loop."""

    @property
    def reflected_inertia(self) -> float:
        """(J_r + J_g) E G_r², rotor inertia seen at the wheel, Eq. 3.82 [kg.m2]."""
        return self.rotor_inertia * self.gear_efficiency * self.gear_ratio**2


@dataclass(frozen=True)
class Contact:
    """Normal contact of a wheel on the floor: N = max(0, k d + c ḋ)."""

    stiffness: float = positive("N/m")
    """k."""
    damping: float = quantity("N.s/m", 0.0)
    """c."""


@dataclass(frozen=True)
class Sensors:
    """Constants of the sensor chain from the physical quantity to the controller's number."""

    sample_rate: float = quantity("Hz", 100.0, 10_000.0)
    """Rate of the data acquisition, of the controller and of the twin's steps: beyond 10 kHz traces outgrow
    the memory, below 100 Hz a wheel's contact is faster than a step."""
    encoder_counts: int = quantity("1", 4)
    """Positions per turn of the motor shaft."""
    encoder_noise: float = quantity("rad", 0.0)
    """RMS noise of the motor angle."""
    encoder_hysteresis: float = quantity("rad", 0.0)
    """Dead band of the motor angle at reversal."""
    carriage_encoder_counts: int = quantity("1", 4)
    """Positions per turn of the rig's measuring wheels, on the rail and on the gantry."""
    carriage_encoder_noise: float = quantity("rad", 0.0)
    """RMS noise of a measuring wheel's angle."""
    carriage_encoder_radius: float = positive("m")
    """Radius of a measuring wheel."""
    speed_filter: float = positive("s")
    """Time constant of the speed calculation."""
    speed_monitor_range: float = positive("rad/s")
    """Motor speed at full scale of the speed monitor (±)."""
    speed_monitor_bits: int = quantity("1", 4, 32)
    """Resolution of the speed monitor."""
    current_monitor_range: float = positive("A")
    """Current at full scale (±)."""
    current_monitor_bits: int = quantity("1", 4, 32)
    """Resolution of the current monitor."""
    current_noise: float = quantity("A", 0.0)
    """RMS."""
    accelerometer_range: float = positive("m/s2")
    """Full scale (±)."""
    accelerometer_noise: float = quantity("m/s2", 0.0)
    """RMS at the bandwidth."""
    accelerometer_bandwidth: float = positive("Hz")
    """First-order corner frequency."""
    accelerometer_bias: float = quantity("m/s2", 0.0)
    """Standard deviation of the constant offset, drawn once per run and axis."""
    gyro_range: float = positive("rad/s")
    """Full scale (±)."""
    gyro_noise: float = quantity("rad/s", 0.0)
    """RMS at the bandwidth."""
    gyro_bandwidth: float = positive("Hz")
    """First-order corner frequency."""
    gyro_bias: float = quantity("rad/s", 0.0)
    """Standard deviation of the constant offset, drawn once per run."""
    yaw_bits: int = quantity("1", 4, 32)
    """Resolution of the heading converter over one turn; it wraps."""
    yaw_update_rate: float = positive("Hz")
    """Rate at which the heading is renewed; held in between."""
    daq_input_bits: int = quantity("1", 4, 32)
    """Resolution of the analog inputs over each sensor's full range."""
