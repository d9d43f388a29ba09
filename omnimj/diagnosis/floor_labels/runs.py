"""Recorded runs with the floor under each wheel over time, from currents and wheel speeds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.diagnosis.floor_labels.calibration import LabelCalibration, run_floor
from omnimj.diagnosis.floor_labels.currents import (
    FloorPlan,
    Labels,
    Windows,
    expected_currents,
    steady_windows,
)
from omnimj.diagnosis.floor_labels.edge import EdgeLine, SeenRun, contacts, misfits, place_line, true_labels
from omnimj.diagnosis.floor_labels.labelling import (
    Evidence,
    label_path,
    label_probabilities,
    neighbours,
)
from omnimj.diagnosis.floor_labels.scores import (
    SHIFTS,
    Crossing,
    EdgeScores,
    LabelledTruth,
    edge_scores,
    found_crossings,
    shifted,
    unchanged,
)
from omnimj.errors import InputError, UnknownNameError
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array

START_FLOORS = "start_floors"
"""Condition of a run: floors under its wheels at the start, with commas between them."""


@dataclass(frozen=True)
class LabelledRun:
    """Floor under each wheel over one run."""

    name: str
    start: tuple[int, ...] | None
    """Floors at the start, as indices; None if unknown."""
    time: Array
    """Windows' centres, shape (w,) [s]."""
    labels: Labels
    """Index of the most probable floor under each wheel, shape (w, n)."""
    probability: Array
    """Probability of each floor under each wheel, shape (w, n, floors)."""
    distance: Array | None = None
    """Distance of each contact beyond the line that the camera sees, shape (w, n) [m]; None without line."""

    @property
    def crossings(self) -> list[Crossing]:
        """Wheels that change their floor, one before the first window included, in order of time."""
        found = found_crossings(self.time, self.labels)
        if self.start is None or not len(self.time):
            return found
        first = [
            Crossing(float(self.time[0]), i + 1, int(label))
            for i, label in enumerate(self.labels[0])
            if label != self.start[i]
        ]
        return first + found

    @property
    def truth(self) -> LabelledTruth:
        """Labels beside the camera's distances, of windows with a pose.

        Raises:
          InputError: There is no line.
        """
        if self.distance is None:
            raise InputError(f"run {self.name!r}", "has no distances", "an edge line is needed")
        seen = np.isfinite(self.distance).all(axis=1)
        return LabelledTruth(self.time[seen], self.labels[seen], self.distance[seen])


def start_labels(plan: FloorPlan, dataset: Dataset, run: Run, line: EdgeLine | None) -> tuple[int, ...]:
    """Floors under the wheels at the start: `start_floors`, or the camera's line, or the run's floor.

    Args:
      plan: Robot and floors.
      dataset: Dataset of the run, for messages.
      run: The run.
      line: Line between the first and the second floor; None without camera.

    Raises:
      InputError: `start_floors` has not one floor for each wheel.
      UnknownNameError: A floor is none of the plan's.
    """
    n, names = plan.robot.wheel_count, [floor.name for floor in plan.floors]
    text = run.conditions.get(START_FLOORS)
    if text is not None:
        place = f"{dataset.path}: run {run.name!r}: {START_FLOORS}"
        found = [name.strip() for name in str(text).split(",")]
        for name in found:
            if name not in names:
                raise UnknownNameError(place, "floor label", name, names)
        if len(found) != n:
            raise InputError(place, f"found {len(found)} floors", f"one for each of {n} wheels is needed")
        return tuple(names.index(name) for name in found)
    if line is not None:
        seen = line.beyond(contacts(run, plan.robot, run.time[:1]))[0]
        if np.isfinite(seen).all():
            return tuple(true_labels(seen).tolist())
    return (names.index(run_floor(plan, dataset, run)),) * n


@dataclass(frozen=True)
class PreparedRun:
    """Windows of a run and the currents of every assignment, which no decision changes."""

    run: Run
    windows: Windows
    expected: Array
    """Shape (assignments, w, n) [A]."""


def prepare_runs(
    plan: FloorPlan, dataset: Dataset, progress: Callable[[int, int, str], None] | None = None
) -> list[PreparedRun]:
    """Windows and expected currents of all runs."""
    found = []
    for k, run in enumerate(dataset.runs):
        if progress is not None:
            progress(k, len(dataset.runs), run.name)
        windows = steady_windows(run, plan.robot.wheel.radius, plan.robot.wheel_count)
        found.append(PreparedRun(run, windows, expected_currents(plan, windows.wheel_speed)))
    return found


