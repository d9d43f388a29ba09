"""Play between motor and link: motion of that which carries no encoder, and the force that it takes.

In contact both move together, as long as they press on each other; then each moves alone, the link under its
own forces and friction and the motor under its drive, until they meet on either side and go on together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d
from scipy.signal import savgol_filter

from omnimj.estimate.replay.mjcf.filters import same_filter
from omnimj.estimate.replay.mjcf.kernels import (
    ARMATURE,
    PLAY,
    REST_SPEED,
    damping,
    drive_force,
    dry_friction,
    passed_on,
    steady_force,
)
from omnimj.estimate.replay.mjcf.log import MachineLog
from omnimj.physics.native import kernel
from omnimj.signals import Array


class Play(NamedTuple):
    """Links behind their play, shape (n, j) each."""

    gap: Array
    """Measured position minus that of the link, and its two derivatives, shape (3, n, j); with the encoder on
    the link, 0 and the acceleration of the motor beyond that of the link."""
    force: Array
    """Force that the motion takes beyond that of motor and link without play [N or N.m]."""
    speed: Array
    """Speed of the link."""
    contact: Array
    """1 where motor and link press on each other, otherwise 0."""


class JointMotion(NamedTuple):
    """Measured motion of one joint, and the bodies that it moves, shape (n,) each."""

    position: Array
    speed: Array
    acceleration: Array
    rigid: Array
    """Rigid-body force along the motion [N or N.m]."""
    inertia: Array
    """Inertia of the link [kg or kg.m2]."""


class Drive(NamedTuple):
    """Input of the actuator of one joint, shape (n,) each."""

    commands: Array
    """Effective inputs."""
    enabled: NDArray[np.bool_]
    """Whether the actuator is on."""


def links_behind_play(
    joints: Array, log: MachineLog, motion: tuple[Array, Array, Array], rigid: Array, inertia: Array
) -> Play:
    """Motion of the links, under the filter that motion and inputs have passed.

    Args:
      joints: Laws of the joints, shape (j, LAW).
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
        follow_links(joints[j], log.stretches, log.period, JointMotion(*columns), found)
        links[:, j], contact[:, j] = found[2], found[3]
        for first, last, _, _ in log.stretches:
            part, width = slice(int(first), int(last)), min(log.filter_widths[j], int(last - first) - 1 | 1)
            for order in range(3):
                gap[order, part, j] = savgol_filter(
                    found[0, part], width, 3, deriv=order, delta=log.period, mode="nearest"
                )
            force[part, j] = correlate1d(found[1, part], same_filter(log.filter_widths[j]), mode="nearest")
    return Play(gap, force, links, contact)


def motors_before_play(joints: Array, log: MachineLog, play: Play, motion: tuple[Array, ...]) -> None:
    """Add the motors of joints whose encoder is on the link.

    Args:
      joints: Laws of these joints, shape (j, LAW); without play for the others.
      play: Links behind their play; the force of these motors is added.
      motion: Effective inputs, position, speed and acceleration of the links, rigid-body forces along it and
        inertia of the links about their own joint, shape (n, j) each.
    """
    for j in np.flatnonzero(joints[:, PLAY] * joints[:, ARMATURE]):
        commands, *columns = (np.ascontiguousarray(c[:, j]) for c in motion)
        driven = Drive(commands, log.enabled[:, j])
        found = np.empty(len(log.times))
        follow_motors(joints[j], log.stretches, log.period, driven, JointMotion(*columns), found)
        for first, last, _, _ in log.stretches:
            part = slice(int(first), int(last))
            filtered = correlate1d(found[part], same_filter(log.filter_widths[j]), mode="nearest")
            play.force[part, j] = filtered
            play.gap[2, part, j] = filtered / joints[j, ARMATURE]


