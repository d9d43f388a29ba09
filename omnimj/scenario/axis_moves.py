"""Test plan of the linear axis: closed-loop moves that excite what an axis may have, as measured runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from omnimj.parameters.axis import Axis
from omnimj.plant.axis import drive_axis, servo
from omnimj.recording.dataset import Run
from omnimj.scenario.axis_targets import highest_acceleration, highest_speed, strokes, sweep, wander
from omnimj.signals import Array

PAYLOAD_SHARE = 0.1
"""Mass that is put on for one move, over the axis' own."""


@dataclass(frozen=True)
class AxisMove:
    """One condition of the plan."""

    name: str
    words: str
    target: Callable[[Axis, float, float], Array]
    """Path out of axis, duration and period, shape (n, 3)."""
    payload_share: float = 0.0
    """Added mass, declared in the log, over the axis' own."""


def _strokes(reach: float, speeds: tuple[float, ...], pull: float) -> Callable[[Axis, float, float], Array]:
    def target(axis: Axis, duration: float, period: float) -> Array:
        top = highest_speed(axis)
        chosen, acceleration = [s * top for s in speeds], pull * highest_acceleration(axis)
        return strokes(reach * axis.axis.travel, chosen, acceleration, duration, period)

    return target


def _sweep(axis: Axis, duration: float, period: float) -> Array:
    top = highest_speed(axis)
    return sweep(0.3 * axis.axis.travel, 0.3, 3.0, 0.25 * top, duration, period)


def _wander(axis: Axis, duration: float, period: float) -> Array:
    return wander(0.8 * axis.axis.travel, 0.8 * highest_speed(axis), duration, period)


MOVES: tuple[AxisMove, ...] = (
    AxisMove("long_strokes", "long strokes at full speed", _strokes(0.9, (1.0,), 0.8)),
    AxisMove("speed_ladder", "strokes at four speeds", _strokes(0.35, (1.0, 0.6, 0.3, 0.15), 0.6)),
    AxisMove("short_strokes", "short strokes with many reversals", _strokes(0.2, (0.6,), 1.0)),
    AxisMove("slow_crawl", "slow crawl in both directions", _strokes(0.1, (0.05, 0.1, 0.2), 0.1)),
    AxisMove("sweep", "a sine of rising frequency", _sweep),
    AxisMove("wander", "an irregular path", _wander),
    AxisMove("with_payload", "strokes with known mass on it", _strokes(0.7, (0.8, 0.4), 0.7), PAYLOAD_SHARE),
)
"""The plan; each move is a condition of its own."""

DURATION = 12.0
"""Of one run [s]."""


def drive_move(
    axis: Axis, move: AxisMove, seed: int, duration: float = DURATION, declared: Axis | None = None
) -> dict[str, Array]:
    """Columns of one move, see `omnimj.plant.axis.drive_axis` and `axis_moves`."""
    known = axis if declared is None else declared
    path = move.target(known, duration, 1.0 / axis.sensors.sample_rate)
    return drive_axis(axis, path, servo(known), payload=move.payload_share * known.axis.mass, seed=seed)


def axis_moves(
    axis: Axis,
    seed: int = 0,
    repeats: int = 2,
    *,
    duration: float = DURATION,
    current: bool = False,
    velocity: bool = False,
    declared: Axis | None = None,
) -> list[Run]:
    """Every move of the plan, repeated, as a logger would have it.

    Args:
      axis: As it is, with its effects.
      seed: Of the sensors' noise; each run has a seed of its own.
      repeats: Runs per move.
      duration: Of one run [s].
      current: Whether the log has `current` instead of `force`.
      velocity: Whether the axis has a tachometer.
      declared: As its model file has it: what controller and log go by; `axis` without effects when None.

    Returns:
      Runs with `repeat_of` set; the mass is declared where it is not that of the model.
    """
    known = axis if declared is None else declared
    runs = []
    for m, move in enumerate(MOVES):
        for r in range(repeats):
            found = drive_move(axis, move, (seed * 1000 + m) * 100 + r, duration, declared)
            columns = {"time": found["time"]}
            if current:
                columns["current"] = found["force"] / known.axis.force_constant
            else:
                columns["force"] = found["force"]
            columns["position"] = found["position"]
            if velocity:
                columns["velocity"] = found["velocity"]
            mass = known.axis.mass * (1.0 + move.payload_share)
            conditions: dict[str, float | str] = {"mass": mass} if move.payload_share else {}
            runs.append(Run(f"{move.name}_{r + 1}", columns, {}, conditions, move.name))
    return runs
