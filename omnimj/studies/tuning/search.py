"""What is searched: each gain on a scale of its own, the logarithm of what it is over what it was."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from omnimj.control.gains import GAIN_NAMES, GAIN_TABLES, Gains, rule_of, unit_of
from omnimj.errors import InputError, UnknownNameError

WIDEST_FACTOR = 4.0
"""Factor by which a gain may grow or shrink."""
_DIGITS = 5  # of a gain: a file that is read again gives the same run


@dataclass(frozen=True)
class GainAxis:
    """One gain."""

    name: str
    """One of `control.GAIN_NAMES`."""
    start: float
    """Before the search."""
    low: float
    """Least of its values, above 0."""
    high: float

    @property
    def unit(self) -> str:
        """Of the gain."""
        return unit_of(self.name)

    def place(self, value: float) -> float:
        """ln(value/start)."""
        return math.log(value / self.start)

    def value(self, place: float) -> float:
        """start · e^place, in the digits that a file keeps, within the bounds."""
        found = float(f"{self.start * math.exp(place):.{_DIGITS}g}")
        return min(max(found, self.low), self.high)


def select_gains(asked: Sequence[str]) -> tuple[str, ...]:
    """Gains by their names or by those of their tables; all of them when none is asked for.

    Raises:
      UnknownNameError: Neither a gain nor a table.
    """
    if not asked:
        return GAIN_NAMES
    for name in asked:
        if name not in GAIN_NAMES and name not in GAIN_TABLES:
            raise UnknownNameError("--only", "gain", name, (*GAIN_TABLES, *GAIN_NAMES))
    return tuple(name for name in GAIN_NAMES if name in asked or name.partition(".")[0] in asked)


Bounds = Mapping[str, tuple[float, float]]
"""Least and largest value of some gains, by their names."""


def parse_bound(text: str) -> tuple[str, tuple[float, float]]:
    """`control.yaw_rate_proportional=6:9`; either end may be left out.

    Raises:
      InputError: Of another shape, or empty.
      UnknownNameError: No such gain.
    """
    name, given, ends = text.partition("=")
    low, parted, high = ends.partition(":")
    place = f"--bound {text[:60]}"
    if not (given and parted):
        raise InputError(place, "is of another shape", "write NAME=LOW:HIGH, e.g. recovery.slip_cap=0.1:")
    if name not in GAIN_NAMES:
        raise UnknownNameError("--bound", "gain", name, GAIN_NAMES)
    try:
        found = float(low or 0.0), float(high or math.inf)
    except ValueError:
        rule = "two numbers with : between them are needed"
        raise InputError(place, f"found {ends[:40]!r}", rule) from None
    if not 0.0 <= found[0] < found[1]:
        rule = "the least value must be 0 or more, and below the largest"
        raise InputError(place, f"found {found[0]:g} and {found[1]:g}", rule)
    return name, found


def axes_of(
    gains: Gains, names: Sequence[str], bounds: Bounds = MappingProxyType({})
) -> tuple[GainAxis, ...]:
    """The axes of these gains.

    Raises:
      InputError: A gain that is 0: it is switched off, and no factor brings it back. Or one that is not
        within its bounds, or bounds of a gain that is not tuned.
    """
    for name in bounds:
        if name not in names:
            raise InputError(f"--bound {name}", "this gain is not tuned", choices=names)
    found = []
    for name in names:
        start, rule = gains.value(name), rule_of(name)
        if start <= 0.0:
            rule = "no factor brings it back; name the others with --only"
            raise InputError(name, "the gain is 0 before the search", rule)
        low, high = bounds.get(name, (0.0, math.inf))
        if not low <= start <= high:
            raise InputError(f"--bound {name}", f"it begins with {start:g}", f"from {low:g} to {high:g}")
        low, high = max(low, start / WIDEST_FACTOR), min(high, start * WIDEST_FACTOR, rule.high)
        found.append(GainAxis(name, start, low, high))
    return tuple(found)


def with_values(gains: Gains, axes: Sequence[GainAxis], values: Sequence[float]) -> Gains:
    """The gains with a candidate's values."""
    return gains.changed(values_by_name(axes, values))


def values_by_name(axes: Sequence[GainAxis], values: Sequence[float]) -> Mapping[str, float]:
    """A candidate's values by the gains' names."""
    return {axis.name: value for axis, value in zip(axes, values, strict=True)}


# CMA-ES by Hansen's own library `cma`: asks for candidates, is told what they cost.

INITIAL_STEP = 0.3
"""First standard deviation of ln(gain): a third up or down."""

Candidate = tuple[float, ...]
"""A value per axis."""


def generation_size(axes: int) -> int:
    """λ = 4 + ⌊3 ln n⌋, Hansen 2016; at least 6, so that there are enough to choose from."""
    return max(6, 4 + math.floor(3.0 * math.log(axes)))


class Search:
    """The search over the axes.

    Args:
      axes: At least one.
      seed: Of everything random in it.
    """

    def __init__(self, axes: Sequence[GainAxis], seed: int):
        import cma  # takes a while to load

        self._axes = tuple(axes)
        # one dimension more of no effect: CMA-ES is not made for a single one
        self._hidden = int(len(axes) == 1)
        random = np.random.default_rng(np.random.SeedSequence(seed))
        low = [axis.place(axis.low) for axis in axes] + [-1.0] * self._hidden
        high = [axis.place(axis.high) for axis in axes] + [1.0] * self._hidden
        self._strategy = cma.CMAEvolutionStrategy(
            np.zeros(len(axes) + self._hidden),
            INITIAL_STEP,
            {
                "bounds": [low, high],
                "popsize": generation_size(len(axes)),
                "randn": lambda *shape: random.standard_normal(shape),
                "seed": math.nan,
                "verbose": -9,
            },
        )
        self._asked: list[np.ndarray] = []

    def ask(self) -> list[Candidate]:
        """The next generation."""
        self._asked = self._strategy.ask()
        return [self._values(x) for x in self._asked]

    def tell(self, costs: Sequence[float]) -> None:
        """What the candidates that were asked for last cost, in that order."""
        self._strategy.tell(self._asked, list(costs))

    @property
    def middle(self) -> Candidate:
        """Where the search stands: the mean of its distribution."""
        return self._values(np.asarray(self._strategy.result.xfavorite))

    @property
    def is_over(self) -> bool:
        """Whether it has nothing left to find."""
        return bool(self._strategy.stop())

    def _values(self, x: np.ndarray) -> Candidate:
        return tuple(axis.value(float(place)) for axis, place in zip(self._axes, x, strict=False))
