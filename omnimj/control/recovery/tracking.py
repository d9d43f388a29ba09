"""What recovery remembers: where the robot should be by now, how it was turned, how well it follows.

Place: the way that was asked for less the way that the wheels tell, ∫ v_d − R(θ) v̂ dt [m]. A healthy robot
forgets it within a second; a faulty one drives it back.
"""

from __future__ import annotations

import math

from omnimj.control.cascade.heading import wrapped
from omnimj.physics.native import kernel

(
    PLACE_X,
    PLACE_Y,
    TURNED,
    PACE,
    ERROR,
    ERROR_BEFORE,
    USUAL_ERROR,
    HARDEST,
    ASKED_X,
    ASKED_Y,
    ASKED_TURN,
    FORWARD_X,
    FORWARD_Y,
    SPIN,
    FLOOR_GRIP,
    CORRECTION,
) = range(16)
"""Place error, world [m]; usual heading error [rad]; pace of the plan; low-passed error of the twist, the
same at the last decision, its usual size [m/s]; hardest acceleration that the plan had so far [m/s²];
velocity [m/s] and yaw rate [rad/s] that were asked for last; demanded acceleration, world [m/s²], and its
spin [rad/s²], low-passed; friction that was felt on a slippery floor [1]; how far recovery moves
speeds away from what was asked for [m/s]."""
NUMBERS = 16

_FORGETS = 1.0  # [s] of a healthy robot's place
_SETTLES = 3.0  # [s] in which a heading error becomes the usual one
_FAR = 0.5  # [m] beyond which a place error grows no more
_SHORT = 0.3  # [s] over which following is judged
_LONG = 10.0  # [s] over which it is remembered how well a healthy robot follows
_SMOOTH = 0.02  # [s] for demanded accelerations
_LARGEST = 5.0  # [m/s², rad/s² times an arm] no robot is asked for more; a step of the demand is cut


@kernel
def _low_pass(old, new, h, time):
    return old + min(h / time, 1.0) * (new - old)


@kernel
def update_tracking(
    x, h, arm, healthy, sure, velocity, heading, turning, target_x, target_y, target_turn, target_heading
):
    """One step into the memory, in place.

    Args:
      x: The numbers above.
      h: Control period [s].
      arm: Length that turns a yaw rate into a speed [m].
      healthy: Whether nothing is wrong.
      sure: Whether the body's velocity is known.
      velocity: v̂, body frame, shape (2,) [m/s].
      heading: Estimate [rad].
      turning: Gyro less its bias [rad/s].
      target_x: World demand [m/s].
      target_y: World demand [m/s].
      target_turn: Demand [rad/s].
      target_heading: Planned [rad].
    """
    c, s = math.cos(heading), math.sin(heading)
    off_x = target_x - (c * velocity[0] - s * velocity[1])
    off_y = target_y - (s * velocity[0] + c * velocity[1])
    if sure:
        x[PLACE_X], x[PLACE_Y] = x[PLACE_X] + h * off_x, x[PLACE_Y] + h * off_y
    if healthy:
        x[PLACE_X], x[PLACE_Y] = (
            _low_pass(x[PLACE_X], 0.0, h, _FORGETS),
            _low_pass(x[PLACE_Y], 0.0, h, _FORGETS),
        )
        x[TURNED] += min(h / _SETTLES, 1.0) * wrapped(heading - target_heading - x[TURNED])
    far = math.hypot(x[PLACE_X], x[PLACE_Y])
    if far > _FAR:
        x[PLACE_X], x[PLACE_Y] = x[PLACE_X] * _FAR / far, x[PLACE_Y] * _FAR / far
    x[ERROR] = _low_pass(x[ERROR], math.hypot(off_x, off_y) + arm * abs(target_turn - turning), h, _SHORT)
    if healthy:
        x[USUAL_ERROR] = max(x[ERROR], _low_pass(x[USUAL_ERROR], 0.0, h, _LONG))
    forward_x = min(max((target_x - x[ASKED_X]) / h, -_LARGEST), _LARGEST)
    forward_y = min(max((target_y - x[ASKED_Y]) / h, -_LARGEST), _LARGEST)
    x[FORWARD_X] = _low_pass(x[FORWARD_X], forward_x, h, _SMOOTH)
    x[FORWARD_Y] = _low_pass(x[FORWARD_Y], forward_y, h, _SMOOTH)
    spin = min(max((target_turn - x[ASKED_TURN]) / h, -_LARGEST / arm), _LARGEST / arm)
    x[SPIN] = _low_pass(x[SPIN], spin, h, _SMOOTH)
    x[ASKED_X], x[ASKED_Y], x[ASKED_TURN] = target_x, target_y, target_turn
    if healthy:
        x[HARDEST] = max(x[HARDEST], math.hypot(x[FORWARD_X], x[FORWARD_Y]))
