"""Contact of rollers with the floor in MuJoCo's own solver, and the step it is made for."""

from __future__ import annotations

from dataclasses import dataclass, fields

from omnimj.errors import InputError

_RANGES = {
    "time_constant": (2e-4, 0.1),
    "impedance": (0.5, 0.999),
    "friction": (0.05, 5.0),
    "timestep": (1e-4, 0.01),
}
_USUAL_RADIUS = 0.05  # [m] of the wheels for which the defaults were chosen


@dataclass(frozen=True)
class SolverContact:
    """Contact parameters of the rollers; the defaults, for wheels of 50 mm, by `omnimj bench --wheels`.

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


def solver_contact(radius: float, friction: float = 0.8, timestep: float = 0.001) -> SolverContact:
    """Return the contact for wheels of a radius.

    Rollers sink in by about (1 − impedance) g τ², whatever their load; on wheels below 50 mm both factors
    shrink with the radius, as far as the step allows.

    Args:
      radius: Radius of the wheels [m].
      friction: Friction coefficient between roller and floor.
      timestep: Step [s].

    Raises:
      InputError: As in `SolverContact`.
    """
    scale = min(1.0, radius / _USUAL_RADIUS)
    usual = SolverContact()
    time_constant = max(round(scale * usual.time_constant, 7), min(2.0 * timestep, usual.time_constant))
    impedance = round(1.0 - scale * (1.0 - usual.impedance), 4)
    return SolverContact(time_constant, min(impedance, _RANGES["impedance"][1]), friction, timestep)
