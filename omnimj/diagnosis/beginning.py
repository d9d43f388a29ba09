"""Where a method begins in a log: often in the middle of a motion, where a controller starts at rest.

The methods take a machine that is switched on to be at rest. A log may begin, or go on after a gap, while it
drives; what the method believes of its velocity is then what the wheels say.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from omnimj.control.published.rig import PublishedRig
from omnimj.control.published.rig_residuals import BEFORE
from omnimj.control.robust import Robust, RobustState
from omnimj.control.robust.counters import GRIP
from omnimj.control.robust.evidence import no_evidence
from omnimj.control.standstill import REST_WHEEL_SPEED
from omnimj.parameters import Robot
from omnimj.physics import rig
from omnimj.physics.kinematics import rolling_matrix
from omnimj.signals import Array, Measurement

_DOUBT = 0.05
"""Standard deviation of a velocity that only wheels know, which may slip [m/s]."""


def begin(method: Any, machine: Any, measurement: Any, bias: float) -> Any:
    """The state before the first sample of a log, or of what comes after a long gap.

    Args:
      method: Any.
      machine: That it believes in.
      measurement: The first.
      bias: Of the gyro [rad/s].
    """
    state = method.start(measurement)
    if np.abs(measurement.wheel_speed).max() <= REST_WHEEL_SPEED:
        return state
    if isinstance(method, PublishedRig):
        observer = state.observer.copy()
        observer[rig.SPEED] = measurement.carriage_speed
        observer[rig.WHEEL_SPEED] = observer[BEFORE] = measurement.wheel_speed
        observer[rig.CURRENT] = measurement.current
        return dataclasses.replace(state, observer=observer)
    if isinstance(method, Robust):
        return _moving(state, machine, measurement, bias)
    return state


def go_on(method: Any, machine: Any, state: Any, measurement: Any, bias: float, is_long: bool) -> Any:
    """The state after a gap.

    The published methods know how much time has passed; after a long gap they begin anew. The robust method
    keeps what it has learnt and decided, since a gap repairs nothing; what reaches over the gap begins anew:
    sums, windows and velocities.

    Args:
      method: Any.
      machine: That it believes in.
      state: Before the gap.
      measurement: The first after it.
      bias: Of the gyro [rad/s].
      is_long: Whether the gap is too long to go on from.
    """
    if not isinstance(method, Robust):
        return begin(method, machine, measurement, bias) if is_long else state
    fresh, evidence, empty = method.start(measurement), state.evidence.copy(), no_evidence(method.wheels)
    evidence.counters[:, :GRIP] = empty.counters[:, :GRIP]
    evidence.heading[:] = empty.heading
    if is_long:
        evidence.cursor[:], evidence.found[:] = empty.cursor, empty.found
    after = dataclasses.replace(
        fresh,
        evidence=evidence,
        verdict=dataclasses.replace(state.verdict, suspected=math.nan),
        accepted=state.accepted,
        fresh=state.fresh,
        beliefs=state.beliefs,
        log=state.log,
        past=state.past,
    )
    return _moving(after, machine, measurement, bias)


def _moving(state: RobustState, robot: Robot, measurement: Measurement, bias: float) -> RobustState:
    """The body's velocity by the wheels: each filter without its own, none by a diagnosed one."""
    a, rolled = rolling_matrix(robot.wheel_positions, robot.rolling_directions), robot.wheel.radius
    said: Array = rolled * measurement.wheel_speed - a[:, 2] * (measurement.yaw_rate - bias)
    doubted = {w - 1 for d in state.diagnoses if d.cleared is None for w in d.wheels}
    n = len(said)
    evidence = state.evidence.copy()
    for q in range(n + 1):
        asked = [i for i in range(n) if i != q and i not in doubted]
        if np.linalg.matrix_rank(a[asked, :2]) < 2:
            asked = [i for i in range(n) if i != q]
        evidence.velocity[q, :2] = np.linalg.lstsq(a[asked, :2], said[asked], rcond=None)[0]
        evidence.spread[q, :2, :] = evidence.spread[q, :, :2] = 0.0
        evidence.spread[q, 0, 0] = evidence.spread[q, 1, 1] = _DOUBT**2
    return dataclasses.replace(state, evidence=evidence)
