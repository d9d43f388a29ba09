"""Constants of the linear axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.mjcf_model import read_model_tree
from omnimj.parameters.model_file import EffectValues, read_effects
from omnimj.parameters.reading import Provenance, positive, quantity, read_table
from omnimj.resources import models_folder


@dataclass(frozen=True)
class AxisBody:
    """Carriage, guide and drive; motor and gear are included as equivalent moving mass."""

    mass: float = positive("kg")
    """Total moving mass, including the reflected inertia of motor and screw."""
    drive_mass: float = quantity("kg", 0.0)
    """Part of that mass on the motor side of the play in the drive train."""
    coulomb: float = quantity("N", 0.0)
    """Coulomb friction."""
    viscous: float = quantity("N.s/m", 0.0)
    """Viscous friction."""
    force_constant: float = positive("N/A")
    """Force at the carriage per motor current."""
    force_limit: float = positive("N")
    """Largest force of the drive."""
    force_loop: float = quantity("s", 0.0, 0.1)
    """Time constant of the amplifier's force (current) loop."""
    travel: float = positive("m")
    """Travel to either side of the middle of the guide."""


@dataclass(frozen=True)
class AxisSensors:
    """Encoder, tachometer and force (or current) monitor."""

    sample_rate: float = quantity("Hz", 10.0, 100_000.0)
    """Rate of controller and log."""
    position_resolution: float = quantity("m", 0.0)
    """Distance of one encoder count."""
    position_noise: float = quantity("m", 0.0)
    """RMS noise of the position, before rounding to counts."""
    velocity_noise: float = quantity("m/s", 0.0)
    """RMS noise of the tachometer."""
    force_noise: float = quantity("N", 0.0)
    """RMS noise of the force monitor."""
    force_resolution: float = quantity("N", 0.0)
    """Resolution of the force monitor."""
    encoder_at_drive: int = quantity("1", 0, 1)
    """1: the encoder is on the motor, 0: it is on the carriage."""


@dataclass(frozen=True)
class Axis:
    """All constants of a linear axis."""

    plant: ClassVar[str] = "linear_axis"
    """Kind of machine, as named in model files."""
    wheel_count: ClassVar[int] = 1
    """Number of driven elements; the drive counts as one wheel."""

    axis: AxisBody
    sensors: AxisSensors
    provenance: Mapping[str, Provenance]
    file: Path
    """Model file from which these constants were read."""
    effects: EffectValues = field(default_factory=dict)
    """Effects added to the model, with names and parameters as in `omnimj.effects`."""


def read_axis(path: Path | None = None) -> Axis:
    """Read `axis.toml`, or a copy of it with changed values.

    Raises:
      InputError: A value is missing or breaks its rule; the message names file, key, value and rule.
    """
    path = models_folder() / "linear_axis" / "axis.toml" if path is None else path
    own = read_model_tree(path)
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
