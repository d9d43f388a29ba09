"""Scores of labelled runs: crossings found, accuracy, delays; the same rules on other truths as chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from omnimj.diagnosis.floor_labels.currents import Labels
from omnimj.diagnosis.floor_labels.edge import BAND, true_labels
from omnimj.signals import Array

SOON = 1.0
"""Largest distance in time of a found crossing from the true one that counts as on time [s]."""
NEAR = 3.0
"""Largest distance in time at which a crossing counts as found [s]."""
SHIFTS = (-0.5, -0.25, 0.25, 0.5)
"""Shifts of the truth in time for chance, in lengths of a run."""


class Crossing(NamedTuple):
    """A wheel that changes its floor."""

    time: float
    """[s]"""
    wheel: int
    """Number of the wheel, from 1."""
    floor: int
    """Index of the floor that it comes upon."""


class TrueCrossing(NamedTuple):
    """A wheel whose contact crosses the line for good, from one side of the band to the other."""

    first: float
    """Time at which the contact enters the band about the line [s]."""
    last: float
    """Time at which it leaves the band [s]."""
    wheel: int
    floor: int


@dataclass(frozen=True)
class LabelledTruth:
    """Labels by the currents beside where the camera sees the contacts, for one run."""

    time: Array
    """Windows' centres, shape (w,) [s]."""
    labels: Labels
    """Floor under each wheel by the currents, 0 or 1, shape (w, n)."""
    distance: Array
    """Distance of the contacts beyond the line, shape (w, n) [m]."""


@dataclass(frozen=True)
class EdgeScores:
    """Scores of several runs."""

    runs: int
    crossings: int
    """True crossings."""
    found: int
    """True crossings with a found one of the same wheel and floor within `NEAR`."""
    on_time: int
    """Number of these within `SOON`."""
    false: int
    """Found crossings that belong to no true one, and not to a wheel within the band."""
    labels: int
    """Labels outside of the band."""
    right: int
    """Number of these that agree."""

    @property
    def share_found(self) -> float:
        """Share of the true crossings that were found."""
        return self.found / self.crossings if self.crossings else float("nan")

    @property
    def share_found_on_time(self) -> float:
        """Share of the true crossings that were found on time."""
        return self.on_time / self.crossings if self.crossings else float("nan")

    @property
    def share_on_time(self) -> float:
        """Share of the found crossings that are on time."""
        return self.on_time / self.found if self.found else float("nan")

    @property
    def accuracy(self) -> float:
        """Share of right labels."""
        return self.right / self.labels if self.labels else float("nan")


def found_crossings(time: Array, labels: Labels) -> list[Crossing]:
    """Changes of labels, each midway between two windows.

    Args:
      time: Windows' centres, shape (w,) [s].
      labels: Floor under each wheel, shape (w, n).
    """
    rows, wheels = np.nonzero(labels[1:] != labels[:-1])
    return [
        Crossing(float(0.5 * (time[k] + time[k + 1])), int(i) + 1, int(labels[k + 1, i]))
        for k, i in zip(rows, wheels, strict=True)
    ]


def true_crossings(time: Array, distance: Array, band: float = BAND) -> list[TrueCrossing]:
    """Contacts that pass from beyond one side of the band to beyond the other.

    Args:
      time: Times, shape (w,) [s].
      distance: Distance of the contacts beyond the line, shape (w, n) [m].
      band: Half-width of the band in which nothing is known [m].
    """
    found = []
    for i in range(distance.shape[1]):
        clear = np.flatnonzero(np.abs(distance[:, i]) > band)
        sides = distance[clear, i] > 0.0
        for k in np.flatnonzero(sides[1:] != sides[:-1]):
            first, last = time[clear[k]], time[clear[k + 1]]
            found.append(TrueCrossing(float(first), float(last), i + 1, int(sides[k + 1])))
    return sorted(found)


def edge_scores(runs: Sequence[LabelledTruth]) -> EdgeScores:
    """Scores of all runs together.

    A found crossing is right if it has the wheel and the floor of a true one that nothing else took, and lies
    within `NEAR` of the time in which the contact is within the band; it is on time within `SOON`.
    """
    total = np.zeros(6, int)
    for run in runs:
        total += _scores_of(run)
    return EdgeScores(len(runs), *total.tolist())


def _scores_of(run: LabelledTruth) -> tuple[int, int, int, int, int, int]:
    if not len(run.time):
        return 0, 0, 0, 0, 0, 0
    true, open_ = true_crossings(run.time, run.distance), found_crossings(run.time, run.labels)
    many, hits, soon = len(true), 0, 0
    for one in true:
        late = [(_apart(made, one), made) for made in open_ if made[1:] == (one.wheel, one.floor)]
        if late and min(late)[0] <= NEAR:
            hits, soon = hits + 1, soon + (min(late)[0] <= SOON)
            open_.remove(min(late)[1])
    false = sum(not _within_band(run, made) for made in open_)
    clear = np.abs(run.distance) > BAND
    agree = (run.labels == true_labels(run.distance)) & clear
    return many, hits, soon, false, int(clear.sum()), int(agree.sum())


def _apart(made: Crossing, one: TrueCrossing) -> float:
    """Distance in time of a found crossing from the time in the band [s]."""
    return max(one.first - made.time, made.time - one.last, 0.0)


def _within_band(run: LabelledTruth, made: Crossing) -> bool:
    k = int(np.argmin(np.abs(run.time - made.time)))
    return bool(abs(run.distance[k, made.wheel - 1]) <= BAND)


def shifted(run: LabelledTruth, share: float) -> LabelledTruth:
    """The run with its truth shifted in time by a share of its length; the ends hold."""
    rows = np.arange(len(run.time)) - round(share * len(run.time))
    return LabelledTruth(run.time, run.labels, run.distance[np.clip(rows, 0, len(rows) - 1)])


def unchanged(run: LabelledTruth, start: Sequence[int]) -> LabelledTruth:
    """The run with the labels of its start throughout: "no change"."""
    return LabelledTruth(run.time, np.tile(np.array(start), (len(run.time), 1)), run.distance)
