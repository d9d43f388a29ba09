"""Topics of different rates and stamps on one time base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.errors import InputError
from omnimj.recording.importing.topics.series import NO_STAMP, Samples
from omnimj.signals import Array

LONGEST_GAP = 5.0
"""Gap between two messages, in usual steps of their topic, that a straight line may bridge."""
_SAME_CLOCK = 1.0  # [s] of difference between two clocks that are one, with delays of transport
_NANO = 1e-9

Times = NDArray[np.int64]
JOINS = ("linear", "previous")
"""Rules for values between two messages: straight line, or the value of the message before."""
STAMPS = ("header", "log")
"""Clocks: the stamp that the sender wrote into the message, or the time at which it was logged."""


@dataclass(frozen=True)
class Clock:
    """Stamps of one topic, and how far its header stamps lie before the times of logging."""

    use: str
    """`header` or `log`; empty if the topic cannot be joined."""
    why: str = ""
    """Why not the header stamps, or why not at all."""


def header_problem(samples: Samples) -> str:
    """Reason why header stamps cannot be used; empty if they can."""
    stamps = samples.stamps[_order(samples.logged)]
    missing = int(np.count_nonzero(stamps == NO_STAMP))
    if missing == len(stamps):
        return "no header stamps"
    if missing:
        return f"{missing} of {len(stamps)} messages have no valid header stamp"
    back = int(np.count_nonzero(np.diff(stamps) < 0))
    if back:
        return f"header stamps run backwards {back} times" if back > 1 else "header stamps run backwards once"
    if len(stamps) > 1 and stamps[0] == stamps[-1]:
        return "header stamps do not change"
    return ""


def header_delay(samples: Samples) -> float:
    """Median of the time of logging minus the header stamp [s]."""
    return float(np.median(samples.logged - samples.stamps)) * _NANO


def choose_clocks(
    place: object, topics: Mapping[str, list[Samples]], base: str, forced: str | None
) -> dict[str, Clock]:
    """Choose header stamps or times of logging, by topic, so that all times are of one clock.

    Header stamps are used where the base has usable ones. Another topic then has its own header stamps where
    they are of the same clock; else the times at which it was logged, if header stamps and logging agree to a
    second; else it cannot be joined.

    Raises:
      InputError: Header stamps are requested and those of the base cannot be used.
    """
    problems = {name: _first_problem(samples) for name, samples in topics.items()}
    if forced == "header" and problems[base]:
        raise InputError(place, f"topic {base} has {problems[base]}", 'stamps = "log" takes the log times')
    if forced == "log" or problems[base]:
        why = "" if forced == "log" else problems[base]
        return {name: Clock("log", problems[name] or (why and f"as {base}")) for name in topics}
    delay = header_delay(topics[base][0])
    clocks = {}
    for name, samples in topics.items():
        problem = problems[name]
        if not problem and abs(header_delay(samples[0]) - delay) > _SAME_CLOCK:
            problem = f"header stamps of another clock than {base}"
        if not problem:
            clocks[name] = Clock("header")
        elif abs(delay) <= _SAME_CLOCK:
            clocks[name] = Clock("log", problem)
        else:
            words = f"{problem}, and log times are {delay:.6g} s after the header stamps of {base}"
            clocks[name] = Clock("", words)
    return clocks


def _first_problem(samples: list[Samples]) -> str:
    return next((problem for one in samples if (problem := header_problem(one))), "")


def _order(times: Times) -> Times | slice:
    """Order of times; messages of an MCAP file need not be in it."""
    return slice(None) if bool(np.all(np.diff(times) >= 0)) else np.argsort(times, kind="stable")


@dataclass(frozen=True)
class Track:
    """One column of a topic, at strictly increasing times."""

    times: Times
    """Shape (n,) [ns]."""
    values: Array
    """Shape (n,)."""


def make_times(samples: Samples, use: str) -> tuple[Times, NDArray[np.int64] | slice]:
    """Strictly increasing times of samples, and the rows that they belong to; of equal times the last counts.

    Args:
      samples: The samples.
      use: `header` for the stamps of the headers, else the times of logging.

    Returns:
      Times, shape (m,) [ns], and their rows among the samples, shape (m,).
    """
    times = samples.stamps if use == "header" else samples.logged
    rows = _order(times)
    ordered = times[rows]
    last = np.concatenate((np.diff(ordered) > 0, [True]))
    if bool(np.all(last)):
        return ordered, rows
    chosen = np.flatnonzero(last) if isinstance(rows, slice) else rows[last]
    return times[chosen], chosen


def merged(tracks: list[Track]) -> Track:
    """One track of several, as a topic has whose messages do not always have the same fields."""
    if len(tracks) == 1:
        return tracks[0]
    times = np.concatenate([one.times for one in tracks])
    values = np.concatenate([one.values for one in tracks])
    rows = np.argsort(times, kind="stable")
    last = np.concatenate((np.diff(times[rows]) > 0, [True]))
    return Track(times[rows][last], values[rows][last])


def values_at(track: Track, rows: Times, rule: str) -> Array:
    """Values of a track at the times of the rows.

    `linear`: on the straight line between the messages around the row, empty (NaN) before the first and after
    the last one and in gaps of more than `LONGEST_GAP` usual steps. `previous`: that of the last message,
    empty before the first one. A message at the time of a row counts as it is under both.

    Args:
      track: Column of a topic.
      rows: Times of the rows, strictly increasing, shape (m,) [ns].
      rule: `linear` or `previous`.

    Returns:
      Values, shape (m,).
    """
    times, values = track.times, track.values
    if len(times) == len(rows) and bool(np.all(times == rows)):
        return values
    before = np.searchsorted(times, rows, side="right") - 1
    held = values[np.maximum(before, 0)]
    if rule == "previous":
        return np.where(before >= 0, held, np.nan)
    found = np.full(len(rows), np.nan)
    exact = (before >= 0) & (times[np.maximum(before, 0)] == rows)
    found[exact] = held[exact]
    inside = np.flatnonzero(~exact & (before >= 0) & (before < len(times) - 1))
    if len(inside):
        left = before[inside]
        steps = np.diff(times)
        width = steps[left]
        share = (rows[inside] - times[left]) / width
        line = values[left] + (values[left + 1] - values[left]) * share
        found[inside] = np.where(width <= LONGEST_GAP * np.median(steps), line, np.nan)
    return found


@dataclass(frozen=True)
class TopicChoice:
    """Rules by which messages become rows; `[topics]` of a mapping file."""

    base: str | None = None
    """Topic whose stamps are the rows; chosen when None."""
    join: str = JOINS[0]
    """One of `JOINS`; whole numbers, switches and set values hold their last value under either."""
    stamps: str | None = None
    """One of `STAMPS`; when None, header stamps where every joined topic has usable ones."""


@dataclass(frozen=True)
class TopicSummary:
    """One topic of a file, as the preview shows it."""

    name: str
    type_name: str
    messages: int
    rate: float
    """Messages per second by the median step; 0 with fewer than two."""
    stamps: str
    """Which stamps are used, and why not the others, in words."""
    joined: str
    """Description of how its values come to the rows."""
