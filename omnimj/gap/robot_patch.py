"""Where a stretch of floor may begin and end: the interval that explains most, out of all there are.

To first order the effects of narrow strips add up. With g_j = c_jᵀ r and G_jk = c_jᵀ c_k of every strip's
sensitivity c_j and the mismatch r, one change of friction over an interval S explains
  (Σ_S g_j)²/(Σ_S Σ_S G_jk)
of r², so that a replay per strip tells of every pair of edges.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from omnimj.signals import Array

_WIDTH, _MOST = 0.1, 80  # [m] of a strip, and how many there may be
_PART = 0.3  # of the friction taken away in a strip


def likely_patch(
    span: tuple[float, float], noise: Array, mismatch: Array, moved: Callable[[Array], list[Array]]
) -> tuple[float, float]:
    """Start and end of the stretch of floor that explains most of the mismatch [m].

    Args:
      span: Lowest and highest place that a wheel has been to [m].
      noise: Of each channel, shape (channels,).
      mismatch: Measured − simulated, shape (blocks, channels).
      moved: Predictions' changes by patches (scale, start, end), shape (strips, 3) → (blocks, channels) each.
    """
    count = int(np.clip((span[1] - span[0]) / _WIDTH, 3, _MOST))
    edges = np.linspace(*span, count + 1)
    strips = np.stack([np.full(count, 1.0 - _PART), edges[:-1], edges[1:]], axis=1)
    columns = np.stack([np.nan_to_num(change / noise).ravel() for change in moved(strips)], axis=1)
    slope = columns.T @ np.nan_to_num(mismatch / noise).ravel()
    gram = columns.T @ columns
    above = np.concatenate(([0.0], np.cumsum(slope)))
    corner = np.zeros((count + 1, count + 1))
    corner[1:, 1:] = np.cumsum(np.cumsum(gram, axis=0), axis=1)
    first, last = np.triu_indices(count + 1, 1)
    size = corner[last, last] - corner[first, last] - corner[last, first] + corner[first, first]
    gain = (above[last] - above[first]) ** 2 / np.maximum(size, 1e-9 * max(float(gram.max()), 1e-30))
    best = int(np.argmax(gain))
    return float(edges[first[best]]), float(edges[last[best]])
