"""The linear axis' constants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.model_file import EffectValues, read_effects
from omnimj.parameters.reading import Provenance, positive, quantity, read_table, read_toml
from omnimj.resources import models_folder


@dataclass(frozen=True)
class AxisBody:
    """Carriage, guide, drive; motor and gear count as mass that moves along."""

    mass: float = positive("kg")
    """All that moves, motor and screw reflected."""
    drive_mass: float = quantity("kg", 0.0)
    """The share of it that sits before the play of the drive train."""
    coulomb: float = quantity("N", 0.0)
    """Dry friction."""
    viscous: float = quantity("N.s/m", 0.0)
    """Friction in proportion to speed."""
    force_constant: float = positive("N/A")
    """Force at the carriage over motor current."""
    force_limit: float = positive("N")
    """Largest force of the drive."""
    force_loop: float = quantity("s", 0.0, 0.1)
    """Time constant of the amplifier."""
    travel: float = positive("m")
    """To either side of the middle of the guide."""


@dataclass(frozen=True)
class AxisSensors:
    """Encoder, tachometer and force (or current) monitor."""

    sample_rate: float = quantity("Hz", 10.0, 100_000.0)
    """Rate of controller and log."""
    position_resolution: float = quantity("m", 0.0)
    """One count of the encoder."""
    position_noise: float = quantity("m", 0.0)
    """RMS before counting."""
    velocity_noise: float = quantity("m/s", 0.0)
    """RMS."""
    force_noise: float = quantity("N", 0.0)
    """RMS of the monitor."""
    force_resolution: float = quantity("N", 0.0)
    """One step of the monitor."""
    encoder_at_drive: int = quantity("1", 0, 1)
    """1: the encoder turns with the motor, 0: it sits on the carriage."""


@dataclass(frozen=True)
class AxisExtras:
    """Physics beyond an ordinary model of an axis, set by effects; model files have no table for it."""

    asymmetric_coulomb: float = 0.0
    """Dry friction moving forward − moving backward [N]."""
    asymmetric_viscous: float = 0.0
    """Viscous friction moving forward − moving backward [N.s/m]."""
    stribeck_force: float = 0.0
    """Extra dry friction at standstill [N]."""
    stribeck_velocity: float = 0.01
    """Speed at which 37 % of it are left [m/s]."""
    place_force: float = 0.0
    """Extra dry friction at the sticky place [N]."""
    place: float = 0.0
    """Position of that place [m]."""
    place_width: float = 0.03
    """Its standard deviation along the guide [m]."""
    offset: float = 0.0
    """Constant force [N]."""
    slope: float = 0.0
    """Inclination of the guide, upward [rad]."""
    cable_stiffness: float = 0.0
    """[N/m]"""
    cable_rest: float = 0.0
    """Position at which the cable does not pull [m]."""
    air: float = 0.0
    """Force over squared speed [N.s2/m2]."""
    force_scale: float = 1.0
    """True over declared force of the drive."""
    play: float = 0.0
    """Dead zone between drive and carriage [m]."""
    position_scale: float = 1.0
    """Reading over true value; so the next two."""
    velocity_scale: float = 1.0
    monitor_scale: float = 1.0
    monitor_bias: float = 0.0
    """Offset of the force monitor [N]."""
    position_delay: float = 0.0
    """By which a reading is late [s]; so the next two."""
    velocity_delay: float = 0.0
    force_delay: float = 0.0


@dataclass(frozen=True)
class Axis:
    """All constants of a linear axis."""

    plant: ClassVar[str] = "linear_axis"
    """Kind of machine, as model files name it."""
    wheel_count: ClassVar[int] = 1
    """The drive counts as one."""

    axis: AxisBody
    sensors: AxisSensors
    provenance: Mapping[str, Provenance]
    file: Path
    """The model file these constants were read from."""
    effects: EffectValues = field(default_factory=dict)
    """Effects on top of the model; the names and their parameters are those of `omnimj.effects`."""
    extras: AxisExtras = field(default_factory=AxisExtras)
    """Sum of all effects, from `omnimj.effects.apply_effects`; none in an axis that was just read."""


def read_axis(path: Path | None = None) -> Axis:
    """Read `axis.toml`, or a copy of it with changed values.

    Raises:
      InputError: A value is missing or breaks its rule; the message names file, key, value and rule.
    """
    path = models_folder() / "linear_axis" / "axis.toml" if path is None else path
    own = read_toml(path)
    if own.get("plant") != Axis.plant:
        raise InputError(
            f"{path}: plant", f"found {own.get('plant')!r}", f"this file must say {Axis.plant!r}"
        )
    known = ("plant", "axis", "sensors", "effects")
    for key in own:
        if key not in known:
            raise UnknownNameError(path, "table", key, known)
    provenance: dict[str, Provenance] = {}

    def table(kind, name):
        if name not in own:
            raise InputError(path, f"[{name}] is missing")
        return read_table(kind, own[name], lambda _: path, provenance, name)

    axis = Axis(
        axis=table(AxisBody, "axis"),
        sensors=table(AxisSensors, "sensors"),
        provenance=MappingProxyType(provenance),
        file=path,
        effects=read_effects(own, path, provenance),
    )
    if axis.axis.drive_mass >= axis.axis.mass:
        raise InputError(
            f"{path}: axis.drive_mass",
            f"found {axis.axis.drive_mass:g}",
            f"must be below axis.mass, {axis.axis.mass:g}",
        )
    return axis
