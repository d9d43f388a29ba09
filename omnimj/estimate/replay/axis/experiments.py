"""Candidate experiments on a linear axis, and their simulation by the equations."""

from __future__ import annotations

import numpy as np

from omnimj.estimate.replay.interface import Experiment
from omnimj.parameters.axis import Axis
from omnimj.plant.axis import COLUMNS, follow_target, sensor_row, servo, substeps_of
from omnimj.signals import Array
from omnimj.simulate.suites.axis import MOVES, AxisMove

_SHORT, _LONG = 8.0, 60.0  # [s]
_LOAD = 0.3  # added mass over the axis' own: separates effects that scale with mass from those that do not


def axis_experiments(axis: Axis) -> tuple[Experiment, ...]:
    """Candidate experiments: every move of the test plan without and with added mass, and one long run."""
    found = []
    added = round(_LOAD * axis.axis.mass, 3)
    for move in MOVES:
        if move.payload_share:
            continue
        about = {"move": move.name, "duration": _SHORT, "added_mass": 0.0}
        found.append(Experiment(move.name, move.words, about))
        loaded = about | {"added_mass": added}
        found.append(Experiment(f"{move.name}, loaded", f"{move.words}, {added:g} kg put on", loaded))
    long = {"move": "long_strokes", "duration": _LONG, "added_mass": 0.0}
    words = f"long strokes at full speed for {_LONG:g} s"
    return (*found, Experiment("long_strokes, long", words, long))


def _move(name: object) -> AxisMove:
    return next(move for move in MOVES if move.name == name)


def drive(axis: Axis, row: Array, curve: Array, experiment: Experiment) -> tuple[Array, float]:
    """Simulate a candidate run without sensor noise, under a servo drive tuned to the declared axis.

    Args:
      axis: Declared axis, for which the servo drive is tuned.
      row: Simulated axis, shape (AXIS_ROW,).
      curve: Free curve, shape (CURVE_ROW,).
      experiment: One of `axis_experiments`.

    Returns:
      Columns of `plant.axis.follow_target`, shape (n, 6), and the sample period [s].
    """
    period = 1.0 / axis.sensors.sample_rate
    target = _move(experiment.run["move"]).target(axis, float(experiment.run["duration"]), period)
    columns, noise = np.zeros((len(target), COLUMNS)), np.zeros((3, len(target)))
    numbers = (servo(axis).row, sensor_row(axis, ideal=True), noise)
    follow_target(row, curve, target, *numbers, period, substeps_of(period), columns)
    return columns, period
