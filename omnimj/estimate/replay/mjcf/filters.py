"""The filter that acceleration, speed and inputs share, so that M q̈ + b q̇ = F holds between filtered signals.

A local cubic does not give a value and its second derivative under one filter: to the second order in the
half width T the value is exact, and the derivative is that of q + T²/14 q̈. A balance of the two lacks the
force T²/14 M d²q̈/dt², as if a spring of the compliance T²/(14 M) were between motor and load.
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.ndimage import correlate1d
from scipy.signal import savgol_coeffs, savgol_filter

from omnimj.physics.native import kernel
from omnimj.signals import Array


def same_filter(width: int) -> Array:
    """Weights w with Σ w_i q̈_i = Σ g_i q_i, where g is the second derivative by a local cubic.

    Twice summed, g is a kernel that is linear between the samples; its integral over a smooth q̈ is, to the
    fourth order, the sum of the samples with the weights of Numerov's method.

    Args:
      width: Samples of the local cubic, odd, 5 at least.

    Returns:
      Shape (width,), of sum 1.
    """
    return np.convolve(_kernel(width), np.array([1.0, 10.0, 1.0]) / 12.0)


def local_cubic(values: Array, width: int, order: int, period: float) -> Array:
    """Derivative by local cubics, shape (n,): `savgol_filter`, whose weights are computed once.

    Args:
      values: Shape (n,).
      width: Samples of a cubic, odd, n at most.
      order: Order of the derivative.
      period: Time between the samples [s].
    """
    found = np.empty(len(values))
    _fit_cubics(np.ascontiguousarray(values, float), _cubic_weights(width, order, period), found)
    return found


@kernel
def _fit_cubics(values, weights, found):
    """`local_cubic` with the weights of `_cubic_weights`; the first and the last cubic serve for the ends."""
    n, width = len(values), len(weights)
    half, inside = width // 2, n - width + 1
    found[:] = 0.0
    for i in range(width):
        for k in range(inside):  # the inner loop, so that it is vectorised
            found[half + k] += weights[half, i] * values[k + i]
        for k in range(half):
            found[k] += weights[k, i] * values[i]
            found[n - 1 - k] += weights[width - 1 - k, i] * values[n - width + i]


@kernel
def add_filtered(values, column, stretches, weights, found):
    """Add a column filtered within each stretch, beyond whose ends its first and last value continue.

    Args:
      values: Shape (n, columns).
      column: Its index.
      stretches: Table whose first two columns are the first row of each stretch and the row after its last.
      weights: Of the filter, shape (w,), w odd.
      found: Shape (n, columns); the filtered column is added to the one of the same index.
    """
    half = len(weights) // 2
    for s in range(len(stretches)):
        first, last = stretches[s, 0], stretches[s, 1]
        for k in range(first, last):
            total = 0.0
            for i in range(len(weights)):
                total += weights[i] * values[min(max(k - half + i, first), last - 1), column]
            found[k, column] += total


@functools.cache
def _cubic_weights(width: int, order: int, period: float) -> Array:
    """Weights of the samples in the derivative of their cubic at each of them, shape (width, width)."""
    places = (np.arange(width) - width // 2) * period
    derivatives = [np.polyval(np.polyder(np.eye(4)[k], order), places) for k in range(4)]
    return np.asarray(np.stack(derivatives, axis=1) @ np.linalg.pinv(np.vander(places, 4)), float)


def filtered(values: Array, width: int) -> Array:
    """Values under the filter of the acceleration, shape (n,); local cubics at the ends."""
    return _inside(np.asarray(savgol_filter(values, width, 3)), values, same_filter(width))


def filtered_speed(position: Array, width: int, period: float) -> Array:
    """Speed under the filter of the acceleration, shape (n,); local cubics at the ends."""
    weights = np.convolve(_kernel(width), np.array([-0.5, 0.0, 0.5]) / period)
    ends = np.asarray(savgol_filter(position, width, 3, deriv=1, delta=period))
    return _inside(ends, position, weights)


def limited_speed(position: Array, speed: Array, width: int, period: float) -> Array:
    """The smallest of the speed and the slopes before and after each sample, 0 where their signs differ.

    A local cubic overshoots beside a stop: for some rows a joint that rests seems to move backwards. The
    slopes of straight lines over half of the width, one of which lies in the rest, do not. Slope limiters of
    finite volumes take the same minimum (minmod). Position and speed have the shape (n,), the width is odd.
    """
    half = width // 2
    ramp = np.arange(half + 1) - 0.5 * half
    line = np.zeros(2 * half + 1)
    line[half:] = ramp / (ramp @ ramp * period)
    slopes = [correlate1d(position, weights, mode="nearest") for weights in (line, -line[::-1])]
    every = np.stack([speed, *slopes])
    least = np.abs(every).min(axis=0)
    return np.where(np.abs(np.sign(every).sum(axis=0)) == len(every), np.sign(speed) * least, 0.0)


def _kernel(width: int) -> Array:
    """Kernel whose second differences are the weights of the second derivative, shape (width − 2,)."""
    return np.cumsum(np.cumsum(savgol_coeffs(width, 3, deriv=2)))[:-2]


def _inside(ends: Array, values: Array, weights: Array) -> Array:
    half, found = len(weights) // 2, np.array(ends, float)
    inside = slice(half, len(found) - half)
    found[inside] = correlate1d(np.asarray(values, float), weights)[inside]
    return found
