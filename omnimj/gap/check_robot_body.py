"""Wheel speeds that a body's accelerometer and gyro ask for, window by window."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.gap.check_columns import filled
from omnimj.gap.check_compare import integral, windows
from omnimj.recording.dataset import Run
from omnimj.signals import Array

_BLOCK = 0.01  # [s] that one row covers
_ADDED = 0.1  # share of a wheel's motion that the accelerometer must tell beyond the gyro


@dataclass(frozen=True)
class BodyWindow:
    """A stretch of one run in which the unknown start and the sensors' biases are constant."""

    wheels: Array
    """Wheel speeds, shape (n, wheels) [rad/s]."""
    yaw_rate: Array
    """Shape (n,) [rad/s]."""
    along: Array
    """Body speed gained by what x and by what y of the accelerometer say, shape (2, n, 2) [m/s]."""
    free: Array
    """Body speeds that start and biases may add, shape (4, n, 2)."""


def body_windows(runs: Sequence[Run], wheels: int, gyro: float, longest: float) -> list[BodyWindow]:
    """Cuts runs into windows.

    Args:
      runs: Of a robot.
      wheels: How many.
      gyro: Factor by which the gyro is known to be off.
      longest: Length of a window at most [s].
    """
    found = []
    for run in runs:
        time = run.time
        step = max(float(np.median(np.diff(time))), 1e-6)
        size = max(1, round(_BLOCK / step))
        names = [f"wheel_speed_{k + 1}" for k in range(wheels)]
        columns = [*names, "yaw_rate", "acceleration_x", "acceleration_y"]
        table = np.stack([filled(run, n) for n in columns], axis=1)
        parts = windows(len(time), max(60, int(longest / step)))
        found += [_window(time[w], table[w], wheels, gyro, size) for w in parts]
    return [p for p in found if len(p.yaw_rate) > 20]


def _window(time: Array, table: Array, wheels: int, gyro: float, size: int) -> BodyWindow:
    rate = table[:, wheels] / gyro
    theta = integral(time, rate)
    c, s = np.cos(theta), np.sin(theta)

    def gained(x: Array, y: Array) -> Array:
        """Rᵀ∫R a dt, shape (n, 2)."""
        east, north = integral(time, c * x - s * y), integral(time, s * x + c * y)
        return np.stack([c * east + s * north, c * north - s * east], axis=1)

    zero, one = np.zeros_like(time), np.ones_like(time)
    along = [gained(table[:, wheels + 1], zero), gained(zero, table[:, wheels + 2])]
    free = [np.stack([c, -s], axis=1), np.stack([s, c], axis=1), gained(one, zero), gained(zero, one)]
    every = slice(0, len(time) // size * size)

    def mean(values: Array) -> Array:
        return values[every].reshape(-1, size, *values.shape[1:]).mean(axis=1)

    return BodyWindow(
        mean(table[:, :wheels]),
        mean(rate),
        np.stack([mean(v) for v in along]),
        np.stack([mean(v) for v in free]),
    )


def _asked(part: BodyWindow, row: Array, axes: Array) -> tuple[Array, Array]:
    """What a wheel with a row of the rolling matrix should do, start and biases out, and their basis."""
    basis = np.linalg.qr((part.free @ row[:2]).T)[0]
    asked = axes[0] * part.along[0] @ row[:2] + axes[1] * part.along[1] @ row[:2] + row[2] * part.yaw_rate
    return asked - basis @ (basis.T @ asked), basis


def fitness(
    parts: Sequence[BodyWindow], rolling: Array, order: Sequence[int], signs: Array, axes: Array
) -> float:
    """Share of the wheels' motion that the body leaves open, each wheel with a positive scale of its own.

    Args:
      parts: Windows.
      rolling: Rolling speed per body twist over the radius, shape (wheels, 3).
      order: Which wheel each column is said to be.
      signs: Of the columns, shape (wheels,).
      axes: Signs of the accelerometer's x and y, shape (2,).
    """
    left = total = 0.0
    for k, wheel in enumerate(order):
        xy = xx = yy = 0.0
        for part in parts:
            x, basis = _asked(part, rolling[wheel], axes)
            y = signs[k] * part.wheels[:, k]
            y = y - basis @ (basis.T @ y)
            xy, xx, yy = xy + x @ y, xx + x @ x, yy + y @ y
        left += yy - max(xy, 0.0) ** 2 / max(xx, 1e-300)
        total += yy
    return float(left / max(total, 1e-300))


def wheel_scales(parts: Sequence[BodyWindow], rolling: Array, count: int) -> list[tuple[float, float]]:
    """Of every wheel: its scale against the accelerometer's axis along which it drives, and how sure it is.

    Gyro and both axes have each a factor of their own, so that the unit of one does not spoil the others. How
    sure: the correlation with all three, 0 where the axis adds next to nothing.
    """
    found = []
    for k in range(count):
        own = int(abs(rolling[k, 1]) > abs(rolling[k, 0]))
        gram, slope, total = np.zeros((3, 3)), np.zeros(3), 0.0
        for part in parts:
            basis = np.linalg.qr((part.free @ rolling[k, :2]).T)[0]
            told = np.stack(
                [
                    part.along[own] @ rolling[k, :2],
                    part.along[1 - own] @ rolling[k, :2],
                    rolling[k, 2] * part.yaw_rate,
                ]
            )
            told = told - (told @ basis) @ basis.T
            y = part.wheels[:, k] - basis @ (basis.T @ part.wheels[:, k])
            gram, slope, total = gram + told @ told.T, slope + told @ y, total + float(y @ y)
        whole, factors = _solved(gram, slope)
        without, _ = _solved(gram[1:, 1:], slope[1:])
        adds = whole - without > _ADDED * total
        found.append(
            (float(factors[0]), float(np.sqrt(max(whole / max(total, 1e-300), 0.0))) if adds else 0.0)
        )
    return found


def _solved(gram: Array, slope: Array) -> tuple[float, Array]:
    """Least squares from its normal equations: what it explains, and the factors."""
    size = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
    factors = np.linalg.lstsq(gram / np.outer(size, size), slope / size, rcond=1e-8)[0] / size
    return float(factors @ slope), factors
