"""Missions of the foreign robot: the demanded twist at every millisecond.

A mission is a row of moves, each a trapezoid in time: up to a twist with a bounded acceleration, held, down
to rest; the corners are rounded by a moving mean. Twists are (v_x, v_y, ω) of the centre, in the world frame
or in the body's, as the whole plan says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TICK = 1e-3
"""Period of the controller [s]."""
ROUNDING = 0.08
"""Length of the moving mean [s]."""
TOP_SPEED = 1.0
"""Largest demanded speed of any wheel's rim [m/s]."""
ARM = 0.25
"""Distance of a wheel from the centre [m]."""


@dataclass(frozen=True)
class Plan:
    """Demanded twist at each tick, and the frame of its translation."""

    twists: np.ndarray
    """n × 3: v_x, v_y [m/s], ω [rad/s]."""
    in_world: bool = True
    hold_heading: bool = False
    """Is the heading held to the integral of ω, or only the yaw rate to ω?"""


def trapezoid(twist: tuple[float, float, float], acceleration: float, held: float) -> np.ndarray:
    """One move: ramp up, hold for `held` seconds, ramp down; a rim gains `acceleration` m/s² at most."""
    size = float(np.hypot(twist[0], twist[1])) + ARM * abs(twist[2])
    rise = max(round(size / acceleration / TICK), 1)
    up = np.linspace(0.0, 1.0, rise, endpoint=False)
    share = np.concatenate([up, np.ones(round(held / TICK)), 1.0 - up, np.zeros(round(ROUNDING / TICK))])
    return share[:, None] * np.array(twist)


def rest(duration: float) -> np.ndarray:
    """Standing still."""
    return np.zeros((round(duration / TICK), 3))


def rounded(twists: np.ndarray) -> np.ndarray:
    """The corners of the trapezoids rounded: a mean over the last `ROUNDING` seconds."""
    width = round(ROUNDING / TICK)
    sums = np.cumsum(np.vstack([np.zeros((width, 3)), twists]), axis=0)
    means = sums.copy()
    means[width:] -= sums[:-width]
    return means[width:] / width


def straight(speed: float, direction: float, acceleration: float, held: float, duration: float) -> Plan:
    """Rest for half a second, one move in one direction, rest until `duration`."""
    move = trapezoid((speed * np.cos(direction), speed * np.sin(direction), 0.0), acceleration, held)
    twists = np.vstack([rest(0.5), move, rest(max(duration, 0.0))])[: round(duration / TICK)]
    return Plan(rounded(twists))


def random_mission(seed: int, duration: float) -> Plan:
    """Translations, squares, turns, circles and rests in random order, soft or hard, slow or fast.

    One mission in four asks in the frame of the body, the others in that of the world; half hold the heading.
    """
    rng = np.random.default_rng([seed, 23])
    in_world, hold_heading = bool(rng.uniform() < 0.75), bool(rng.uniform() < 0.5)
    moves, total = [rest(1.0)], 1.0
    while total < duration:
        move = _MOVES[rng.choice(list(_MOVES), p=_SHARES)](rng)
        pause = rest(rng.uniform(0.3, 1.5))
        moves += [move, pause]
        total += TICK * (len(move) + len(pause))
    twists = np.vstack(moves)[: round(duration / TICK)]
    # the log may end in the middle of a move, as real ones do
    return Plan(rounded(twists), in_world, hold_heading)


def _pace(rng: np.random.Generator) -> tuple[float, float]:
    """Speed [m/s] and acceleration [m/s²] of a move."""
    return rng.uniform(0.2, 0.9), rng.uniform(0.2, 1.0)


def _translation(rng: np.random.Generator) -> np.ndarray:
    (speed, acceleration), angle = _pace(rng), rng.uniform(-np.pi, np.pi)
    return trapezoid((speed * np.cos(angle), speed * np.sin(angle), 0.0), acceleration, rng.uniform(0.3, 2.5))


def _square(rng: np.random.Generator) -> np.ndarray:
    """Four sides, one after the other, with a stop in each corner."""
    (speed, acceleration), angle, held = _pace(rng), rng.uniform(-np.pi, np.pi), rng.uniform(0.3, 1.2)
    way = rng.choice([-1.0, 1.0]) * np.pi / 2
    sides = [(speed * np.cos(a), speed * np.sin(a), 0.0) for a in angle + way * np.arange(4)]
    return np.vstack([trapezoid(side, acceleration, held) for side in sides])


def _turn(rng: np.random.Generator) -> np.ndarray:
    rate = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.8)
    return trapezoid((0.0, 0.0, rate), rng.uniform(0.2, 0.8), rng.uniform(0.3, 2.0))


def _circle(rng: np.random.Generator) -> np.ndarray:
    """Round a circle with the heading held: the direction of motion turns, the acceleration stays bounded."""
    (speed, acceleration), angle = _pace(rng), rng.uniform(-np.pi, np.pi)
    around = rng.choice([-1.0, 1.0]) * min(acceleration / speed, 2.0)
    share = trapezoid((speed, 0.0, 0.0), acceleration, min(2 * np.pi / abs(around), 6.0))[:, 0]
    turned = angle + around * TICK * np.arange(len(share))
    return np.column_stack([share * np.cos(turned), share * np.sin(turned), np.zeros(len(share))])


def _sweep(rng: np.random.Generator) -> np.ndarray:
    """Translation and turning at once."""
    (speed, acceleration), angle = _pace(rng), rng.uniform(-np.pi, np.pi)
    rate = rng.choice([-1.0, 1.0]) * rng.uniform(0.3, min(1.2, max((TOP_SPEED - speed) / ARM, 0.3)))
    twist = (speed * np.cos(angle), speed * np.sin(angle), rate)
    return trapezoid(twist, acceleration, rng.uniform(0.5, 2.0))


_MOVES = {
    "translation": _translation,
    "square": _square,
    "turn": _turn,
    "circle": _circle,
    "sweep": _sweep,
}
_SHARES = [0.4, 0.15, 0.15, 0.15, 0.15]
