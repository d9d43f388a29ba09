"""How high a statistic comes by chance: the exponential tail of its maxima over independent stretches.

A likelihood ratio exceeds h by chance with a probability that falls like e^{−h}; coloured noise makes that
e^{−h/β}. With k of m maxima above their median u, and N_u = k/m per stretch,
  N(h) = N_u e^{−(h − u)/β},   β̂ = mean excess over u,
h is the level that is exceeded as often as allowed. k excesses tell β within ±1/√k only, so that its upper
90 % bound is used, β̂ 2k/χ²_{0.1}(2k): few data give a high threshold, not a wrong one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from omnimj.signals import Array

_DOUBT = 0.1  # that β is above its bound


@dataclass(frozen=True)
class Tail:
    """Of one statistic."""

    start: float
    """u, the median of the maxima."""
    often: float
    """How often per hour a stretch exceeds it [1/h]."""
    slope: float
    """Upper bound of β, in the unit of the statistic."""
    largest: float
    """The largest value that was seen."""

    def level(self, rate: float) -> float:
        """What is exceeded `rate` times per hour."""
        return self.start + self.slope * max(math.log(max(self.often, 1e-300) / rate), 0.0)


def tail_of(maxima: Array, stretch: float) -> Tail:
    """The tail of a statistic.

    Args:
      maxima: Over one stretch each, shape (m,).
      stretch: Length of a stretch [s].
    """
    start = float(np.median(maxima))
    excess = maxima[maxima > start] - start
    k = len(excess)
    if k == 0:
        return Tail(start, 0.0, 0.0, float(maxima.max()))
    slope = float(excess.mean()) * k / float(gammaincinv(k, _DOUBT))
    return Tail(start, k / len(maxima) * 3600.0 / stretch, slope, float(maxima.max()))
