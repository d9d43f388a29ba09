"""What follows from a verdict: who has a say, whose force is known, what recovery is to act upon."""

from __future__ import annotations

import math

import numpy as np

from omnimj.control.method import Beliefs
from omnimj.control.robust.evidence import Evidence
from omnimj.control.robust.verdict import Verdict, is_still
from omnimj.signals import Array

_DEAD = 0.9  # loss from which a motor is not counted upon


def believe(evidence: Evidence, verdict: Verdict, losses: Array) -> Beliefs:
    """What stands, wheel by wheel; what might be another wheel is not acted upon.

    Args:
      evidence: Velocity and forces.
      verdict: What stands.
      losses: Believed losses of the torque constants, shape (n,).
    """
    n = len(losses)
    lost, decided, force = np.zeros(n), -math.inf, evidence.force.copy()
    dead, runaway, held, slipping = (np.zeros(n, bool) for _ in range(4))
    for d in verdict.diagnoses:
        decided = max(decided, d.time)
        if d.cleared is not None or (d.ambiguous_with and not is_still(d)):
            continue
        wheels = [w - 1 for w in d.wheels]
        if is_still(d):
            dead[wheels], force[wheels] = True, 0.0
        elif d.kind == "motor":
            lost[wheels] = losses[wheels]
            dead[wheels] = losses[wheels] > _DEAD
        elif d.kind == "free":
            dead[wheels] = True
        elif d.kind == "hard_over":
            runaway[wheels] = True
        elif d.kind == "locked":
            held[wheels] = True
        elif d.kind == "slip":
            slipping[wheels] = True
        elif d.kind == "all_wheel_slip":
            slipping[:] = True
    velocity, gyro = evidence.velocity[n, :2].copy(), not verdict.has_sensor("yaw_rate")
    return Beliefs(lost, dead, runaway, held, slipping, velocity, force, decided, gyro)


def believed_wheels(verdict: Verdict, wheels: int, fresh: int) -> Array:
    """Wheels that have a say about the body's velocity, 1 or 0, shape (wheels,).

    Args:
      verdict: What stands.
      wheels: n.
      fresh: Blocks for which a new loss is still measured: its wheel has a say once its force is known again.
    """
    believed = np.ones(wheels)
    for d in verdict.diagnoses:
        if d.cleared is not None or (d.kind == "motor" and fresh == 0):
            continue
        if d.kind in ("slip", "motor", "locked", "sensor"):
            believed[[w - 1 for w in d.wheels]] = 0.0
        elif d.kind == "all_wheel_slip":
            believed[:] = 0.0
    return believed


def deaf_axes(verdict: Verdict) -> Array:
    """Axes along which the accelerometer lies, shape (2,)."""
    return np.array([float(verdict.has_sensor(f"acceleration_{axis}")) for axis in "xy"])


def unknown_forces(verdict: Verdict, wheels: int) -> Array:
    """Wheels whose force on the floor the motor, or its speed, does not tell, 1 or 0, shape (wheels,)."""
    unknown = np.zeros(wheels)
    for d in verdict.diagnoses:
        lies = d.channel.startswith("wheel_speed")
        if d.cleared is None and (d.kind == "locked" or lies or is_still(d)):
            unknown[[w - 1 for w in d.wheels]] = 1.0
    return unknown


def weak_motors(verdict: Verdict, wheels: int) -> Array:
    """Wheels whose motor is known to be broken, 1 or 0, shape (wheels,)."""
    weak = np.zeros(wheels)
    for d in verdict.diagnoses:
        if d.cleared is None and d.kind == "motor":
            weak[[w - 1 for w in d.wheels]] = 1.0
    return weak
