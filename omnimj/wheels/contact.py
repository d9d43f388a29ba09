"""Contact of rollers with the floor in MuJoCo's own solver, and the step it is made for."""

from __future__ import annotations

from dataclasses import dataclass, fields

from omnimj.errors import InputError

_RANGES = {
    "time_constant": (1e-3, 0.1),
    "impedance": (0.5, 0.999),
    "friction": (0.05, 5.0),
    "timestep": (1e-4, 0.01),
}


@dataclass(frozen=True)
class SolverContact:
    """Contact parameters of the rollers, chosen by the table of `omnimj bench --wheels`.

    The softer the contact, the deeper the rollers sink in and the slower the robot rolls; the harder it is,
    the fewer wheels carry the robot at a time. Sliding friction is all that a roller transmits (condim 3):
    torsional friction would hold a wheel against turning on the spot. The elliptic cone grips alike in all
    directions, and needs neither a larger `impratio` nor noslip iterations here.

    Raises:
      InputError: A number is out of range.
    """

    time_constant: float = 0.004
    """Time constant of the contact, first number of `solref` [s]; MuJoCo needs twice the step."""
    impedance: float = 0.97
    """Impedance, first two numbers of `solimp`."""
    friction: float = 0.8
    """Friction coefficient between roller and floor."""
    timestep: float = 0.001
    """Step [s]."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value, (low, high) = getattr(self, field.name), _RANGES[field.name]
            if not low <= value <= high:
                rule = f"must be at least {low:g} and at most {high:g}"
                raise InputError(f"contact: {field.name}", f"found {value:g}", rule)
        if self.time_constant < 2.0 * self.timestep:
            rule = f"must be at most {0.5 * self.time_constant:g} s, half the contact's time constant"
            raise InputError("contact: timestep", f"found {self.timestep:g} s", rule)
