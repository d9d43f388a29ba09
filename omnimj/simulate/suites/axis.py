"""Test plan of the linear axis: closed-loop moves that excite its effects."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.parameters.axis import Axis
from omnimj.plant.axis import drive_axis, servo
from omnimj.signals import Array
from omnimj.simulate.suites.suite import Condition, RunConfig

_ROUND = 0.03  # [s] over which an acceleration builds up, as by the jerk limit of a servo drive
_REST = 0.15  # [s] at either end of a stroke
_STILL = 0.5  # [s] of rest before and after a sweep, or a quarter of it

PAYLOAD_SHARE = 0.1
"""Added mass of one move relative to the mass of the axis."""
DURATION = 12.0
"""Duration of one run [s]."""
_MEASURED = ("time", "force", "position")


def highest_speed(axis: Axis) -> float:
    """Highest speed of the test plan, limited by travel and force of the axis [m/s]."""
    body = axis.axis
    return min(1.4 * body.travel, np.sqrt(highest_acceleration(axis) * body.travel))


def highest_acceleration(axis: Axis) -> float:
    """Highest acceleration of the test plan, which takes a quarter of the force limit [m/s²]."""
    return 0.25 * axis.axis.force_limit / axis.axis.mass


def _from_speed(start: float, speed: Array, period: float) -> Array:
    """Position [m], speed [m/s] and acceleration [m/s²] from a speed that is smoothed here, shape (n, 3)."""
    width = max(round(_ROUND / period), 1)
    smooth = np.convolve(np.concatenate([np.zeros(width), speed]), np.full(width, 1.0 / width))
    smooth = smooth[width : width + len(speed)]
    moved = np.concatenate([[0.0], np.cumsum(0.5 * (smooth[1:] + smooth[:-1]))]) * period
    return np.stack([start + moved, smooth, np.gradient(smooth, period)], axis=1)


def _stroke(distance: float, speed: float, acceleration: float, period: float) -> Array:
    """Speeds of one stroke followed by a rest, shape (k,) [m/s]."""
    way = abs(distance)
    top = min(speed, np.sqrt(way * acceleration))
    rise, cruise = top / acceleration, way / top - top / acceleration
    t = np.arange(0.0, 2.0 * rise + cruise + _REST, period)
    shape = np.minimum(np.minimum(t * acceleration, top), (2.0 * rise + cruise - t) * acceleration)
    found = np.maximum(shape, 0.0)
    # samples miss the corners of the profile: scale it to the exact distance
    return np.sign(distance) * found * way / max(found.sum() * period, 1e-12)


def strokes(
    amplitude: float, speeds: Sequence[float], acceleration: float, duration: float, period: float
) -> Array:
    """Back-and-forth strokes between ± amplitude, each there and back at the next of the speeds.

    Args:
      amplitude: Half the stroke [m].
      speeds: Cruising speeds, repeated cyclically [m/s].
      acceleration: Magnitude of acceleration and deceleration [m/s²].
      duration: Duration of the path [s].
      period: Sample period [s].

    Returns:
      Position [m], speed [m/s] and acceleration [m/s²], shape (n, 3).
    """
    parts, place = [np.zeros(round(_REST / period))], -amplitude
    length, total = len(parts[0]), round(duration / period)
    for speed in itertools.cycle(np.repeat(speeds, 2)):
        if length >= total:
            break
        parts.append(_stroke(-2.0 * place, speed, acceleration, period))
        place, length = -place, length + len(parts[-1])
    return _from_speed(-amplitude, np.concatenate(parts)[:total], period)


def sweep(amplitude: float, slow: float, fast: float, top: float, duration: float, period: float) -> Array:
    """Sine sweep of rising frequency, its amplitude limited so that the speed stays below `top`.

    Args:
      amplitude: Amplitude at low frequency [m].
      slow: First frequency [Hz].
      fast: Last frequency [Hz].
      top: Largest speed [m/s].
      duration: Duration of the path [s].
      period: Sample period [s].

    Returns:
      Position [m], speed [m/s] and acceleration [m/s²], shape (n, 3).
    """
    t = np.arange(round(duration / period)) * period
    still = min(_STILL, 0.25 * duration)
    length = duration - 2.0 * still
    at = np.clip((t - still) / length, 0.0, 1.0)
    growth = np.log(fast / slow)
    frequency = slow * np.exp(growth * at)
    phase = 2.0 * np.pi * slow * length / growth * np.expm1(growth * at)
    speed = np.minimum(2.0 * np.pi * frequency * amplitude, top) * np.sin(phase)
    fade = np.clip((duration - still - t) / still, 0.0, 1.0) * np.clip((t - still) / 0.2, 0.0, 1.0)
    return _from_speed(-0.5 * amplitude, speed * fade, period)


def wander(amplitude: float, top: float, duration: float, period: float) -> Array:
    """Sum of slow sines without a common period.

    Args:
      amplitude: Largest distance from the middle [m].
      top: Largest speed [m/s].
      duration: Duration of the path [s].
      period: Sample period [s].

    Returns:
      Position [m], speed [m/s] and acceleration [m/s²], shape (n, 3).
    """
    t = np.arange(round(duration / period)) * period
    speed = sum(np.sin(2.0 * np.pi * f * t + p) for f, p in ((0.31, 0.0), (0.73, 1.0), (1.27, 2.0)))
    speed = speed * np.clip(t / 0.3, 0.0, 1.0) * np.clip((duration - t) / 0.3, 0.0, 1.0)
    path = _from_speed(0.0, speed, period)
    span = np.ptp(path[:, 0])
    size = min(top / np.abs(path[:, 1]).max(), 2.0 * amplitude / span)
    path *= size
    path[:, 0] -= 0.5 * (path[:, 0].max() + path[:, 0].min())
    return path


@dataclass(frozen=True)
class AxisMove:
    """One condition of the plan."""

    name: str
    words: str
    target: Callable[[Axis, float, float], Array]
    """Function of axis, duration [s] and period [s] that returns the path as `strokes` does, shape (n, 3)."""
    payload_share: float = 0.0
    """Added mass relative to that of the axis; the log declares it."""


def _strokes(reach: float, speeds: tuple[float, ...], pull: float) -> Callable[[Axis, float, float], Array]:
    def target(axis: Axis, duration: float, period: float) -> Array:
        top = highest_speed(axis)
        chosen, acceleration = [s * top for s in speeds], pull * highest_acceleration(axis)
        return strokes(reach * axis.axis.travel, chosen, acceleration, duration, period)

    return target


def _sweep(axis: Axis, duration: float, period: float) -> Array:
    top = highest_speed(axis)
    return sweep(0.3 * axis.axis.travel, 0.3, 3.0, 0.25 * top, duration, period)


def _wander(axis: Axis, duration: float, period: float) -> Array:
    return wander(0.8 * axis.axis.travel, 0.8 * highest_speed(axis), duration, period)


MOVES: tuple[AxisMove, ...] = (
    AxisMove("long_strokes", "long strokes at full speed", _strokes(0.9, (1.0,), 0.8)),
    AxisMove("speed_ladder", "strokes at four speeds", _strokes(0.35, (1.0, 0.6, 0.3, 0.15), 0.6)),
    AxisMove("short_strokes", "short strokes with many reversals", _strokes(0.2, (0.6,), 1.0)),
    AxisMove("slow_crawl", "slow crawl in both directions", _strokes(0.1, (0.05, 0.1, 0.2), 0.1)),
    AxisMove("sweep", "a sine of rising frequency", _sweep),
    AxisMove("wander", "an irregular path", _wander),
    AxisMove("with_payload", "strokes with known mass on it", _strokes(0.7, (0.8, 0.4), 0.7), PAYLOAD_SHARE),
)
"""The plan; each move is a condition of its own."""


def drive_move(
    axis: Axis, move: AxisMove, seed: int, duration: float = DURATION, declared: Axis | None = None
) -> dict[str, Array]:
    """Drive one move and return its columns as `omnimj.plant.axis.drive_axis` does.

    Args:
      axis: True axis, with its effects.
      move: The move.
      seed: Seed of the sensor noise.
      duration: Duration of the run [s].
      declared: Axis that path, servo and payload assume; the true one when None.
    """
    known = axis if declared is None else declared
    path = move.target(known, duration, 1.0 / axis.sensors.sample_rate)
    return drive_axis(axis, path, servo(known), payload=move.payload_share * known.axis.mass, seed=seed)


def plan_moves(axis: Axis, seed: int) -> list[Condition]:
    """Conditions of all moves; `mass` is declared where it differs from that of the model."""
    found = []
    for move in MOVES:
        mass = round(axis.axis.mass * (1.0 + move.payload_share), 6)
        found.append(Condition(move.name, {"mass": mass} if move.payload_share else {}, move))
    return found


def record_axis(axis: Axis, nominal: Axis, condition: Condition, config: RunConfig) -> Mapping[str, Array]:
    """Record one move under position control: force of the drive and position.

    Args:
      axis: True axis, with its effects.
      nominal: Axis that the controller assumes.
      condition: Condition whose drive is an `AxisMove`.
      config: Seed and progress; there is one plant only.
    """
    move: AxisMove = condition.drive
    columns = drive_move(axis, move, config.seed, declared=nominal)
    if config.progress is not None:
        config.progress(1, 1)
    return {name: columns[name] for name in _MEASURED}
