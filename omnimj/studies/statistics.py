"""Statistics of trials: rates with confidence bounds, quantiles, and tables of results."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest, chi2


@dataclass(frozen=True)
class Rate:
    """Share k/n with its 95 % confidence interval."""

    hits: int
    count: int
    value: float | None
    """k/n; None without any trial."""
    low: float
    high: float


def wilson(hits: int, count: int) -> Rate:
    """Return k/n, hits over count, with its Wilson score interval (Wilson 1927)."""
    if count == 0:
        return Rate(0, 0, None, 0.0, 1.0)
    interval = binomtest(hits, count).proportion_ci(0.95, method="wilson")
    return Rate(hits, count, hits / count, float(interval.low), float(interval.high))


def rate(outcomes: Iterable[bool]) -> Rate:
    """Return the share of true outcomes."""
    found = list(outcomes)
    return wilson(sum(found), len(found))


@dataclass(frozen=True)
class EventRate:
    """Number of events in a time, with the rate and its upper bound."""

    events: int
    hours: float
    per_hour: float | None
    """Rate k/T [1/h]; None for zero time."""
    upper: float | None
    """One-sided upper 95 % bound [1/h]; None for zero time."""


def event_rate(events: int, hours: float) -> EventRate:
    """Return k/T and its bound χ²_0.95(2k + 2)/(2T), exact for a Poisson process (Garwood 1936).

    Args:
      events: k.
      hours: T [h].
    """
    if hours <= 0.0:
        return EventRate(events, 0.0, None, None)
    return EventRate(events, hours, events / hours, float(chi2.ppf(0.95, 2 * events + 2)) / (2.0 * hours))


def quantile(values: Iterable[float], share: float) -> float | None:
    """Return the linearly interpolated quantile of values, perhaps ∞, without NaN; None without any value."""
    found = np.array([value for value in values if not math.isnan(value)])
    if not len(found):
        return None
    above = float(np.quantile(found, share, method="higher"))
    if math.isinf(above):
        return above
    return float(np.quantile(np.minimum(found, above), share))  # linear interpolation needs finite numbers


def median(values: Iterable[float]) -> float | None:
    """Return the median; None without any value."""
    return quantile(values, 0.5)


@dataclass(frozen=True)
class Table:
    """Title, head and formatted cells of a table."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def format_rate(found: Rate) -> str:
    """Format a rate with its interval: `93 % (84–97, n 60)`."""
    if found.value is None:
        return "–"
    return f"{100 * found.value:.0f} % ({100 * found.low:.0f}–{100 * found.high:.0f}, n {found.count})"


def format_number(value: float | None) -> str:
    """Format a number with three digits; a dash for None."""
    return "–" if value is None else f"{value:.3g}"


def format_markdown(heading: str, lines: Sequence[str], tables: Sequence[Table]) -> str:
    """Format a Markdown file: heading, introductory lines, tables."""
    parts = [f"# {heading}", *lines]
    for table in tables:
        rows = [table.head, tuple("---" for _ in table.head), *table.rows]
        cells = "\n".join("| " + " | ".join(row) + " |" for row in rows)
        parts.append(f"## {table.title}\n\n{cells}")
    return "\n\n".join(parts) + "\n"
