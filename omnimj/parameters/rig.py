"""Constants of the quarter test rig."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

from omnimj.display import Displayed
from omnimj.errors import InputError
from omnimj.parameters.model_file import EffectValues, model_path, read_effects, read_model_file
from omnimj.parameters.parts import Bearing, Contact, Motor, Sensors, Wheel
from omnimj.parameters.reading import Provenance, positive, quantity


@dataclass(frozen=True)
class RigBody:
    """Gantry, rail and quarter body, section 4.1; symbols as in Figs. 4.3-4.6."""

    masses: tuple[float, ...] = positive("kg")
    """Masses m_T to which the quarter body can be loaded; the first is the default."""
    rail_friction: float = quantity("N", 0.0)
    """Constant friction of the linear guide, as measured."""
    rail_length: float = positive("m")
    """Usable travel along the rail."""
    lateral_travel: float = positive("m")
    """Usable travel of the gantry."""
    rail_height: float = positive("m")
    """Height c of the rail above the floor."""
    rail_half_width: float = positive("m")
    """Distance h of either rail wheel from the rail."""
    contact_offset: float = quantity("m")
    """Lateral offset d of the wheel contact from the rail."""
    com_offset: float = quantity("m")
    """Lateral offset e of the centre of mass from the rail."""
    rail_dry: float = quantity("1", 0.0)
    """Dry friction coefficient μ_D,dry of the rail wheels."""
    rail_viscous: float = quantity("s/m", 0.0)
    """Viscous friction coefficient μ_D,vis of the rail wheels."""
    rail_load_time: float = positive("s")
    """Time constant with which lateral force reaches the rail; the inertia of the tilting body absorbs faster
    changes."""
    com_height: float = positive("m")
    """Height of the quarter body's centre of mass."""
    tilt_inertia: float = positive("kg.m2")
    """Inertia of the quarter body about the rail direction through its centre of mass."""
    tilt_limit: float = positive("rad")
    """Largest tilt (±) within the clearance of the rail wheels."""
    gantry_mass: float = positive("kg")
    """Mass of the gantry (link 11)."""
    gantry_gain: float = positive("N.s/m")
    """Gain of the speed loop of the gantry drive."""
    start_position: float = quantity("m", 0.0)
    """Initial position of the wheel from the end of the rail."""


@dataclass(frozen=True)
class Rig(Displayed):
    """All constants of the quarter test rig."""

    plant: ClassVar[str] = "quarter_rig"
    """Kind of machine, as named in model files."""
    wheel_count: ClassVar[int] = 1
    roller_angles: ClassVar[tuple[float, ...]] = (0.5 * math.pi,)
    """Roller angle γ of each wheel [rad]."""

    wheel: Wheel
    bearing: Bearing
    motor: Motor
    contact: Contact
    sensors: Sensors
    rig: RigBody
    provenance: Mapping[str, Provenance]
    file: Path
    """Model file from which these constants were read."""
    effects: EffectValues = field(default_factory=dict)
    """Effects added to the model, with names and parameters as in `omnimj.effects`."""


def read_rig(path: Path | str | None = None) -> Rig:
    """Read `rig.toml`, or a copy of it with changed values.

    Args:
      path: Model file, or the name of a shipped one; the shipped rig when None.

    Raises:
      InputError: A value is missing or breaks its rule; the message names file, key, value and rule.
    """
    path = model_path(path, "quarter_rig/rig.toml")
    file = read_model_file(path, Rig.plant, ("rig", "effects"))
    provenance: dict[str, Provenance] = {}
    rig = Rig(
        **file.shared_parts(provenance),
        rig=file.table(RigBody, "rig", provenance),
        provenance=MappingProxyType(provenance),
        file=path,
        effects=read_effects(file.own, path, provenance),
    )
    _require_consistent(rig)
    return rig


def _require_consistent(rig: Rig) -> None:
    """Check rules that involve several numbers."""
    body = rig.rig
    if rig.wheel.mass >= min(body.masses):
        raise InputError(
            f"{rig.file}: rig.masses",
            f"found {min(body.masses):g}",
            f"must be above wheel.mass, {rig.wheel.mass:g}",
        )
    if body.start_position >= body.rail_length:
        raise InputError(
            f"{rig.file}: rig.start_position",
            f"found {body.start_position:g}",
            f"must be below rig.rail_length, {body.rail_length:g}",
        )
