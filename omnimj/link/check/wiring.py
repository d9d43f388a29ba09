"""Diagnosis of the wiring from small motions: channels that are dead, inverted, or wrongly scaled.

An inverted motor and an inverted speed channel cannot be distinguished at the wheel. On the floor the motion
of the body distinguishes them, through gyro, heading converter and accelerometer. The result is the smallest
set of wrong signs that explains all observations; equally small sets are reported as alternatives. Off the
floor a person has to watch the wheels.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.link.check.motions import Motion
from omnimj.parameters import Robot
from omnimj.signals import Array

MIN_WHEEL_SPEED, MIN_YAW_RATE, MIN_ACCELERATION = 0.7, 0.04, 0.08
"""Thresholds of motion: wheel speed [rad/s], yaw rate [rad/s], acceleration [m/s²]."""
MIN_MONITOR_GAIN = 0.2
"""Ratio of measured to commanded current below which a monitor counts as dead."""
CURRENT_GAIN_TOLERANCE, SPEED_GAIN_TOLERANCE, YAW_GAIN_TOLERANCE = 0.15, 0.2, 0.15
"""Tolerated deviations of a ratio from 1, which include creep and friction."""
_CONTRADICTION_COST = 10  # cost of an unexplained observation, in wrong signs
_BODY_CHANNELS = ("yaw_rate", "yaw", "acceleration_x", "acceleration_y")


@dataclass(frozen=True)
class WiringFinding:
    """Defect of the wiring."""

    place: str
    """`wheel_speed_2`, `motor_3`, or several with `or` between them."""
    kind: str
    """`sign`, `gain`, `dead`, or `other`."""
    description: str
    """Description for a person."""


def judge_wiring(
    robot: Robot,
    still: Motion,
    single: Sequence[Motion],
    turns: Sequence[Motion],
    seen: Mapping[int, int] | None = None,
) -> list[WiringFinding]:
    """Find the defects of the wiring.

    Args:
      robot: Robot as it should be.
      still: Recording at rest.
      single: Motions of one motor each.
      turns: Turns on the spot; empty off the floor.
      seen: Direction of wheels 0…n−1 as observed by a person: 1 correct, −1 inverted.
    """
    every = [still, *single, *turns]
    dead = _constant_channels(len(robot.wheels), every, single, turns)
    found = [WiringFinding(place, "dead", f"{place} never changes, whatever moves") for place in dead]
    found += _judge_currents(single, dead)
    found += _judge_signs(robot, still, single, bool(turns), seen or {}, dead)
    if turns and not any(f.kind == "sign" or f.place.startswith("motor") for f in found):
        found += _judge_gains(robot, still, turns, dead)  # ratios require correct signs and turning wheels
    return _merge_findings(found)


def _merge_findings(found: Sequence[WiringFinding]) -> list[WiringFinding]:
    """Merge findings with a common cause.

    A motor without current leaves its wheel at rest; an inverted set value also inverts its current monitor.
    """
    idle = {f.place.split(" or ")[0][6:] for f in found if f.kind == "dead" and f.place.startswith("motor_")}
    turned = {f.place[6:] for f in found if f.kind == "sign" and f.place.startswith("motor_")}
    first: dict[str, WiringFinding] = {}
    for f in found:
        i = f.place.split(" or ")[0].rpartition("_")[2]
        stands = f.kind == "dead" and f.place.startswith("wheel_speed") and i in idle
        again = f.kind == "sign" and f.place.startswith("current") and i in turned
        if not stands and not again:
            first.setdefault(f"{f.kind} {i}" if f.place.startswith("motor") else f"{f.kind} {f.place}", f)
    return list(first.values())


def _constant_channels(
    n: int, every: Sequence[Motion], single: Sequence[Motion], turns: Sequence[Motion]
) -> list[str]:
    """Channels that never change; for currents and wheel speeds, while their own motor is driven."""
    dead = []
    for i in range(n):
        own = [m for m in single if m.wheel == i]
        dead += [
            f"{name}_{i + 1}"
            for name in ("current", "wheel_speed")
            if all(np.ptp(getattr(m, name)[:, i]) == 0.0 for m in own)
        ]
    values = {
        "yaw_rate": [m.yaw_rate for m in every],
        "yaw": [m.yaw for m in every] if turns else [],  # changes only while the body turns
        "acceleration_x": [m.acceleration[:, 0] for m in every],
        "acceleration_y": [m.acceleration[:, 1] for m in every],
    }
    return dead + [
        name for name, all_of in values.items() if all_of and np.ptp(np.concatenate(all_of)) == 0.0
    ]


def _judge_currents(single: Sequence[Motion], dead: Sequence[str]) -> list[WiringFinding]:
    """Compare each current monitor with the commanded currents of its own and the other motors."""
    found = []
    for wheel in sorted({m.wheel for m in single}):
        own = [m for m in single if m.wheel == wheel]
        commanded = np.concatenate([m.commanded for m in own])
        slopes = np.concatenate([m.current for m in own]).T @ commanded / (commanded @ commanded)
        name, slope = f"current_{wheel + 1}", float(slopes[wheel])
        other = int(np.argmax(np.abs(slopes)))
        if abs(slope) < MIN_MONITOR_GAIN and abs(slopes[other]) > MIN_MONITOR_GAIN:
            text = f"current for motor {wheel + 1} shows in current_{other + 1}: the two are swapped"
            found.append(WiringFinding(name, "other", text))
        elif name in dead:
            continue
        elif abs(slope) < MIN_MONITOR_GAIN:
            text = f"motor {wheel + 1} takes no current: its amplifier is off, or its monitor is not wired"
            found.append(WiringFinding(f"motor_{wheel + 1} or {name}", "dead", text))
        else:
            if slope < 0.0:
                text = f"{name} has the wrong sign: it reads {slope:.2f} A per commanded ampere"
                found.append(WiringFinding(name, "sign", text))
            if abs(abs(slope) - 1.0) > CURRENT_GAIN_TOLERANCE:
                text = f"{abs(slope):.2f} A per commanded ampere: the amplifier's gain or the monitor's"
                found.append(WiringFinding(f"motor_{wheel + 1} or {name}", "gain", text))
    return found


def _steady_change(motion: Motion, values: Array, rest: Array | float) -> Array:
    """Mean over the second half of the drive minus the value at rest."""
    return values[motion.driven // 2 : motion.driven].mean(axis=0) - rest


def _observed_signs(robot: Robot, still: Motion, motion: Motion) -> dict[str, int]:
    """Sign of each channel relative to its expected sign for the commanded current; 0 without motion."""
    i, direction = motion.wheel, float(np.sign(motion.commanded[: motion.driven].sum()))
    position, u = robot.wheel_positions[i], robot.rolling_directions[i]
    turn = position[0] * u[1] - position[1] * u[0]
    speed = float(_steady_change(motion, motion.wheel_speed, 0.0)[i])
    push = _steady_change(motion, motion.acceleration, still.acceleration.mean(axis=0))
    rate = float(_steady_change(motion, motion.yaw_rate, still.yaw_rate.mean()))
    turned = float(motion.yaw[motion.driven - 1] - motion.yaw[0]) / (motion.driven or 1) * 2000.0

    def sign(value: float, expected: float, least: float) -> int:
        return 0 if abs(value) < least or abs(expected) < 1e-6 else int(np.sign(value * expected * direction))

    return {
        "wheel_speed": sign(speed, 1.0, MIN_WHEEL_SPEED),
        "yaw_rate": sign(rate, turn, MIN_YAW_RATE),
        "yaw": sign(turned, turn, MIN_YAW_RATE),
        "acceleration_x": sign(float(push[0]), u[0] if abs(u[0]) > 0.5 else 0.0, MIN_ACCELERATION),
        "acceleration_y": sign(float(push[1]), u[1] if abs(u[1]) > 0.5 else 0.0, MIN_ACCELERATION),
    }


def _judge_signs(
    robot: Robot,
    still: Motion,
    single: Sequence[Motion],
    on_floor: bool,
    seen: Mapping[int, int],
    dead: Sequence[str],
) -> list[WiringFinding]:
    """Find the smallest sets of wrong signs that explain the observations."""
    observed = [(m.wheel, _observed_signs(robot, still, m)) for m in single]
    found = []
    for wheel in range(len(robot.wheels)):
        own = [o for w, o in observed if w == wheel]
        if all(o["wheel_speed"] == 0 for o in own) and f"wheel_speed_{wheel + 1}" not in dead:  # or blocked
            text = f"wheel {wheel + 1} hardly turned: is motor {wheel + 1} connected, and is the wheel free?"
            found.append(WiringFinding(f"motor_{wheel + 1}", "dead", text))
    body = [name for name in _BODY_CHANNELS if name not in dead] if on_floor else []
    best: list[tuple[str, ...]] = []
    least = np.inf
    for flipped in itertools.product((1, -1), repeat=len(body)):
        signs = dict(zip(body, flipped, strict=True))
        wrong, cost = _fewest_wheel_signs(len(robot.wheels), observed, signs, seen)
        names = tuple(name for name, sign in signs.items() if sign < 0)
        cost += len(names)
        for wheels in wrong:
            if cost < least:
                best, least = [], cost
            if cost == least:
                best.append((*names, *wheels))
    return found + _sign_findings(best)


def _fewest_wheel_signs(
    n: int, observed: Sequence[tuple[int, dict[str, int]]], body: Mapping[str, int], seen: Mapping[int, int]
) -> tuple[list[tuple[str, ...]], int]:
    """Smallest sets of wrong signs of motors and wheel speeds for given signs of the body's channels."""
    answers: list[tuple[str, ...]] = [()]
    total = 0
    for i in range(n):
        costs = {}
        for motor in (1, -1):
            own = [o for w, o in observed if w == i]
            against = sum(o[name] * sign * motor < 0 for o in own for name, sign in body.items())
            against += i in seen and seen[i] != motor
            turned = sum(o["wheel_speed"] for o in own) * motor < 0  # then the channel is inverted as well
            names = (f"motor_{i + 1}",) * (motor < 0) + (f"wheel_speed_{i + 1}",) * turned
            costs[names] = _CONTRADICTION_COST * against + len(names)
        least = min(costs.values())
        total += least
        answers = [(*a, *names) for a in answers for names, cost in costs.items() if cost == least]
    return answers, total


