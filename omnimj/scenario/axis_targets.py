"""Paths along the guide for a position controller: ladders of speeds, sweeps, crawls with reversals."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from omnimj.parameters.axis import Axis
from omnimj.signals import Array

_ROUND = 0.03  # [s] over which an acceleration builds up: what a servo drive's jerk limit makes
_REST = 0.15  # [s] at either end of a stroke
_STILL = 0.5  # [s] of rest before and after a sweep, or a quarter of it


def highest_speed(axis: Axis) -> float:
    """Speed that suits travel and force of an axis [m/s]."""
    body = axis.axis
    return min(1.4 * body.travel, np.sqrt(highest_acceleration(axis) * body.travel))


def highest_acceleration(axis: Axis) -> float:
    """Acceleration for which a quarter of the force is enough [m/s²]."""
    return 0.25 * axis.axis.force_limit / axis.axis.mass


def _from_speed(start: float, speed: Array, period: float) -> Array:
    """Position, speed and acceleration of a path that begins at rest, rounded, shape (n, 3)."""
    width = max(round(_ROUND / period), 1)
    smooth = np.convolve(np.concatenate([np.zeros(width), speed]), np.full(width, 1.0 / width))
    smooth = smooth[width : width + len(speed)]
    moved = np.concatenate([[0.0], np.cumsum(0.5 * (smooth[1:] + smooth[:-1]))]) * period
    return np.stack([start + moved, smooth, np.gradient(smooth, period)], axis=1)


def _stroke(distance: float, speed: float, acceleration: float, period: float) -> Array:
    """Speeds of one stroke with a rest behind it."""
    way = abs(distance)
    top = min(speed, np.sqrt(way * acceleration))
    rise, cruise = top / acceleration, way / top - top / acceleration
    t = np.arange(0.0, 2.0 * rise + cruise + _REST, period)
    shape = np.minimum(np.minimum(t * acceleration, top), (2.0 * rise + cruise - t) * acceleration)
    found = np.maximum(shape, 0.0)
    # samples do not hit the corners: the distance is met all the same
    return np.sign(distance) * found * way / max(found.sum() * period, 1e-12)


def strokes(
    amplitude: float, speeds: Sequence[float], acceleration: float, duration: float, period: float
) -> Array:
    """To and fro between ± amplitude at one speed after the other, again and again, shape (n, 3)."""
    parts, place = [np.zeros(round(_REST / period))], -amplitude
    length, total = len(parts[0]), round(duration / period)
    for speed in itertools.cycle(np.repeat(speeds, 2)):
        if length >= total:
            break
        parts.append(_stroke(-2.0 * place, speed, acceleration, period))
        place, length = -place, length + len(parts[-1])
    return _from_speed(-amplitude, np.concatenate(parts)[:total], period)


def sweep(amplitude: float, slow: float, fast: float, top: float, duration: float, period: float) -> Array:
    """Sine of rising frequency [Hz], its amplitude held so that speed stays below `top`, shape (n, 3)."""
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
    """Sum of slow sines that do not repeat, its speed below `top`, shape (n, 3)."""
    t = np.arange(round(duration / period)) * period
    speed = sum(np.sin(2.0 * np.pi * f * t + p) for f, p in ((0.31, 0.0), (0.73, 1.0), (1.27, 2.0)))
    speed = speed * np.clip(t / 0.3, 0.0, 1.0) * np.clip((duration - t) / 0.3, 0.0, 1.0)
    path = _from_speed(0.0, speed, period)
    span = np.ptp(path[:, 0])
    size = min(top / np.abs(path[:, 1]).max(), 2.0 * amplitude / span)
    path *= size
    path[:, 0] -= 0.5 * (path[:, 0].max() + path[:, 0].min())
    return path
