"""Logs of the linear axis along its test plan, with or without current and tachometer."""

from omnimj.parameters import Axis
from omnimj.recording.dataset import Run
from omnimj.simulate.suites.axis import DURATION, MOVES, drive_move


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
    """Drive every move of the plan repeatedly and return the runs as a logger would record them.

    Args:
      axis: True axis, with its effects.
      seed: Seed of the sensor noise; each run derives its own.
      repeats: Runs per move.
      duration: Duration of one run [s].
      current: Whether the log has `current` instead of `force`.
      velocity: Whether the axis has a tachometer.
      declared: Axis of the model file, assumed by controller and log; `axis` without effects when None.

    Returns:
      Runs with `repeat_of` set; the mass is declared where it differs from that of the model.
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
