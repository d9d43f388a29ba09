"""What recovery feeds back with, and how far it may go."""

from __future__ import annotations

from dataclasses import dataclass

from omnimj.parameters.reading import positive


@dataclass(frozen=True)
class RecoveryGains:
    """Gains of recovery; `omnimj tune` changes them together with those of cascade and observer."""

    place_proportional: float = positive("1/s", 100.0, default=3.0)
    """K with which a place error is driven back."""
    place_speed: float = positive("m/s", 2.0, default=0.2)
    """Largest speed for that."""
    slip_cap: float = positive("m/s", 5.0, default=0.2)
    """By how much a slipping wheel may be faster or slower than the floor below it. Wheels follow speeds that
    fit together and do not run away; a tighter bound takes traction from every floor that gives more the more
    a wheel slips: with 0.05 the heading strays a fifth further than with 0.2, and the place 6 % instead of
    0."""
    grip_share: float = positive("1", 1.0, default=0.5)
    """Of the grip of a floor that gives way under all wheels, what the plan may use; the rest holds the robot
    on it."""
