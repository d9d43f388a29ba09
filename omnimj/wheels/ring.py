"""Rollers around a wheel: what their number, radius and angle make of the outline, before any check."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from omnimj.wheels import outline

OMNI, MECANUM = 0.5 * math.pi, 0.25 * math.pi
"""Usual angles between roller axis and axle [rad]."""
_REACH_MARGIN = 1.1  # of the contact's reach at hand-over, by which a roller is longer at least
_ROOM = 0.01  # of the wheel's radius, that neighbouring rollers keep between them
_SHORTEST = 0.7  # of its thickness, the length of a roller that pins can hold
_WHOLE = 0.98  # of an ellipsoid's long semi-axis, the longest cut: pins need a flat end


@dataclass(frozen=True)
class RollerRing:
    """Rollers in rows around a wheel."""

    radius: float
    """Radius R of the wheel over the rollers [m]."""
    roller_radius: float
    """Largest radius b of a roller [m]."""
    rollers: int
    """Rollers in a row."""
    rows: int
    """Number of rows."""
    roller_angle: float
    """Angle γ between roller axis and axle, as seen from above between hand-overs [rad]."""

    @property
    def count(self) -> int:
        """Rollers N of all rows."""
        return self.rows * self.rollers

    @property
    def mounted_angle(self) -> float:
        """Angle γ_m between roller axis and axle as built [rad].

        cot γ_m = cot γ · 2 cos θ/(1 + cos θ) with θ = π/N.
        Between hand-overs a roller tilts by up to θ, and its angle as seen from above shrinks with it; built
        like this, the angles seen lie around γ, see `outline.middle_projection`.
        """
        if self.roller_angle == OMNI:
            return OMNI
        s, c = math.sin(self.roller_angle), math.cos(self.roller_angle)
        return math.atan2(s, c * outline.middle_projection(math.pi / self.count))

    @property
    def half_length(self) -> float:
        """Long semi-axis L of a roller's ellipsoid [m]."""
        return outline.half_length(self.radius, self.roller_radius, self.mounted_angle)

    @property
    def drop(self) -> float:
        """Drop of the hub at hand-over from roller to roller [m]."""
        return outline.hand_over_drop(self.radius, self.roller_radius, self.count)

    @property
    def reach(self) -> float:
        """Distance of the contact at hand-over from the roller's middle, along its axis [m]."""
        return outline.contact_reach(self.radius, self.roller_radius, self.mounted_angle, self.count)

    @property
    def shortest(self) -> float:
        """Half length with which a roller hands over to the next, and is not a mere disc [m]."""
        return max(_REACH_MARGIN * self.reach, _SHORTEST * self.roller_radius)

    def has_room(self, cut: float) -> bool:
        """True if rollers cut at ±`cut` [m] leave room to their neighbours in the row."""
        room = outline.room_between(self.radius, self.roller_radius, self.mounted_angle, self.rollers, cut)
        return room >= _ROOM * self.radius

    @property
    def fits(self) -> bool:
        """True if rollers that are long enough leave room to their neighbours."""
        return self.shortest <= _WHOLE * self.half_length and self.has_room(self.shortest)

    @cached_property
    def roller_half_length(self) -> float:
        """Half length c of a roller as built, the longest that leaves room to its neighbours [m]."""
        short, long = self.shortest, _WHOLE * self.half_length
        if self.has_room(long):
            return long
        for _ in range(30):
            middle = 0.5 * (short + long)
            short, long = (middle, long) if self.has_room(middle) else (short, middle)
        return short
