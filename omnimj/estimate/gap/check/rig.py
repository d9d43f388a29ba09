"""Relations between the channels of the rig: speed, integrated acceleration, wheel and rail.

Healthy lags stay below the limits: 4 ms of the speed filter, 1.6 ms of the accelerometer, a wheel that slips
before it drives.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from omnimj.estimate.gap.check.columns import SLOPE, current_bias, fill_masked, unwrap_counter
from omnimj.estimate.gap.check.compare import (
    CLEAR,
    Comparison,
    Onsets,
    Stretch,
    clear_link,
    compare,
    integral,
    onsets,
    solve_scaled,
    windows,
)
from omnimj.estimate.gap.check.suspicions import Link, Suspicion, late, wrong_scales, wrong_signs
from omnimj.estimate.gap.check.time_base import TimeLink
from omnimj.estimate.replay.interface import average_blocks
from omnimj.parameters import Rig
from omnimj.recording.dataset import Run

_WINDOW = 4.0  # [s] longest stretch of one comparison
_TIGHT = np.log(1.06)  # permitted |log| of a scale between two encoders, or encoder and accelerometer
_SLIPPING = np.log(2.0)  # permitted |log| of the scale between wheel and rail, because of slip
_FORCE = np.log(3.0)  # permitted |log| of declared over fitted mass: friction and slip take their part
_AVERAGE = 0.05  # [s] over which current and acceleration are compared
_DRIVEN = 0.02  # smallest share of the squared current that accelerates the carriage
_DELAY = 0.005  # [s] delay beyond the healthy band from which on it is reported
_LAG = 0.004  # [s] by which an encoder's speed may lag behind an accelerometer
_BIAS = 0.03  # [m/s²] permitted bias of an accelerometer over many runs
_RUN_BIAS = 0.02  # [m/s²] bias of a healthy accelerometer in one run

NOISY = ("current", "wheel_speed", "carriage_speed", "carriage_acceleration")
SPEEDS = ("wheel_speed", "carriage_speed")
COUNTERS = ("carriage_position", "wheel_angle")
_PAIRS = (
    ("wheel_speed", "carriage_speed"),
    ("carriage_acceleration", "carriage_speed"),
    ("carriage_speed", "carriage_position"),
    ("wheel_speed", "wheel_angle"),
    ("carriage_acceleration", "wheel_speed"),
)
_INTEGRATED = frozenset(_PAIRS[1:])


def rig_suspicions(runs: Sequence[Run], rig: Rig, beyond: Sequence[str] = ()) -> Iterator[Suspicion]:
    """Yield contradictions between the channels of a rig; `beyond` as for `wrong_scales`."""
    found = {pair: _compared(runs, *pair, rig) for pair in _PAIRS}
    links = [link for pair in _PAIRS for link in _link(found[pair], *pair)]
    links += _force_link(runs, rig) or _power_link(runs)
    signs = wrong_signs(links)
    gear = rig.motor.gear_ratio
    scales = wrong_scales(
        links, ((gear, "before the gear"), (gear * 60.0 / (2.0 * np.pi), "motor's rpm")), beyond
    )
    yield from signs
    yield from scales
    spoilt = {s.channel: s.size for s in scales}
    yield from _delays(found, onsets(runs, ("current", "wheel_speed", "carriage_acceleration"), SPEEDS))
    if not (signs or {"carriage_speed", "carriage_acceleration"} & set(spoilt)):
        yield from _acceleration_bias(found["carriage_acceleration", "carriage_speed"])
    yield from current_bias(runs, "current", "current_target", SPEEDS)


def rig_time_links(runs: Sequence[Run], rig: Rig) -> list[TimeLink]:
    """Links of rates and integrals that are measured both."""
    found = []
    for x, y in _PAIRS[1:4]:
        pair = _compared(runs, x, y, rig)
        if pair is not None and abs(pair.correlation) > CLEAR:
            found.append(TimeLink((x, y), abs(pair.scale)))
    return found


def _compared(runs: Sequence[Run], x: str, y: str, rig: Rig) -> Comparison | None:
    """Comparison of y with x, wheel speeds taken at the rim."""
    at_rim = rig.wheel.radius
    stretches = []
    for run in runs:
        if x in run.columns and y in run.columns:
            time = run.time
            first, second = fill_masked(run, x), fill_masked(run, y)
            if y in COUNTERS:
                second = unwrap_counter(second)
            if y != "wheel_angle":
                first = first * (at_rim if x == "wheel_speed" else 1.0)
                second = second * (at_rim if y == "wheel_speed" else 1.0)
            if (x, y) in _INTEGRATED:
                first = integral(time, first)
            stretches += [Stretch(time[w], first[w], second[w]) for w in windows(time, _WINDOW)]
    return compare(stretches)


def _link(found: Comparison | None, x: str, y: str) -> list[Link]:
    slips = ("wheel_speed" in (x, y)) and y != "wheel_angle"
    return clear_link(found, x, y, _SLIPPING if slips else _TIGHT)


def _force_link(runs: Sequence[Run], rig: Rig) -> list[Link]:
    """Link of current and acceleration, i = (m r/(K n η)) a + b φ̇ + c sgn φ̇ + i₀."""
    motor = rig.motor
    per_ampere = motor.torque_constant * motor.gear_ratio * motor.gear_efficiency / rig.wheel.radius
    gram, slope, total = np.zeros((4, 4)), np.zeros(4), 0.0
    for run in runs:
        if not {"current", "wheel_speed", "carriage_acceleration"} <= set(run.columns):
            continue
        width = max(1, round(_AVERAGE / max(float(np.median(np.diff(run.time))), 1e-6)))
        current, speed, acceleration = (
            average_blocks(fill_masked(run, name), width)
            for name in ("current", "wheel_speed", "carriage_acceleration")
        )
        mass = float(run.conditions.get("mass", rig.rig.masses[0]))
        way = np.tanh(20.0 * speed / max(float(np.abs(speed).max(initial=0.0)), 1e-12))
        base = np.stack([mass / per_ampere * acceleration, speed, way, np.ones_like(speed)], axis=1)
        gram += base.T @ base
        slope += base.T @ current
        total += float(current @ current)
    fitted = solve_scaled(gram, slope, rcond=1e-10)
    explained = float(fitted @ slope) / max(total, 1e-300)
    weight = float(fitted[0] ** 2 * gram[0, 0]) / max(total, 1e-300)
    if explained < CLEAR or weight < _DRIVEN or fitted[0] == 0.0:
        return []
    certainty = float(np.sqrt(min(explained, 1.0)))
    return [Link("carriage_acceleration", "current", float(fitted[0]), _FORCE, certainty)]


def _power_link(runs: Sequence[Run]) -> list[Link]:
    """Link of current and wheel speed, which share their sign most of the time: the motor supplies work."""
    work = drawn = turned = 0.0
    for run in runs:
        if {"current", "wheel_speed"} <= set(run.columns):
            i, w = fill_masked(run, "current"), fill_masked(run, "wheel_speed")
            work, drawn, turned = work + i @ w, drawn + i @ i, turned + w @ w
    share = work / max(np.sqrt(drawn * turned), 1e-300)
    return (
        [Link("current", "wheel_speed", float(share), np.inf, abs(float(share)))] if abs(share) > 0.2 else []
    )


def _delays(found: dict[tuple[str, str], Comparison | None], first: Onsets) -> Iterator[Suspicion]:
    """Yield a late speed, acceleration, wheel speed or current; each disturbs its own set of comparisons."""
    pair = found["carriage_acceleration", "carriage_speed"]
    speed = _healthy_off(pair, 0.0, _LAG) if pair else 0.0
    wheel = first.lag("carriage_acceleration", "wheel_speed")
    current_first = first.lag("current", "carriage_acceleration")
    if speed > _DELAY:
        yield late("carriage_speed", speed + 0.5 * _LAG, _DELAY, "the accelerometer")
    elif speed < -_DELAY:
        yield late("carriage_acceleration", -speed + 0.5 * _LAG, _DELAY, "the carriage's speed")
    if wheel is not None and abs(speed) <= _DELAY:
        if wheel > _DELAY:
            yield late("wheel_speed", wheel, _DELAY, "the carriage's first motion")
        elif wheel < -_DELAY and current_first is None:
            first_motion, rivals = "the wheel's first motion", ("carriage_speed",)
            yield late("carriage_acceleration", -wheel, _DELAY, first_motion, rivals)
    if current_first is not None and current_first < -0.5 * _DELAY:
        yield late("current", 0.005 - current_first, _DELAY, "the first motion that it causes")


def _healthy_off(pair: Comparison, low: float, high: float) -> float:
    """Distance of a delay from its healthy band [s]; 0 where the delay is too uncertain."""
    if abs(pair.correlation) < CLEAR:
        return 0.0
    off = pair.delay - min(max(pair.delay, low), high)
    sure = np.isfinite(pair.delay_error) or abs(pair.correlation) > 0.99
    return off if sure and (not np.isfinite(pair.delay_error) or abs(off) > 3.0 * pair.delay_error) else 0.0


def _acceleration_bias(pair: Comparison | None) -> Iterator[Suspicion]:
    """Yield the accelerometer's bias, which is minus the drift of v − s ∫a dt."""
    if pair is None or abs(pair.correlation) < CLEAR:
        return
    count = len(pair.scales)
    error = max(_RUN_BIAS / np.sqrt(count), pair.drift_error if np.isfinite(pair.drift_error) else 0.0)
    allowed = max(_BIAS, 4.0 * error)
    bias = -pair.drift / pair.scale
    if abs(bias) > allowed:
        off = f"carriage_acceleration is off by {bias:+.3f} m/s² against the change of the carriage's speed"
        words = f"{off}; a rail that is not level explains it as well"
        strength = min(float(abs(bias) / allowed), SLOPE)
        yield Suspicion("carriage_acceleration", "bias", float(bias), strength, words)
