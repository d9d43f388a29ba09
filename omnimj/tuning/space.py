"""What is searched: each gain on a scale of its own, the logarithm of what it is over what it was."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from omnimj.control.gains import NAMES, TABLES, Gains, rule_of, unit_of
from omnimj.errors import InputError, UnknownNameError

WIDEST = 4.0
"""Factor by which a gain may grow or shrink."""
_DIGITS = 5  # of a gain: a file that is read again gives the same run


@dataclass(frozen=True)
class Axis:
    """One gain."""

    name: str
    """One of `control.gains.NAMES`."""
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


def chosen_names(asked: Sequence[str]) -> tuple[str, ...]:
    """Gains by their names or by those of their tables; all of them when none is asked for.

    Raises:
      UnknownNameError: Neither a gain nor a table.
    """
    if not asked:
        return NAMES
    for name in asked:
        if name not in NAMES and name not in TABLES:
            raise UnknownNameError("--only", "gain", name, (*TABLES, *NAMES))
    return tuple(name for name in NAMES if name in asked or name.partition(".")[0] in asked)


Bounds = Mapping[str, tuple[float, float]]
"""Least and largest value of some gains, by their names."""


def read_bound(text: str) -> tuple[str, tuple[float, float]]:
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
    if name not in NAMES:
        raise UnknownNameError("--bound", "gain", name, NAMES)
    try:
        found = float(low or 0.0), float(high or math.inf)
    except ValueError:
        rule = "two numbers with : between them are needed"
        raise InputError(place, f"found {ends[:40]!r}", rule) from None
    if not 0.0 <= found[0] < found[1]:
        rule = "the least value must be 0 or more, and below the largest"
        raise InputError(place, f"found {found[0]:g} and {found[1]:g}", rule)
    return name, found


def axes_of(gains: Gains, names: Sequence[str], bounds: Bounds = MappingProxyType({})) -> tuple[Axis, ...]:
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
        low, high = max(low, start / WIDEST), min(high, start * WIDEST, rule.high)
        found.append(Axis(name, start, low, high))
    return tuple(found)


def with_values(gains: Gains, axes: Sequence[Axis], values: Sequence[float]) -> Gains:
    """The gains with a candidate's values."""
    return gains.changed(named(axes, values))


def named(axes: Sequence[Axis], values: Sequence[float]) -> Mapping[str, float]:
    """A candidate's values by the gains' names."""
    return {axis.name: value for axis, value in zip(axes, values, strict=True)}
