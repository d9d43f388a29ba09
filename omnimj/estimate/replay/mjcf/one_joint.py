"""Rigid-body force and free windows of a machine with a single joint, without MuJoCo in the loop.

About a fixed axis the rigid bodies need the force
  R(q, q̈) = I q̈ + c + s sin q + k cos q       (s = k = 0 for a slide),
whose four numbers follow from MuJoCo's inverse dynamics. Where they do not hold (a fluid, a spring of a
tendon), there are none, and `kernels.free_windows` serves. The steps are those of `free_windows`. Dry
friction needs no iteration here: it is the force within its bounds that comes closest to stopping the joint
in the step.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from omnimj.estimate.replay.mjcf.kernels import (
    ARMATURE,
    COMPLIANCE,
    SPRING,
    SPRING_REST,
    dry_friction,
    pushing_force,
)
from omnimj.estimate.replay.stretches import FIRST, FIRST_BLOCK, LAST
from omnimj.physics.native import kernel
from omnimj.signals import Array

_EXACT = 1e-9  # relative error of R above which it has another form
_TRIALS = ((0.7, 2.0, -3.0), (-1.3, -5.0, 4.0), (2.2, 1.0, 1.0))  # position, speed and acceleration


class OneJoint(NamedTuple):
    """Rigid-body force R of a single joint, without friction, springs and armature."""

    inertia: float
    """I [kg or kg.m2]."""
    constant: float
    """c [N or N.m]."""
    sine: float
    """s [N.m]."""
    cosine: float
    """k [N.m]."""

    def force(self, position: Array, acceleration: Array) -> Array:
        """R [N or N.m], of the shape of the position."""
        turning = self.sine * np.sin(position) + self.cosine * np.cos(position)
        return self.inertia * acceleration + self.constant + turning


def one_joint(model: mujoco.MjModel) -> OneJoint | None:
    """Rigid-body force of a model's joint; None if it has several joints, or a force of another form.

    Args:
      model: A model without friction, springs, armature and constraints.
    """
    if model.nv != 1 or model.nq != 1 or model.neq or model.ntendon:
        return None
    mj_data = mujoco.MjData(model)
    mujoco.mj_setConst(model, mj_data)

    def needed(position: float, speed: float, acceleration: float) -> float:
        mj_data.qpos[0], mj_data.qvel[0], mj_data.qacc[0] = position, speed, acceleration
        mujoco.mj_inverse(model, mj_data)
        return float(mj_data.qfrc_inverse[0])

    down, level, up = (needed(q, 0.0, 0.0) for q in (0.0, 0.5 * np.pi, np.pi))
    if model.jnt_type[0] == mujoco.mjtJoint.mjJNT_HINGE:
        middle = 0.5 * (down + up)
        found = OneJoint(needed(0.0, 0.0, 1.0) - down, middle, level - middle, down - middle)
    else:
        found = OneJoint(needed(0.0, 0.0, 1.0) - down, down, 0.0, 0.0)
    size = found.inertia + abs(found.constant) + abs(found.sine) + abs(found.cosine)
    for q, v, a in _TRIALS:
        if abs(needed(q, v, a) - float(found.force(np.array(q), np.array(a)))) > _EXACT * size:
            return None
    return found


@kernel
def free_windows_of_one_joint(body, law, curve, windows, step, given, blocks):
    """Simulate free windows from the measured state and average the positions over the blocks.

    Args:
      step: Time step [s].
      curve, windows, given, blocks: As for `kernels.free_windows`; arrays over the joints have one column.
    """
    size, substeps, commands, braking = windows.size, windows.substeps, given.commands, given.braking
    for w in range(len(windows.table)):
        first, last, at = windows.table[w, FIRST], windows.table[w, LAST], windows.table[w, FIRST_BLOCK]
        q, v, load = given.position[first, 0], given.speed[first, 0], given.loads[first, 0]
        blocks[at : at + (last - first) // size] = 0.0
        for k in range(first, last):
            block, after = at + (k - first) // size, min(k + 1, last - 1)
            for i in range(substeps):
                share = i / substeps
                command = (1.0 - share) * commands[k, 0] + share * commands[after, 0]
                is_on, time = given.enabled[k, 0], given.times[k]
                push, slowing, lost = pushing_force(law, curve, 0, command, is_on, time, q, v)
                push -= (1.0 - share) * braking[k, 0] + share * braking[after, 0]
                push -= slowing * v + law[SPRING] * (q - law[SPRING_REST])
                weight = body.constant + body.sine * np.sin(q) + body.cosine * np.cos(q)
                push -= weight
                forward, backward = dry_friction(law, q, v, load)
                inertia = body.inertia + law[ARMATURE] + 0.5 * step * max(slowing, 0.0)
                forward, backward = forward + lost, backward + lost
                if forward + backward >= 0.0:
                    push += min(max(-push - v * inertia / step, -forward), backward)
                else:  # a gear with an efficiency above 1
                    push += backward if v < 0.0 else -forward
                change = step * push / inertia
                if i == 0:
                    blocks[block, 0] += (q + given.gaps[k, 0]) / size
                v += change
                q += step * v
                if k == first and i == 0:
                    v -= 0.5 * change
                    q -= 0.5 * step * change
                load = weight + body.inertia * change / step
                if i == 0:
                    blocks[block, 0] += law[COMPLIANCE] * load / size
                    blocks[block, 1] += (v - 0.5 * change) / size
