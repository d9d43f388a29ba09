"""Parts common to robot and rig: wheel, bearing, motor, contact, sensors."""

from __future__ import annotations

from dataclasses import dataclass

from omnimj.parameters.reading import positive, quantity

GRAVITY = 9.81
"""Gravitational acceleration [m/s²]."""


@dataclass(frozen=True)
class Wheel:
    """Universal omni wheel with rows of passive barrel rollers."""

    radius: float = positive("m")
    """Rolling radius R."""
    inertia: float = positive("kg.m2")
    """Inertia about the axle, including the rollers."""
    mass: float = positive("kg")
    """Mass, including the rollers."""
    rows: int = quantity("1", 1, 4)
    """Number of staggered rows of rollers."""
    rollers_per_row: int = quantity("1", 3, 32)
    """Number of rollers in one row."""
    roller_radius: float = positive("m")
    """Largest radius b of a roller; its half length is √(R b)."""
    roller_mass: float = quantity("kg", 1e-6)
    """Mass of one roller; above zero, since MuJoCo rejects bodies with almost no inertia."""
    row_offset: float = quantity("m", 0.0)
    """Distance of the outer rows from the wheel's mid plane."""
    roller_dry: float = quantity("1", 0.0)
    """Dry bearing friction μ_R,dry of the rollers over the normal force, Eq. 3.32."""
    roller_viscous: float = quantity("s/m", 0.0)
    """Viscous bearing friction μ_R,vis of the rollers over the normal force, Eq. 3.32."""
    roller_bristle_stiffness: float = positive("1/m")
    """Bristle stiffness of the rollers' bearing friction over the normal force, which models stiction."""
    roller_bristle_damping: float = quantity("s/m", 0.0)
    """Bristle damping of the rollers' bearing friction over the normal force."""
    roller_grip: float = quantity("1", 0.0)
    """Largest lateral force between roller and floor over the normal force."""
    roller_coast_time: float = positive("s")
    """Time in which a lifted roller loses 63 % of its spin."""
    rolling_resistance: float = quantity("1", 0.0)
    """Rolling resistance μ_rol over the normal force, Eq. 4.12."""


@dataclass(frozen=True)
class Bearing:
    """Wheel bearings, Eqs. 4.37-4.38."""

    dry: float = quantity("1", 0.0)
    """Dry friction coefficient μ_bearing,dry."""
    viscous: float = quantity("s/rad", 0.0)
    """Viscous friction coefficient μ_bearing,vis."""
    pitch_diameter: float = positive("m")
    """Pitch diameter p_d."""
    spacing: float = positive("m")
    """Distance a between the bearings, Fig. 4.6."""
    overhang: float = quantity("m", 0.0)
    """Distance b from the outer bearing to the mid plane of the wheel, Fig. 4.6."""


@dataclass(frozen=True)
class Motor:
    """DC motor with gear and an amplifier in current mode, Eqs. 3.79-3.85."""

    torque_constant: float = positive("N.m/A")
    """Torque constant K_t, also the back-EMF constant in V.s/rad."""
    resistance: float = positive("ohm")
    """Winding resistance R."""
    rotor_inertia: float = positive("kg.m2")
    """Inertia J_r + J_g of rotor and gear at the motor shaft."""
    no_load_torque: float = quantity("N.m", 0.0)
    """No-load torque T_nl: dry friction at the motor shaft."""
    viscous: float = quantity("N.m.s/rad", 0.0)
    """Viscous friction at the motor shaft."""
    supply: float = positive("V")
    """Supply voltage of the amplifier."""
    current_limit: float = positive("A")
    """Largest current of the amplifier."""
    gear_ratio: float = positive("1")
    """Gear ratio G_r."""
    gear_efficiency: float = positive("1", high=1.0)
    """Gear efficiency E while the motor drives the wheel: wheel torque E G_r T of a shaft torque T."""
    current_loop: float = positive("s")
    """Time constant of the amplifier's current loop."""
    back_driving_efficiency: float = quantity("1", 0.0, 2.0, default=0.0)
    """Efficiency E_b while the wheel drives the motor: wheel torque G_r T/E_b; 0: that of `gear_efficiency`.
    A gear whose torque is E G_r T in both directions has E_b = 1/E."""

    @property
    def driven_gain(self) -> float:
        """Wheel torque over G_r T while the wheel drives the motor, 1/E_b."""
        return 1.0 / (self.back_driving_efficiency or self.gear_efficiency)

    @property
    def reflected_inertia(self) -> float:
        """Rotor inertia reflected to the wheel, (J_r + J_g) E G_r², Eq. 3.82 [kg.m2]."""
        return self.rotor_inertia * self.gear_efficiency * self.gear_ratio**2


@dataclass(frozen=True)
class Contact:
    """Normal contact of a wheel on the floor: N = max(0, k d + c ḋ)."""

    stiffness: float = positive("N/m")
    """Stiffness k."""
    damping: float = quantity("N.s/m", 0.0)
    """Damping c."""


@dataclass(frozen=True)
class Sensors:
    """Constants of the sensor chains from the physical quantities to the controller's readings."""

    sample_rate: float = quantity("Hz", 100.0, 10_000.0)
    """Rate of data acquisition, controller and steps of the twin. Above 10 kHz traces exceed the memory;
    below 100 Hz the dynamics of the contact are faster than a step."""
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
    """Current at full scale of the current monitor (±)."""
    current_monitor_bits: int = quantity("1", 4, 32)
    """Resolution of the current monitor."""
    current_noise: float = quantity("A", 0.0)
    """RMS noise of the current monitor."""
    accelerometer_range: float = positive("m/s2")
    """Full scale of the sensor (±)."""
    accelerometer_noise: float = quantity("m/s2", 0.0)
    """RMS noise within the bandwidth."""
    accelerometer_bandwidth: float = positive("Hz")
    """Corner frequency of the first-order low-pass behaviour."""
    accelerometer_bias: float = quantity("m/s2", 0.0)
    """Standard deviation of the constant offset, drawn once per run and axis."""
    gyro_range: float = positive("rad/s")
    """Full scale of the sensor (±)."""
    gyro_noise: float = quantity("rad/s", 0.0)
    """RMS noise within the bandwidth."""
    gyro_bandwidth: float = positive("Hz")
    """Corner frequency of the first-order low-pass behaviour."""
    gyro_bias: float = quantity("rad/s", 0.0)
    """Standard deviation of the constant offset, drawn once per run."""
    yaw_bits: int = quantity("1", 4, 32)
    """Resolution of the heading converter over one turn, after which it wraps."""
    yaw_update_rate: float = positive("Hz")
    """Rate at which the heading is updated; it is held in between."""
    daq_input_bits: int = quantity("1", 4, 32)
    """Resolution of the analog inputs over each sensor's full range."""
