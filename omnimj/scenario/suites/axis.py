"""The linear axis' test plan as a suite."""

from __future__ import annotations

from collections.abc import Mapping

from omnimj.parameters.axis import Axis
from omnimj.scenario.axis_moves import MOVES, AxisMove, drive_move
from omnimj.scenario.suites.suite import Condition, Recording
from omnimj.signals import Array

_MEASURED = ("time", "force", "position")


def plan_moves(axis: Axis, seed: int) -> list[Condition]:
    """Every move of the plan; the mass is declared where it is not that of the model."""
    found = []
    for move in MOVES:
        mass = round(axis.axis.mass * (1.0 + move.payload_share), 6)
        found.append(Condition(move.name, {"mass": mass} if move.payload_share else {}, move))
    return found


def record_axis(axis: Axis, nominal: Axis, condition: Condition, how: Recording) -> Mapping[str, Array]:
    """One move under position control: the force of the drive and the position.

    Args:
      axis: With its effects.
      nominal: The controller believes in this one.
      condition: Its drive is an `AxisMove`.
      how: Its seed; there is but one plant.
    """
    move: AxisMove = condition.drive
    columns = drive_move(axis, move, how.seed, declared=nominal)
    if how.progress is not None:
        how.progress(1, 1)
    return {name: columns[name] for name in _MEASURED}
