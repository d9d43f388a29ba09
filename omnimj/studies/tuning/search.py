"""Search space and search: CMA-ES (Hansen's library `cma`) over ln(gain/gain before)."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.control.gains import GAIN_NAMES, GAIN_TABLES, Gains, rule_of, unit_of
from omnimj.errors import InputError, MissingLibrary, UnknownNameError

WIDEST_FACTOR = 4.0
"""Factor by which a gain may grow or shrink."""
_DIGITS = 5  # significant digits of a gain, so that a gains file reproduces a run exactly


@dataclass(frozen=True)
class GainAxis:
    """Axis of one gain."""

    name: str
    """One of `control.GAIN_NAMES`."""
    start: float
    """Gain before the search."""
    low: float
    """Smallest value, above 0."""
    high: float

    @property
    def unit(self) -> str:
        """Unit of the gain."""
        return unit_of(self.name)

    def place(self, value: float) -> float:
        """Return ln(value/start)."""
        return math.log(value / self.start)

    def value(self, place: float) -> float:
        """Return start · e^place within the bounds, rounded to the digits of a gains file."""
        found = float(f"{self.start * math.exp(place):.{_DIGITS}g}")
        return min(max(found, self.low), self.high)


def select_gains(names: Sequence[str]) -> tuple[str, ...]:
    """Return the gains with these names or in these tables; all gains without a name.

    Raises:
      UnknownNameError: A name is neither a gain nor a table.
    """
    if not names:
        return GAIN_NAMES
    for name in names:
        if name not in GAIN_NAMES and name not in GAIN_TABLES:
            raise UnknownNameError("--only", "gain", name, (*GAIN_TABLES, *GAIN_NAMES))
    return tuple(name for name in GAIN_NAMES if name in names or name.partition(".")[0] in names)


Bounds = Mapping[str, tuple[float, float]]
"""Smallest and largest value of some gains, by name."""


def parse_bound(text: str) -> tuple[str, tuple[float, float]]:
    """Parse a bound such as `control.yaw_rate_proportional=6:9`; either end may be omitted.

    Raises:
      InputError: The text has the wrong form, or the range is empty.
      UnknownNameError: The gain does not exist.
    """
    name, given, ends = text.partition("=")
    low, parted, high = ends.partition(":")
    place = f"--bound {text[:60]}"
    if not (given and parted):
        raise InputError(place, "has the wrong form", "write NAME=LOW:HIGH, e.g. recovery.slip_cap=0.1:")
    if name not in GAIN_NAMES:
        raise UnknownNameError("--bound", "gain", name, GAIN_NAMES)
    try:
        found = float(low or 0.0), float(high or math.inf)
    except ValueError:
        rule = "two numbers separated by : are needed"
        raise InputError(place, f"found {ends[:40]!r}", rule) from None
    if not 0.0 <= found[0] < found[1]:
        rule = "the smallest value must be 0 or more, and below the largest"
        raise InputError(place, f"found {found[0]:g} and {found[1]:g}", rule)
    return name, found


def axes_of(
    gains: Gains, names: Sequence[str], bounds: Bounds = MappingProxyType({})
) -> tuple[GainAxis, ...]:
    """Return the axes of these gains.

    Raises:
      InputError: A gain is 0, that is switched off, or outside its bounds; a bound is for a gain that
        is not tuned.
    """
    for name in bounds:
        if name not in names:
            raise InputError(f"--bound {name}", "this gain is not tuned", choices=names)
    found = []
    for name in names:
        start, rule = gains.value(name), rule_of(name)
        if start <= 0.0:
            rule = "gains are tuned by factors; name the others with --only"
            raise InputError(name, "the gain is 0 before the search", rule)
        low, high = bounds.get(name, (0.0, math.inf))
        if not low <= start <= high:
            raise InputError(
                f"--bound {name}", f"the gain before is {start:g}", f"must be from {low:g} to {high:g}"
            )
        low, high = max(low, start / WIDEST_FACTOR), min(high, start * WIDEST_FACTOR, rule.high)
        found.append(GainAxis(name, start, low, high))
    return tuple(found)


def with_values(gains: Gains, axes: Sequence[GainAxis], values: Sequence[float]) -> Gains:
    """Return the gains with the values of a candidate."""
    return gains.changed(values_by_name(axes, values))


def values_by_name(axes: Sequence[GainAxis], values: Sequence[float]) -> Mapping[str, float]:
    """Return the values of a candidate by the names of the gains."""
    return {axis.name: value for axis, value in zip(axes, values, strict=True)}


INITIAL_STEP = 0.3
"""Initial standard deviation of ln(gain), about a third up or down."""

Candidate = tuple[float, ...]
"""Values of a candidate, one per axis."""


def generation_size(axes: int) -> int:
    """Return λ = 4 + ⌊3 ln n⌋ for n axes (Hansen 2016), at least 6."""
    return max(6, 4 + math.floor(3.0 * math.log(axes)))


def require_cma() -> Any:
    """Import the library `cma`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about its own plots, which need another library
            import cma  # slow to import
    except ImportError:
        raise MissingLibrary("omnimj tune", "cma", "tune") from None
    return cma


class Search:
    """CMA-ES over the axes, by ask and tell."""

    def __init__(self, axes: Sequence[GainAxis], seed: int):
        cma = require_cma()
        self._axes = tuple(axes)
        # CMA-ES needs two dimensions: a single axis is complemented by one without effect
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
        """Return the candidates of the next generation."""
        self._asked = self._strategy.ask()
        return [self._values(x) for x in self._asked]

    def tell(self, costs: Sequence[float]) -> None:
        """Pass the costs of the last generation to CMA-ES, in the order of its candidates."""
        self._strategy.tell(self._asked, list(costs))

    @property
    def middle(self) -> Candidate:
        """Mean of the search distribution."""
        return self._values(np.asarray(self._strategy.result.xfavorite))

    @property
    def is_over(self) -> bool:
        """True if a stopping criterion of CMA-ES holds."""
        return bool(self._strategy.stop())

    def _values(self, x: np.ndarray) -> Candidate:
        return tuple(axis.value(float(place)) for axis, place in zip(self._axes, x, strict=False))