@kernel
def follow_motors(law, stretches, h, drive, motion, force):
    """Follow the motor of one joint before its play along the measured motion of its link.

    In contact it gives the link its drive force F − J q̈, and leaves it where this changes its sign. What it
    takes beyond the link's motion, J q̈_m − J q̈, is F − J q̈ while it is alone; the blow at the end takes all
    of this impulse back, since both have the same speed before and after. Meanwhile the link moves under its
    own forces: the measured motion, which is smoothed, shows the blow before it falls.

    Args:
      force: Filled with J q̈_m − J q̈, shape (n,) [N or N.m].
    """
    half, commands, rigid, inertia = 0.5 * law[PLAY], drive.commands, motion.rigid, motion.inertia
    position, speed, acceleration = motion.position, motion.speed, motion.acceleration
    for s in range(len(stretches)):
        first, last = stretches[s, 0], stretches[s, 1]
        side = _first_push(law, drive, motion, first, last)
        gap, motor, link, impulse, later = side * half, speed[first], speed[first], 0.0, 0.0
        for k in range(first, last):
            if side != 0.0:
                motor = link = speed[k]
            force[k], later = later, 0.0
            if k + 1 == last:
                break
            # forces are those between the rows: a row late, a gap that grows with t³ is much too small
            place, change = (
                0.5 * (position[k] + position[k + 1]),
                0.5 * (acceleration[k] + acceleration[k + 1]),
            )
            command = 0.5 * (commands[k] + commands[k + 1])
            is_on = drive.enabled[k]
            pushing = passed_on(law, drive_force(law, command, place, motor), motor) if is_on else 0.0
            if side * (pushing - law[ARMATURE] * change) < 0.0:
                side = 0.0
            if side == 0.0:
                pull = 0.5 * (rigid[k] + rigid[k + 1]) - inertia[k] * change
                coasting = _alone(law, place, link, pull, inertia[k], h)
                beyond = pushing - law[ARMATURE] * (coasting - link) / h
                force[k] += 0.5 * beyond
                later = 0.5 * beyond
                impulse += beyond
                after = motor + h * pushing / law[ARMATURE]
                moved = 0.5 * h * (motor + after - link - coasting)
                if abs(gap + moved) >= half:  # they meet between the rows, which share the blow by its time
                    side = 1.0 if gap + moved > 0.0 else -1.0
                    share = (side * half - gap) / moved if moved != 0.0 else 0.0
                    force[k] -= (1.0 - share) * impulse
                    later -= share * impulse
                    impulse = 0.0
                    moved = side * half - gap
                gap += moved
                motor, link = after, coasting


@kernel
def _first_push(law, drive, motion, first, last):
    """Side on which the motor touches the link at the start: that of the first clear motion."""
    fast, position, speed = 0.0, motion.position, motion.speed
    for k in range(first, last):
        fast = max(fast, abs(speed[k]))
    for k in range(first, last):
        if abs(speed[k]) > 0.05 * fast and drive.enabled[k]:
            force = drive_force(law, drive.commands[k], position[k], speed[k])
            pushing = passed_on(law, force, speed[k])
            return 1.0 if pushing >= law[ARMATURE] * motion.acceleration[k] else -1.0
    return 1.0


@kernel
def follow_links(law, stretches, h, motion, found):
    """Follow the link of one joint behind its play, over all stretches.

    Args:
      found: Filled with gap, additional force, speed of the link, and contact, shape (4, n).
    """
    half, rigid, inertia = 0.5 * law[PLAY], motion.rigid, motion.inertia
    position, speed, acceleration = motion.position, motion.speed, motion.acceleration
    for s in range(len(stretches)):
        first, last = stretches[s, 0], stretches[s, 1]
        side = _first_side(law, motion, first, last)
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
                pull = rigid[k] - inertia[k] * acceleration[k]
                after = _alone(law, position[k] - gap, link, pull, inertia[k], h)
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
def _first_side(law, motion, first, last):
    """Side on which the motor touches the link at the start: that of the first clear motion."""
    fast, position, speed, rigid = 0.0, motion.position, motion.speed, motion.rigid
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
