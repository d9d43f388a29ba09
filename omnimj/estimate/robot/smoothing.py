"""One Gaussian low pass for all channels of a stretch of a log, and its derivatives."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

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