def _sign_findings(best: Sequence[tuple[str, ...]]) -> list[WiringFinding]:
    """Findings common to all alternatives, and one finding for their differences."""
    sure = [name for name in (best[0] if best else ()) if all(name in one for one in best)]
    found = [WiringFinding(name, "sign", f"{name} has the wrong sign") for name in sure]
    doubtful = {tuple(name for name in one if name not in sure) for one in best}
    if len(doubtful) > 1:
        either = " or ".join(sorted({" and ".join(names) for names in doubtful if names}))
        text = f"one has the wrong sign: {either}; watch which way the wheel turns, or check on the floor"
        found.append(WiringFinding(either, "sign", text))
    return found


def _judge_gains(
    robot: Robot, still: Motion, turns: Sequence[Motion], dead: Sequence[str]
) -> list[WiringFinding]:
    """Compare r φ̇ with l ω of each coasting wheel, and the integrated gyro with the heading converter."""
    p, u = robot.wheel_positions, robot.rolling_directions
    arm = (p[:, 0] * u[:, 1] - p[:, 1] * u[:, 0]) / robot.wheel.radius
    bias, found = float(still.yaw_rate.mean()), []
    rate = np.concatenate([m.yaw_rate[m.driven :] for m in turns]) - bias
    speeds = np.concatenate([m.wheel_speed[m.driven :] for m in turns])
    by_wheel = speeds.T @ rate / max(float(rate @ rate), 1e-9) / arm
    usual = float(np.median(by_wheel))
    for i, ratio in enumerate(by_wheel / usual if usual > 0.0 else ()):
        if abs(ratio - 1.0) > SPEED_GAIN_TOLERANCE and f"wheel_speed_{i + 1}" not in dead:
            text = f"wheel {i + 1} reads {ratio:.2f} of the other wheels' speed while the robot turns"
            found.append(WiringFinding(f"wheel_speed_{i + 1}", "gain", text))
    if "yaw_rate" in dead or "yaw" in dead:
        return found
    swept = np.array([m.period * float((m.yaw_rate - bias).sum()) for m in turns])
    turned = np.array([float(m.yaw[-1] - m.yaw[0]) for m in turns])
    return found + _judge_gyro(float(swept @ turned / (turned @ turned)), usual)


def _judge_gyro(ratio: float, by_wheels: float) -> list[WiringFinding]:
    """Finding for a ratio of gyro to converter other than 1: the one that contradicts the wheels."""
    if abs(ratio - 1.0) < YAW_GAIN_TOLERANCE:
        return []
    gyro, converter = (
        abs(by_wheels * ratio - 1.0) < SPEED_GAIN_TOLERANCE,
        abs(by_wheels - 1.0) < SPEED_GAIN_TOLERANCE,
    )
    place = "yaw_rate" if gyro and not converter else "yaw" if converter and not gyro else "yaw_rate or yaw"
    text = f"the gyro's angle is {ratio:.2f} of the converter's; by the wheels the wrong one is {place}"
    return [WiringFinding(place, "gain", text)]
