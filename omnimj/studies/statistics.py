"""Counts of trials with what they are of and how sure they are."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from scipy.stats import chi2

_Z = 1.959964  # of a two-sided 95 % interval


@dataclass(frozen=True)
class Rate:
    """k of n with 95 % bounds."""

    hits: int
    count: int
    value: float | None
    low: float
    high: float


def wilson(hits: int, count: int) -> Rate:
    """(p + z²/2n ± z √(p(1 − p)/n + z²/4n²))/(1 + z²/n), Wilson 1927."""
    if count == 0:
        return Rate(0, 0, None, 0.0, 1.0)
    p, z = hits / count, _Z
    middle = (p + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(p * (1 - p) / count + z * z / (4 * count * count)) / (1 + z * z / count)
    return Rate(hits, count, p, max(middle - half, 0.0), min(middle + half, 1.0))


def rate(outcomes: Iterable[bool]) -> Rate:
    """How often it was true."""
    found = list(outcomes)
    return wilson(sum(found), len(found))


@dataclass(frozen=True)
class EventRate:
    """Events in a time, and the rate that they speak for."""

    events: int
    hours: float
    per_hour: float | None
    """None without any time."""
    upper: float | None
    """One-sided 95 % bound [1/h]."""


def event_rate(events: int, hours: float) -> EventRate:
    """k/T and its bound χ²_0.95(2k + 2)/(2T), exact for a Poisson process (Garwood 1936).

    Args:
      events: k.
      hours: T [h].
    """
    if hours <= 0.0:
        return EventRate(events, 0.0, None, None)
    return EventRate(events, hours, events / hours, float(chi2.ppf(0.95, 2 * events + 2)) / (2.0 * hours))


def quantile(values: Iterable[float], share: float) -> float | None:
    """Value below which a share of them lies, on the line between two neighbours; None of none."""
    found = sorted(v for v in values if not math.isnan(v))
    if not found:
        return None
    place = share * (len(found) - 1)
    below = min(int(place), len(found) - 1)
    above = min(below + 1, len(found) - 1)
    if math.isinf(found[above]):
        return found[above] if place > below else found[below]
    return found[below] + (place - below) * (found[above] - found[below])


def median(values: Iterable[float]) -> float | None:
    """The middle one; None of none."""
    return quantile(values, 0.5)


# Numbers of many trials as tables for people.


@dataclass(frozen=True)
class Table:
    """A heading and ready cells."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def format_rate(found: Rate) -> str:
    """`93 % (84–97, n 60)`."""
    if found.value is None:
        return "–"
    return f"{100 * found.value:.0f} % ({100 * found.low:.0f}–{100 * found.high:.0f}, n {found.count})"


def format_number(value: float | None) -> str:
    """Three digits, or a dash."""
    return "–" if value is None else f"{value:.3g}"


def format_markdown(heading: str, lines: Sequence[str], found: Sequence[Table]) -> str:
    """A whole file: heading, what the numbers are of, tables."""
    parts = [f"# {heading}", *lines]
    for table in found:
        rows = [table.head, tuple("---" for _ in table.head), *table.rows]
        cells = "\n".join("| " + " | ".join(row) + " |" for row in rows)
        parts.append(f"## {table.title}\n\n{cells}")
    return "\n\n".join(parts) + "\n"
