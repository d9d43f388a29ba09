"""Creep of the wheels."""

from __future__ import annotations

from collections.abc import Sequence

from omnimj.estimate.robot.blocks import RunRows
from omnimj.estimate.robot.fit import RobotFit
from omnimj.estimate.robot.records import FloorCreep


def identify_creep(fit: RobotFit, rows: Sequence[RunRows]) -> tuple[tuple[FloorCreep, ...], tuple[str, ...]]:
    """Creep."""
    return (), ()
