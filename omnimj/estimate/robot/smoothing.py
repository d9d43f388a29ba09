"""Gaussian low pass for all channels of a stretch of a log, its derivatives, and a narrow one for gears.

A gear passes another force while the wheel drives the motor than the other way round. The mean of such a
force over the width of the rows' filter is not the force of the mean currents: when a robot begins to brake,
both directions lie within one width. The samples of `Shafts` pass a narrow Gaussian, the law of the gear is
applied to them, and the rest of the rows' Gaussian to its forces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.sparse import block_diag, csr_array

from omnimj.signals import Array


class Smoother(NamedTuple):
    """Gaussian low pass that reads irregular samples and answers at given rows."""

    grid: Array
    """Even times between the samples, shape (k,) [s]."""
    rows: Array
    """Times at which the channel is filtered, shape (m,) [s]."""
    width: float
    """Standard deviation of the Gaussian [s]."""

    @property
    def period(self) -> float:
        """Step of the grid [s]."""
        return float(self.grid[1] - self.grid[0])

    def even(self, time: Array, values: Array) -> Array:
        """Samples at irregular times, shape (s,) each, on the grid by straight lines, shape (k,)."""
        return np.interp(self.grid, time, values)

    def filtered(self, even: Array, late: float = 0.0, order: int = 0, width: float | None = None) -> Array:
        """A channel, or its derivative, behind the low pass at the rows, shape (m,).

        Args:
          even: The channel on the grid, shape (k,).
          late: Delay of the channel, which is taken back [s].
          order: 0 for the channel, 1 and 2 for its derivatives [1/s, 1/s²].
          width: Another width than that of the smoother [s].
        """
        sigma = (self.width if width is None else width) / self.period
        # a second derivative's kernel, cut off, would take the position itself for an acceleration
        reach = 6.0 if order == 2 else 4.0
        smooth = gaussian_filter1d(even, sigma, order=order, mode="nearest", truncate=reach)
        smooth /= self.period**order
        return np.interp(self.rows + late, self.grid, smooth)


def sample_noise(values: Array, order: int = 2) -> float:
    """Noise of single samples from differences of some order, robust to motion and steps.

    Args:
      values: Samples, shape (k,), k > order.
      order: 2 for velocities and currents, 4 for positions, which change smoothly.
    """
    bend = np.diff(values, order)
    gain = math.sqrt(sum(math.comb(order, k) ** 2 for k in range(order + 1)))
    return float(1.4826 * np.median(np.abs(bend)) / gain)


_WIDTH = 0.0075
"""Standard deviation of the narrow Gaussian, and the time between samples behind it [s]."""
_REACH = 3.0  # standard deviations of the rest of the filter
_WIDEST = 0.9  # of the rows' filter; what is left of that is not worth a second one


class Shafts(NamedTuple):
    """Currents and speeds of n wheels at k times, and how forces at these times make the m rows' forces."""

    current: Array
    """Shape (k, n) [A]."""
    wheel_speed: Array
    """Shape (k, n) [rad/s]."""
    wheel_acceleration: Array
    """Shape (k, n) [rad/s²]."""
    ripple: Array
    """Standard deviation of the current within the narrow filter, less the monitor's noise, (k, n) [A]."""
    mean: csr_array | None = None
    """Weights of the times in the rows, shape (m, k); None where the times are the rows'."""

    def averaged(self, forces: Array) -> Array:
        """Mean over the rows' filter, shape (m, n), of forces at the times, shape (k, n)."""
        return forces if self.mean is None else np.asarray(self.mean @ forces, float)


def shafts_of(
    smoother: Smoother, currents: Sequence[Array], speeds: Sequence[Array], late: float, noise: float
) -> Shafts:
    """Samples of one stretch of a log.

    Args:
      currents: Current of each of n wheels on the filter's grid, shape (g,) each [A].
      speeds: Speed of each wheel on the filter's grid, shape (g,) each [rad/s].
      late: Delay of the wheel speeds [s].
      noise: Noise of the current monitors [A].
    """
    width, mean, narrow = max(_WIDTH, smoother.period), None, smoother
    if width < _WIDEST * smoother.width:
        times, mean = _mean_over(smoother.rows, float(np.sqrt(smoother.width**2 - width**2)))
        narrow = Smoother(smoother.grid, times, width)
    return Shafts(
        np.column_stack([narrow.filtered(even) for even in currents]),
        np.column_stack([narrow.filtered(even, late) for even in speeds]),
        np.column_stack([narrow.filtered(even, late, 1) for even in speeds]),
        np.column_stack([_ripple(narrow, even, noise) for even in currents]),
        mean,
    )


def together(parts: Sequence[Shafts]) -> Shafts:
    """Samples of all stretches of a run."""
    current, speed, acceleration, ripple = (
        np.concatenate(column) for column in zip(*(part[:4] for part in parts), strict=True)
    )
    means = [part.mean for part in parts if part.mean is not None]
    whole = csr_array(block_diag(means, format="csr")) if means else None
    return Shafts(current, speed, acceleration, ripple, whole)


def _mean_over(rows: Array, width: float) -> tuple[Array, csr_array]:
    """Times around evenly spaced rows, and the weights of a Gaussian about each row, shape (m, k)."""
    period = float(rows[1] - rows[0]) if len(rows) > 1 else _WIDTH
    each = max(round(period / _WIDTH), 1)
    step, reach = period / each, int(np.ceil(_REACH * width / (period / each)))
    offset = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (offset * step / width) ** 2)
    count = each * (len(rows) - 1) + 2 * reach + 1
    times = rows[0] + step * (np.arange(count) - reach)
    column = each * np.arange(len(rows))[:, None] + offset + reach
    starts = len(offset) * np.arange(len(rows) + 1)
    table = (np.tile(weights / weights.sum(), len(rows)), column.ravel(), starts)
    return times, csr_array(table, shape=(len(rows), count))


def _ripple(narrow: Smoother, even: Array, noise: float) -> Array:
    """Standard deviation of a current within the narrow filter, less the monitor's noise [A]."""
    width = narrow.width / narrow.period
    smooth = gaussian_filter1d(even, width, mode="nearest")
    square = gaussian_filter1d((even - smooth) ** 2, width, mode="nearest")
    return np.interp(narrow.rows, narrow.grid, np.sqrt(np.maximum(square - noise**2, 0.0)))
