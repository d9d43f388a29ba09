"""Changes that effects make to the joints, actuators, bodies and channels of a machine with an MJCF file.

What MJCF can express is a change of a quantity of a part (`damping` of a joint); the rest are terms that the
replay adds to the force balance of a joint or to the readings of a channel.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from omnimj.effects.effect import ChannelChanges, EffectParameter, Hook, Selector, Values
from omnimj.errors import InputError

JOINT, ACTUATOR, BODY, CHANNEL = "joint", "actuator", "body", "channel"
"""Kinds of parts; also the names of the selectors of their effects."""
ON_JOINT, ON_ACTUATOR, ON_BODY, ON_CHANNEL = (Selector(kind, ()) for kind in (JOINT, ACTUATOR, BODY, CHANNEL))

_ON_HINGE: Mapping[str, str] = MappingProxyType(
    {
        "N": "N.m",
        "N.s/m": "N.m.s/rad",
        "N.s2/m2": "N.m.s2/rad2",
        "N/m": "N.m/rad",
        "m/N": "rad/(N.m)",
        "1/N": "1/(N.m)",
        "m": "rad",
        "m/s": "rad/s",
        "kg": "kg.m2",
    }
)


def joint_unit(unit: str, is_hinge: bool) -> str:
    """Unit of a joint's quantity, declared for a slide joint, on a hinge: `N` → `N.m`."""
    return _ON_HINGE.get(unit, unit) if is_hinge else unit


class Payload(NamedTuple):
    """Point mass on a body."""

    body: str
    mass: float
    """[kg]"""
    distance: float
    """From the body's joint through its centre of mass [m]."""


Part = tuple[str, str, str]
"""Kind of part, its name, and a quantity of it."""


class PartChanges(ChannelChanges):
    """Collector of the changes that the effects of an MJCF machine make."""

    def __init__(self, values: Mapping[Part, float]) -> None:
        super().__init__()
        self.values = values
        """Values of the machine's quantities before any change."""
        self.added: dict[Part, float] = {}
        """Amounts added to quantities that MJCF has."""
        self.scales: dict[Part, float] = {}
        """Factors of quantities that MJCF has."""
        self.limits: dict[str, float] = {}
        """Actuator → largest force [N or N.m]."""
        self.terms: dict[Part, float] = {}
        """Terms that MJCF cannot express."""
        self.payloads: list[Payload] = []
        self.tilt: dict[str, float] = {}
        """World axis, `x` or `y` → angle by which gravity is turned about it [rad]."""

    def add(self, kind: str, part: str, quantity: str, amount: float) -> None:
        """Add to a quantity of a part."""
        key = (kind, part, quantity)
        self.added[key] = self.added.get(key, 0.0) + amount

    def scale(self, kind: str, part: str, quantity: str, factor: float) -> None:
        """Multiply a quantity of a part."""
        key = (kind, part, quantity)
        self.scales[key] = self.scales.get(key, 1.0) * factor

    def add_term(self, kind: str, part: str, term: str, amount: float) -> None:
        """Add to a term of a part."""
        key = (kind, part, term)
        self.terms[key] = self.terms.get(key, 0.0) + amount

    def set_terms(self, kind: str, part: str, amplitude: str, **terms: float) -> None:
        """Set an amplitude and its shape.

        Raises:
          InputError: A second instance of the effect on this part.
        """
        if terms[amplitude] == 0.0:
            return
        if self.terms.get((kind, part, amplitude)):
            raise InputError(f"{kind} {part!r}", "found this effect twice", "it can act once on a part")
        for term, value in terms.items():
            self.terms[kind, part, term] = value


def adds(kind: str, quantity: str, parameter: str) -> Hook:
    """Hook that adds a parameter of an effect to a quantity of the selected part."""

    def hook(changes: PartChanges, values: Values) -> None:
        changes.add(kind, str(values[kind]), quantity, values[parameter])

    return hook


def scales(kind: str, quantity: str) -> Hook:
    """Hook that multiplies a quantity of the selected part by the parameter `scale`."""

    def hook(changes: PartChanges, values: Values) -> None:
        changes.scale(kind, str(values[kind]), quantity, values["scale"])

    return hook


def adds_term(kind: str, term: str, parameter: str) -> Hook:
    """Hook that adds a parameter of an effect to a term of the selected part."""

    def hook(changes: PartChanges, values: Values) -> None:
        changes.add_term(kind, str(values[kind]), term, values[parameter])

    return hook


def sets_terms(kind: str, amplitude: str, **parameters: str) -> Hook:
    """Hook that sets an amplitude and the terms of its shape: term → parameter."""

    def hook(changes: PartChanges, values: Values) -> None:
        terms = {term: values[parameter] for term, parameter in parameters.items()}
        changes.set_terms(kind, str(values[kind]), amplitude, **terms)

    return hook


def scale_parameter(typical: float, low: float = 0.2, high: float = 2.0) -> tuple[EffectParameter, ...]:
    """The parameter of an effect that multiplies something."""
    return (EffectParameter("scale", "1", low, high, typical, 1.0),)