def label_run(
    plan: FloorPlan, made: PreparedRun, calibration: LabelCalibration, start: tuple[int, ...] | None
) -> LabelledRun:
    """Most probable floor under each wheel of one run, and the probability of every floor.

    Args:
      plan: Robot and floors.
      made: The run.
      calibration: Noise and price of a crossing.
      start: Floors at the start; None if unknown.
    """
    evidence = Evidence(made.windows.current, made.expected, calibration.noise)
    one_wheel = neighbours(plan.assignments)
    first = None if start is None else plan.index(start)
    path = label_path(evidence, one_wheel, first, calibration.price)
    shares = label_probabilities(evidence, one_wheel, first, calibration.price)
    floors = np.arange(len(plan.floors))
    stands = plan.assignments[:, :, None] == floors  # (assignments, n, floors)
    probability = np.einsum("wa,anf->wnf", shares, stands.astype(float))
    return LabelledRun(made.run.name, start, made.windows.time, plan.assignments[path.index], probability)


def label_runs(
    plan: FloorPlan,
    dataset: Dataset,
    prepared: Sequence[PreparedRun],
    calibration: LabelCalibration,
    lines: Mapping[str, EdgeLine],
) -> Iterator[LabelledRun]:
    """Label all runs of a dataset.

    Args:
      plan: Robot and floors.
      dataset: The runs.
      prepared: Result of `prepare_runs`.
      calibration: Noise and price of a crossing.
      lines: Line between the first two floors by name of the run; runs without it are labelled without
        camera.

    Raises:
      InputError: `start_floors` of a run breaks a rule.
      UnknownNameError: A floor of a run is none of the plan's.
    """
    for made in prepared:
        line = lines.get(made.run.name)
        found = label_run(plan, made, calibration, start_labels(plan, dataset, made.run, line))
        if line is None:
            yield found
        else:
            seen = line.beyond(contacts(made.run, plan.robot, found.time))
            yield LabelledRun(found.name, found.start, found.time, found.labels, found.probability, seen)


def lines_of_other_half(
    plan: FloorPlan, prepared: Sequence[PreparedRun], calibration: LabelCalibration
) -> dict[str, EdgeLine]:
    """Line of each run, placed by currents and camera of every second other run.

    Args:
      plan: Robot and two floors.
      prepared: Result of `prepare_runs`.
      calibration: Noise of the currents.

    Raises:
      InputError: There are less than two runs or more than two floors, or no line explains the currents.
    """
    if len(plan.floors) != 2:
        raise InputError(
            "--edge-line", f"found {len(plan.floors)} floors", "an edge line separates exactly two floors"
        )
    scatter = float(np.hypot(calibration.noise.white, calibration.noise.bias))
    seen = [_seen(plan, made, scatter) for made in prepared]
    if min(sum(len(run.contact) for run in seen[k::2]) for k in (0, 1)) == 0:
        found = f"found {len(prepared)} runs"
        rule = "steady driving in each half of the runs places the line of the other"
        raise InputError("--edge-line auto", found, rule)
    halves = [place_line(seen[k::2]) for k in (0, 1)]
    return {made.run.name: halves[1 - k % 2] for k, made in enumerate(prepared)}


def _seen(plan: FloorPlan, made: PreparedRun, scatter: float) -> SeenRun:
    contact = contacts(made.run, plan.robot, made.windows.time)
    known = np.isfinite(contact).all(axis=(1, 2))
    misfit = misfits(made.windows.current, made.expected, scatter)
    return SeenRun(contact[known], misfit[:, known])


@dataclass(frozen=True)
class ScoreBoard:
    """Scores of labelled runs beside chance."""

    own: EdgeScores
    shifted: Mapping[float, EdgeScores]
    """The same labels on truth shifted in time, by the shift in lengths of a run."""
    no_change: EdgeScores
    """The labels of the start throughout."""


def score_board(runs: Sequence[LabelledRun]) -> ScoreBoard:
    """Scores of runs with a line, and the same rules on other truths and on "no change"."""
    truths = [run.truth for run in runs]
    starts = [
        run.start or tuple(true_labels(truth.distance[0])) for run, truth in zip(runs, truths, strict=True)
    ]
    return ScoreBoard(
        edge_scores(truths),
        {share: edge_scores([shifted(truth, share) for truth in truths]) for share in SHIFTS},
        edge_scores([unchanged(truth, start) for truth, start in zip(truths, starts, strict=True)]),
    )
