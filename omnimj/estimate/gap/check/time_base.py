"""Time base of the runs: the logged period, the model's, and the period at which motion and its rates agree.

A rate x and its integral y give the true time per logged one, y = τ ∫ x dt: τ = 1 if time is in seconds,
whatever the sampling rate. Another rate than the model's is no fault; a rate whose integrals disagree is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from omnimj.estimate.gap.check.suspicions import GROSS, SURE_STRENGTH, Suspicion
from omnimj.recording.dataset import Run

UNITS = (
    (1e3, "in milliseconds"),
    (1e6, "in microseconds"),
    (1e9, "in nanoseconds"),
    (1.0 / 60.0, "in minutes"),
    (1.0 / 3600.0, "in hours"),
)
"""Factors by which time is too large when it is logged in another unit."""
_SAME = np.log(1.25)  # permitted |log| between a period and the model's, and between two rates of time
_TOLERANT = np.log(1.5)  # permitted |log| of τ where it follows from a mass, or from wheels that slip
_NEAR = np.log(1.5)  # |log| distance from a known factor
_ROUND = np.log(1.02)  # |log| distance of a period from a known factor where nothing else tells
_SLOWEST = 55.0  # periods of the model: datasets are to have 20 samples per second or more, of 1000
_UNDECIDED = 1.5  # strength where only the period tells


@dataclass(frozen=True)
class TimeLink:
    """Rate and integral measured by different channels."""

    channels: tuple[str, str]
    factor: float
    """τ, true time per logged time."""
    order: int = 1
    """Power of τ that is measured: a force goes with the second derivative."""


Links = Callable[[Sequence[Run]], list[TimeLink]]
"""Runs → their links of rates and integrals that are clear."""


def has_period(runs: Sequence[Run], rate: float) -> bool:
    """True if time increases and the period is about that of the model in all runs."""
    return all(
        float(np.diff(run.time).min()) > 0.0 and abs(np.log(_period(run) * rate)) < _SAME for run in runs
    )


def time_base_suspicions(runs: Sequence[Run], rate: float, links: Links) -> Iterator[Suspicion]:
    """Yield runs whose time is in another unit, scaled, or does not increase.

    Args:
      rate: Sampling rate of the model [1/s].
    """
    good = []
    for run in runs:
        late = np.flatnonzero(np.diff(run.time) <= 0.0)
        if late.size:
            k = int(late[0]) + 1
            words = f"time does not increase at sample {k} of {run.name}: {run.time[k]:.6g} after "
            words += f"{run.time[k - 1]:.6g} s"
            strength = 2.0 * SURE_STRENGTH
            yield Suspicion("time", "time_base", float(late.size), strength, words, (), (run.name,))
        else:
            good.append(run)
    groups = _by_period(good)
    for group in groups:
        names = tuple(run.name for run in group) if len(groups) > 1 or len(good) < len(runs) else ()
        found = _of_group(group, rate, links)
        if found is not None:
            yield replace(found, runs=names)


def _period(run: Run) -> float:
    return max(float(np.median(np.diff(run.time))), 1e-300)


def _by_period(runs: Sequence[Run]) -> list[list[Run]]:
    """Group runs of about the same period."""
    groups: list[list[Run]] = []
    for run in sorted(runs, key=_period):
        if groups and np.log(_period(run) / _period(groups[-1][0])) < np.log(2.0):
            groups[-1].append(run)
        else:
            groups.append([run])
    return groups


def _of_group(runs: Sequence[Run], rate: float, links: Links) -> Suspicion | None:
    """Judge runs of one period."""
    periods = float(np.median([_period(run) for run in runs])) * rate
    as_logged = links(runs)
    if any(abs(np.log(link.factor)) < _TOLERANT for link in as_logged):
        return None  # wrong time would spoil every link
    if abs(np.log(periods)) < _SAME:
        agreed = _agreed(as_logged)
        if agreed is None or abs(np.log(agreed)) < _TOLERANT or not _are_independent(as_logged):
            return None
        return _named(1.0 / agreed, periods, rate, as_logged)
    # windows and delays in samples of the model: as logged they may be far too long or too short
    scaled = links([_with_time(run, 1.0 / periods) for run in runs])
    agreed = _agreed(scaled)
    if agreed is None:
        return _by_period_alone(periods, rate)
    factor = periods / agreed
    fits = abs(np.log(agreed)) < _TOLERANT or (_unit(factor)[1] and 1.0 / _SLOWEST < agreed < _SLOWEST)
    if abs(np.log(factor)) < _TOLERANT:
        return None
    if _are_independent(scaled) or (fits and abs(np.log(factor)) > GROSS):
        return _named(factor, periods, rate, scaled)
    return None


def _agreed(links: Sequence[TimeLink]) -> float | None:
    """τ on which all links agree."""
    logs = [np.log(link.factor) for link in links]
    if not logs or max(logs) - min(logs) > _TOLERANT:
        return None
    return float(np.exp(np.median(logs)))


def _are_independent(links: Sequence[TimeLink]) -> bool:
    """True if no single channel explains all contradictions."""
    if len({link.order for link in links}) > 1:
        return True  # one wrong scale would give them different factors
    return len(links) > 1 and not set.intersection(*(set(link.channels) for link in links))


def _unit(factor: float) -> tuple[float, str]:
    near, words = min(UNITS, key=lambda unit: abs(np.log(factor / unit[0])))
    return (near, words) if abs(np.log(factor / near)) < _NEAR else (factor, "")


def _named(factor: float, periods: float, rate: float, links: Sequence[TimeLink]) -> Suspicion:
    """State the factor: that of a unit, that of the model's period, or the estimated one."""
    size, unit = _unit(factor)
    if not unit and abs(np.log(factor / periods)) < _NEAR:
        size = periods
    size = round(size, 6) if size >= 1.0 else size
    judged = " and of ".join(f"{x} with {y}" for x, y in [link.channels for link in links[:2]])
    what = f"time is {unit}, {size:.4g} times too large" if unit else f"time is {size:.4g} times too large"
    if size < 1.0:
        what = what.replace(f"{size:.4g} times too large", f"{1.0 / size:.4g} times too small")
    words = f"{what}, judged by the change of {judged}; its period is {periods / rate:.4g} s"
    words += f", the model's {1.0 / rate:.4g} s"
    strength = SURE_STRENGTH * max(abs(np.log(factor)) / GROSS, 1.0)
    return Suspicion("time", "time_base", float(size), float(strength), words)


def _by_period_alone(periods: float, rate: float) -> Suspicion | None:
    """Judge a period where no motion can confirm it."""
    if abs(np.log(periods)) < GROSS:
        return None
    size, unit = _unit(periods)
    is_round = bool(unit) and abs(np.log(periods / size)) < _ROUND
    strength = SURE_STRENGTH if is_round or not 1.0 / _SLOWEST < periods < _SLOWEST else _UNDECIDED
    words = f"the period is {periods / rate:.4g} s, {periods:.4g} times the model's {1.0 / rate:.4g} s"
    words += f": time may be {unit}" if unit else ""
    words += ", and no motion in these runs confirms it"
    return Suspicion("time", "time_base", float(size), strength, words)


def _with_time(run: Run, factor: float) -> Run:
    return replace(run, columns={**run.columns, "time": run.time * factor})


def corrected_time(runs: Sequence[Run], found: Suspicion) -> tuple[Run, ...]:
    """Divide the time of the runs of a suspicion by its size; a time that does not increase stays."""
    chosen = found.runs or tuple(run.name for run in runs)
    return tuple(
        _with_time(run, 1.0 / found.size)
        if run.name in chosen and float(np.diff(run.time).min()) > 0.0
        else run
        for run in runs
    )
