"""Closed forms of a wheel with ellipsoid rollers: outline, hand-over, room between rollers.

R is the wheel's radius, b a roller's largest radius, γ the angle between roller axis and axle (90° on an omni
wheel), L the long semi-axis of the ellipsoid, θ the turn of the wheel from where a roller is lowest.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.signals import Array

_SEPARATING = np.radians(np.linspace(-90.0, 90.0, 1801))  # directions tried between two neighbours


def half_length(radius: float, roller_radius: float, angle: float) -> float:
    """Long semi-axis L = √(b (R − b cos² γ))/sin γ of a roller with the wheel's curvature [m].

    With this L the cylinder of radius R has second-order contact with the roller: the hub height is
    constant up to the fourth power of θ. On an omni wheel L = √(R b).

    Args:
      radius: Wheel radius R [m].
      roller_radius: Largest roller radius b [m].
      angle: Angle γ between roller axis and axle [rad].
    """
    return math.sqrt(roller_radius * (radius - roller_radius * math.cos(angle) ** 2)) / math.sin(angle)


def hub_height(turn: Array | float, radius: float, roller_radius: float) -> Array:
    """Height h(θ) = (R − b) cos θ + √(b² + b (R − b) sin² θ) of the hub while one roller carries it [m].

    The support function of the ellipsoid of `half_length`; it does not depend on the roller angle.

    Args:
      turn: Turn θ from where the roller is lowest, any shape [rad].
      radius: Wheel radius R [m].
      roller_radius: Largest roller radius b [m].
    """
    around = radius - roller_radius
    return around * np.cos(turn) + np.sqrt(roller_radius**2 + roller_radius * around * np.sin(turn) ** 2)


def hand_over_drop(radius: float, roller_radius: float, count: int) -> float:
    """Drop R − h(π/N) of the hub where one roller hands over to the next [m].

    Args:
      radius: Wheel radius R [m].
      roller_radius: Largest roller radius b [m].
      count: Rollers N around the wheel, those of all rows.
    """
    return radius - float(hub_height(math.pi / count, radius, roller_radius))


def contact_reach(radius: float, roller_radius: float, angle: float, count: int) -> float:
    """Distance of the contact at hand-over from the middle of the roller [m].

    L² s/√(L² s² + b² (1 − s²)), s = sin(π/N) sin γ, along the axis. A roller must be at least this long to
    both sides.
    """
    long = half_length(radius, roller_radius, angle)
    s = math.sin(math.pi / count) * math.sin(angle)
    return long**2 * s / math.hypot(long * s, roller_radius * math.sqrt(1.0 - s * s))


def room_between(radius: float, roller_radius: float, angle: float, in_row: int, cut: float) -> float:
    """Distance between neighbouring rollers of a row [m]; negative if they overlap.

    Neighbours are images of each other by a half turn about the radial line between them, so that a
    separating direction can be sought at right angles to that line: max over ψ of
    2 ((R − b) sin φ cos ψ − s(ψ)), φ = π/n, with the support function s of the cut roller.

    Args:
      radius: Wheel radius R [m].
      roller_radius: Largest roller radius b [m].
      angle: Roller angle γ [rad].
      in_row: Rollers n of the row.
      cut: Half length of a roller, an ellipsoid cut at ±`cut` along its axis [m].
    """
    long, phi = half_length(radius, roller_radius, angle), math.pi / in_row
    along = math.sin(angle) * math.cos(phi) * np.cos(_SEPARATING) + math.cos(angle) * np.sin(_SEPARATING)
    across = np.sqrt(1.0 - along**2)
    at = long**2 * along / np.hypot(long * along, roller_radius * across)
    at = np.clip(at, -cut, cut)
    support = at * along + roller_radius * np.sqrt(1.0 - (at / long) ** 2) * across
    return float(np.max(2.0 * ((radius - roller_radius) * math.sin(phi) * np.cos(_SEPARATING) - support)))


def middle_projection(turn: float) -> float:
    """Factor 2 cos θ/(1 + cos θ), the inverse of the middle of the range of 1/cos θ between hand-overs at ±θ.

    A roller that is tilted by θ lies at atan(tan γ cos θ) to the axle as seen from above: its cotangent, by
    which a wheel drives sideways, is larger by 1/cos θ. Built with a cotangent smaller by this factor, the
    wheel has cotangents within cot γ (1 ± tan² θ/2), the narrowest range there is.
    """
    return 2.0 * math.cos(turn) / (1.0 + math.cos(turn))
