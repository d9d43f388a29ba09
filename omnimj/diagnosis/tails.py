"""How high a statistic comes by chance.

The Gumbel tail of its maxima over independent stretches:

A likelihood ratio exceeds h by chance with a probability that falls like e^{−h}; coloured noise makes it
e^{−h/β}. A stretch then exceeds h on average N(h) times, and never with probability e^{−N(h)}: the maxima are
Gumbel's. With k of m maxima above their median u,
  N(h) = N_u e^{−(h − u)/β},   N_u = −ln(1 − k/m),   β̂ = mean excess over u / c,
  c = (γ + ln N_u + E_1(N_u)) / (1 − e^{−N_u}),
c the mean of the largest of a Poisson number of exponential ones, at least one. k excesses tell β within
about 1/√k only, so that its upper 90 % bound is used, β̂ 2k/χ²_{0.1}(2k): few data give a high threshold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import exp1, gammaincinv, stdtrit

from omnimj.signals import Array

_DOUBT = 0.1  # that β is above its bound


@dataclass(frozen=True)
class Tail:
    """Of one statistic."""

    start: float
    """u, the median of the maxima."""
    often: float
    """How often per hour it is exceeded [1/h]."""
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
    often = -math.log1p(-k / len(maxima))
    usual = (np.euler_gamma + math.log(often) + float(exp1(often))) / (k / len(maxima))
    slope = float(excess.mean()) / usual * k / float(gammaincinv(k, _DOUBT))
    return Tail(start, often * 3600.0 / stretch, slope, float(maxima.max()))


@dataclass(frozen=True)
class Spread:
    """Of a number that is learnt, the same for a whole run: it differs from robot to robot, not with time.

    It is the sum of many small errors, taken as normal: the next of k runs exceeds
      m + s √(1 + 1/k) t_{k−1}(1 − p)
    with probability p, Student's t since m and s are estimates themselves.
    """

    mean: float
    slope: float
    """s: standard deviation, in the unit of the statistic."""
    runs: int
    hours: float
    """Of one run [h]."""
    largest: float
    """The largest value that was seen."""

    def level(self, rate: float) -> float:
        """What is exceeded `rate` times per hour."""
        if self.runs < 2:
            return math.inf
        far = float(stdtrit(self.runs - 1, 1.0 - min(rate * self.hours, 0.5)))
        return self.mean + self.slope * math.sqrt(1.0 + 1.0 / self.runs) * far


def spread_of(maxima: Array, hours: float) -> Spread:
    """The spread of a learnt number.

    Args:
      maxima: Of one run each, shape (k,).
      hours: Of all runs together [h].
    """
    k = len(maxima)
    deviation = float(maxima.std(ddof=1)) if k > 1 else 0.0
    return Spread(float(maxima.mean()), deviation, k, hours / k, float(maxima.max()))
