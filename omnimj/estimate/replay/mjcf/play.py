"""Play between motor and link: motion of the link behind a measured motor, and the force that it takes.

The motor carries the encoder. In contact the link moves with it, as long as they press on each other; then
it moves alone under its own forces and friction, until the motor reaches it on either side and both go on
together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import correlate1d
from scipy.signal import savgol_filter

from omnimj.estimate.replay.mjcf.filters import same_filter
from omnimj.estimate.replay.mjcf.kernels import PLAY, REST_SPEED, damping, dry_friction, steady_force
from omnimj.estimate.replay.mjcf.log import MachineLog
from omnimj.physics.native import kernel
from omnimj.signals import Array


class Play(NamedTuple):
    """Links behind their play, shape (n, j) each."""

    gap: Array
    """Position of the motor minus that of the link, and its two derivatives, shape (3, n, j)."""
    force: Array
    """Force that the motor gives the link, minus that along the motor's own motion [N or N.m]."""
    speed: Array
    """Speed of the link."""
    contact: Array
    """1 where motor and link press on each other, otherwise 0."""


def links_behind_play(
    joints: Array, log: MachineLog, motion: tuple[Array, Array, Array], rigid: Array, inertia: Array
) -> Play:
    """Motion of the links, under the filter that motion and inputs have passed.

    Args:
      joints: Laws of the joints, shape (j, LAW).
      log: Its stretches and filters.
      motion: Measured position, speed and acceleration, shape (n, j) each.
      rigid: Rigid-body forces along the measured motion, shape (n, j) [N or N.m].
      inertia: Inertia of the links about their own joint, shape (n, j) [kg or kg.m2].
    """
    speed = motion[1]
    gap, force = np.zeros((3, *speed.shape)), np.zeros(speed.shape)
    links, contact = speed.copy(), np.ones(speed.shape)
    for j in np.flatnonzero(joints[:, PLAY]):
        columns = [np.ascontiguousarray(c[:, j]) for c in (*motion, rigid, inertia)]
        found = np.empty((4, len(speed)))
        follow_links(joints[j], log.stretches, log.period, *columns, found)
        links[:, j], contact[:, j] = found[2], found[3]
        for first, last, _, _ in log.stretches:
            part, width = slice(int(first), int(last)), min(log.filter_widths[j], int(last - first) - 1 | 1)
            for order in range(3):
                gap[order, part, j] = savgol_filter(
                    found[0, part], width, 3, deriv=order, delta=log.period, mode="nearest"
                )
            force[part, j] = correlate1d(found[1, part], same_filter(log.filter_widths[j]), mode="nearest")
    return Play(gap, force, links, contact)


@kernel
def follow_links(law, stretches, h, position, speed, acceleration, rigid, inertia, found):
    """Follow the link of one joint behind its play, over all stretches.

    Args:
      law: Law of the joint, shape (LAW,).
      stretches: Table of stretches.
      h: Time between rows [s].
      position: Position of the motor, shape (n,).
      speed: Speed of the motor, shape (n,).
      acceleration: Acceleration of the motor, shape (n,).
      rigid: Rigid-body force along the motor's motion, shape (n,).
      inertia: Inertia of the link, shape (n,).
      found: Filled with gap, additional force, speed of the link, and contact, shape (4, n).
    """
    half = 0.5 * law[PLAY]
    for s in range(len(stretches)):
        first, last = stretches[s, 0], stretches[s, 1]
        side = _first_side(law, position, speed, rigid, first, last)
        gap, link, hit, later = side * half, speed[first], 0.0, 0.0
        for k in range(first, last):
            v, impulse, share = speed[k], hit, later
            hit, later = 0.0, 0.0
            plain = rigid[k] + steady_force(law, position[k]) + damping(law, v) * v
            if side != 0.0:
                forward, backward = dry_friction(law, position[k], v, rigid[k])
                resting = min(max(-plain, -backward), forward)
                pressing = plain + resting
                if abs(v) > 0.5 * law[REST_SPEED]:
                    pressing = plain + (forward if v > 0.0 else -backward)
                link = v
                if side * (pressing + impulse) < 0.0:
                    side, impulse = 0.0, 0.0
            found[0, k], found[2, k] = gap, link
            found[3, k] = 1.0 if side != 0.0 else 0.0
            found[1, k] = share * impulse if side != 0.0 else -plain
            if side == 0.0 and k + 1 < last:
                after = _alone(
                    law, position[k] - gap, link, rigid[k] - inertia[k] * acceleration[k], inertia[k], h
                )
                moved = 0.5 * h * (v + speed[k + 1] - link - after)
                if abs(gap + moved) >= half:  # they meet between the rows, which share the blow by its time
                    side = 1.0 if gap + moved > 0.0 else -1.0
                    later = (side * half - gap) / moved
                    hit = inertia[k] * ((1.0 - later) * (v - link) + later * (speed[k + 1] - after)) / h
                    found[1, k] += (1.0 - later) * hit
                    moved = side * half - gap
                gap += moved
                link = after


@kernel
def _first_side(law, position, speed, rigid, first, last):
    """Side on which the motor touches the link at the start: that of the first clear motion."""
    fast = 0.0
    for k in range(first, last):
        fast = max(fast, abs(speed[k]))
    for k in range(first, last):
        v = speed[k]
        if abs(v) > 0.05 * fast:
            forward, backward = dry_friction(law, position[k], v, rigid[k])
            pressing = (
                rigid[k]
                + steady_force(law, position[k])
                + damping(law, v) * v
                + (forward if v > 0.0 else -backward)
            )
            return 1.0 if pressing >= 0.0 else -1.0
    return 1.0


@kernel
def _alone(law, position, link, pull, inertia, h):
    """Speed of a link without contact after h seconds; dry friction holds it at rest."""
    forward, backward = dry_friction(law, position, link, 0.0)
    pull += steady_force(law, position)
    free = link - h * (pull + damping(law, link) * link) / inertia
    if free > 0.0:
        return max(free - h * forward / inertia, 0.0)
    return min(free + h * backward / inertia, 0.0)
