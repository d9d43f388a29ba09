"""The machine as a person sees it, moving as it moved in a run.

The twin steps a lean model without the geoms that are only seen; both models have the same joints in the
same order, so poses of one are poses of the other.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnimj.parameters import Rig
from omnimj.parameters.floor import find_floor
from omnimj.scenario.scenario import RigDrive, Scenario
from omnimj.signals import Trace
from omnimj.twin.assembly import rig_model, robot_model
from omnimj.view.scene3d import Poses, poses_from_trace

Array = NDArray[np.float64]


def visible_model(scenario: Scenario) -> mujoco.MjModel:
    """The scenario's machine on its floor, with all that is only seen."""
    floor = find_floor(scenario.floor, scenario.name)
    if isinstance(scenario.constants, Rig):
        mass = scenario.drive.mass if isinstance(scenario.drive, RigDrive) else None
        return rig_model(scenario.constants, floor, mass, patches=scenario.patches)
    return robot_model(scenario.constants, floor, scenario.patches, scene=scenario.scene)


def visible_poses(
    scenario: Scenario, trace: Trace, time: Array | None = None, qpos: Array | None = None
) -> Poses | None:
    """Poses of a run for recording and picture.

    Args:
      scenario: What was driven.
      trace: A robot that recorded no poses (planar model) follows `x`, `y`, `heading` and its wheel speeds.
      time: Of the recorded poses, shape (k,) [s].
      qpos: The recorded poses, shape (k, nq).

    Returns:
      None where nobody knows how the machine moved.

    Raises:
      ValueError: The poses are not those of the scenario's machine.
    """
    if time is None or qpos is None:
        known = {"x", "y", "heading", "wheel_speed_1"} <= set(trace.columns)
        return poses_from_trace(visible_model(scenario), trace) if known else None
    mj_model = visible_model(scenario)
    if qpos.shape != (len(time), mj_model.nq):
        raise ValueError(f"poses have shape {qpos.shape}, the machine has {mj_model.nq} coordinates")
    return Poses(mj_model, time, qpos)
