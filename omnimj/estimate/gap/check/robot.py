"""Relations between the channels of a robot: heading and gyro, wheels and body motion.

Body speed comes from the accelerometer alone, rotated by the gyro: v(t) = Rᵀ(v₀ + ∫R (a − b) dt), with v₀
and b free in every window. Wheels of a healthy robot lead by some 25 ms, since they slip before they drive.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from omnimj.estimate.gap.check.columns import acceleration_bias, current_bias, fill_masked
from omnimj.estimate.gap.check.compare import (
    CLEAR,
    Comparison,
    Stretch,
    clear_link,
    compare,
    integral,
    solve_scaled,
    windows,
)
from omnimj.estimate.gap.check.suspicions import Link, Suspicion, late, wrong_scales, wrong_signs
from omnimj.estimate.gap.check.time_base import TimeLink
from omnimj.estimate.replay.interface import average_blocks
from omnimj.parameters import Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.recording.dataset import Run
from omnimj.signals import Array

_BLOCK = 0.01  # [s] that one row covers
_ADDED = 0.1  # share of a wheel's motion that the accelerometer must explain beyond the gyro
_WINDOW = 4.0  # [s]
_TRUSTED = 0.8  # correlation of a wheel with integrated acceleration from which on its scale counts
_TIGHT = np.log(1.05)
_SLIPPING = np.log(1.5)
_BODY = np.log(1.25)  # permitted |log| of the scale between a wheel and integrated acceleration
_TURNING = 0.2  # smallest share of a commanded change of the yaw rate in the wheel speeds
_DELAY = 0.012  # [s] permitted delay between heading and gyro
_GYRO_BIAS = 0.006  # [rad/s]
_FITS = 0.45  # largest share of the misfit that a better explanation leaves
_RIVAL = 1.5  # misfit relative to the best, up to which an explanation is as good
_MISFIT = 0.1  # largest unexplained share of the wheels' motion of a healthy robot
_STANDS = 0.3  # share of the usual wheel speed below which a wheel does not drive
_DRIVES = 0.25  # smallest share of |current| |speed| that is work, for a driving motor


@dataclass(frozen=True)
class BodyWindow:
    """Stretch of one run over which the unknown initial velocity and the sensors' biases are constant."""

    wheels: Array
    """Wheel speeds, shape (n, wheels) [rad/s]."""
    yaw_rate: Array
    """Yaw rate by the gyro, shape (n,) [rad/s]."""
    along: Array
    """Body speed gained from the x and the y axis of the accelerometer, shape (2, n, 2) [m/s]."""
    free: Array
    """Body speed contributed by unit initial velocities and biases, shape (4, n, 2)."""


def body_windows(runs: Sequence[Run], wheels: int, gyro: float, longest: float) -> list[BodyWindow]:
    """Cut runs into windows.

    Args:
      gyro: Known scale error of the gyro.
      longest: Largest length of a window [s].
    """
    found = []
    for run in runs:
        time = run.time
        step = max(float(np.median(np.diff(time))), 1e-6)
        size = max(1, round(_BLOCK / step))
        names = [f"wheel_speed_{k + 1}" for k in range(wheels)]
        columns = [*names, "yaw_rate", "acceleration_x", "acceleration_y"]
        table = np.stack([fill_masked(run, n) for n in columns], axis=1)
        found += [_window(time[w], table[w], wheels, gyro, size) for w in windows(time, longest)]
    return [p for p in found if len(p.yaw_rate) > 20]


def _window(time: Array, table: Array, wheels: int, gyro: float, size: int) -> BodyWindow:
    rate = table[:, wheels] / gyro
    theta = integral(time, rate)
    c, s = np.cos(theta), np.sin(theta)

    def gained(x: Array, y: Array) -> Array:
        """Rᵀ∫R a dt, shape (n, 2)."""
        east, north = integral(time, c * x - s * y), integral(time, s * x + c * y)
        return np.stack([c * east + s * north, c * north - s * east], axis=1)

    zero, one = np.zeros_like(time), np.ones_like(time)
    along = [gained(table[:, wheels + 1], zero), gained(zero, table[:, wheels + 2])]
    free = [np.stack([c, -s], axis=1), np.stack([s, c], axis=1), gained(one, zero), gained(zero, one)]
    return BodyWindow(
        average_blocks(table[:, :wheels], size),
        average_blocks(rate, size),
        np.stack([average_blocks(v, size) for v in along]),
        np.stack([average_blocks(v, size) for v in free]),
    )


def _required_speed(part: BodyWindow, row: Array, axes: Array) -> tuple[Array, Array]:
    """Speed expected of a wheel with a row of the rolling matrix, initial velocity and biases projected out.

    Returns:
      The speed, shape (n,), and the basis that was projected out, shape (n, 4).
    """
    basis = np.linalg.qr((part.free @ row[:2]).T)[0]
    expected = axes[0] * part.along[0] @ row[:2] + axes[1] * part.along[1] @ row[:2] + row[2] * part.yaw_rate
    return expected - basis @ (basis.T @ expected), basis


def unexplained_share(
    parts: Sequence[BodyWindow], rolling: Array, order: Sequence[int], signs: Array, axes: Array
) -> float:
    """Share of the wheels' motion that the body motion does not explain.

    Each wheel has its own positive scale.

    Args:
      rolling: Rolling speed per body twist over the radius, shape (wheels, 3).
      order: Assumed wheel of each column.
      signs: Assumed sign of each column, shape (wheels,).
      axes: Assumed signs of the accelerometer's x and y, shape (2,).
    """
    left = total = 0.0
    for k, wheel in enumerate(order):
        xy = xx = yy = 0.0
        for part in parts:
            x, basis = _required_speed(part, rolling[wheel], axes)
            y = signs[k] * part.wheels[:, k]
            y = y - basis @ (basis.T @ y)
            xy, xx, yy = xy + x @ y, xx + x @ x, yy + y @ y
        left += yy - max(xy, 0.0) ** 2 / max(xx, 1e-300)
        total += yy
    return float(left / max(total, 1e-300))


def wheel_scales(parts: Sequence[BodyWindow], rolling: Array, count: int) -> list[tuple[float, float]]:
    """Scale of every wheel against the accelerometer axis along which it drives, and its certainty.

    Gyro and both axes each have their own factor, so that the unit of one does not disturb the others. The
    certainty is the correlation with all three, 0 where the axis contributes little. `rolling`: rolling speed
    per body twist over the radius, shape (wheels, 3).
    """
    found = []
    for k in range(count):
        own = int(abs(rolling[k, 1]) > abs(rolling[k, 0]))
        gram, slope, total = np.zeros((3, 3)), np.zeros(3), 0.0
        for part in parts:
            basis = np.linalg.qr((part.free @ rolling[k, :2]).T)[0]
            columns = np.stack(
                [
                    part.along[own] @ rolling[k, :2],
                    part.along[1 - own] @ rolling[k, :2],
                    rolling[k, 2] * part.yaw_rate,
                ]
            )
            columns = columns - (columns @ basis) @ basis.T
            y = part.wheels[:, k] - basis @ (basis.T @ part.wheels[:, k])
            gram, slope, total = gram + columns @ columns.T, slope + columns @ y, total + float(y @ y)
        factors, others = (solve_scaled(gram[k:, k:], slope[k:], rcond=1e-8) for k in (0, 1))
        whole = float(factors @ slope)
        adds = whole - float(others @ slope[1:]) > _ADDED * total
        found.append(
            (float(factors[0]), float(np.sqrt(max(whole / max(total, 1e-300), 0.0))) if adds else 0.0)
        )
    return found


def noisy(wheels: int) -> tuple[str, ...]:
    """Names of the channels whose sensor noise is always visible."""
    per_wheel = [f"{name}_{i}" for name in ("current", "wheel_speed") for i in range(1, wheels + 1)]
    return (*per_wheel, "acceleration_x", "acceleration_y", "yaw_rate")


def robot_suspicions(runs: Sequence[Run], robot: Robot, beyond: Sequence[str] = ()) -> Iterator[Suspicion]:
    """Yield contradictions between the channels of a robot; `beyond` as for `wrong_scales`."""
    rolling = rolling_matrix(robot.wheel_positions, robot.drive_directions) / robot.wheel.radius
    count = len(robot.wheels)
    speeds = tuple(f"wheel_speed_{i}" for i in range(1, count + 1))
    turning = list(_turning(runs, rolling, count, beyond))
    gyro = next(
        (s.size for s in turning if s.channel == "yaw_rate" and s.kind in ("scale", "unit", "sign")), 1.0
    )
    # all wheels in another unit or of the other sign: then no single one is to blame
    every = next(
        (s.size for s in turning if s.channel == "wheel_speed" and s.kind in ("unit", "sign") and s.is_sure),
        1.0,
    )
    parts = body_windows(runs, count, gyro, _WINDOW)
    wheels = list(_best_explanation(parts, every * rolling, count)) if parts else []
    if parts and not wheels:
        wheels = list(_scales(parts, every * rolling, count, beyond))
    # a wrong wheel disturbs the yaw rate of all wheels and the work of its current
    is_wheel = any(s.channel.startswith("wheel_speed") and s.is_sure for s in wheels)
    yield from wheels
    yield from (s for s in turning if every != 1.0 or not (is_wheel and s.channel == "wheel_speed"))
    if not is_wheel:
        yield from _currents(runs, count, 1.0 if every > 0.0 else -1.0)
        yield from _late_wheels(runs, rolling, count)
    for name in ("acceleration_x", "acceleration_y"):
        yield from acceleration_bias(runs, name, speeds)
    for i in range(1, count + 1):
        yield from current_bias(runs, f"current_{i}", f"current_target_{i}", speeds)


def _late_wheels(runs: Sequence[Run], rolling: Array, count: int) -> Iterator[Suspicion]:
    """Yield the wheel that is late against the body motion of the other wheels, of four or more."""
    found = []
    for k in range(count if count > 3 else 0):
        others = [j for j in range(count) if j != k]
        row = rolling[k] @ np.linalg.pinv(rolling[others])
        stretches = []
        for run in runs:
            speeds = np.stack([fill_masked(run, f"wheel_speed_{j + 1}") for j in others])
            own, expected = fill_masked(run, f"wheel_speed_{k + 1}"), row @ speeds
            stretches += [Stretch(run.time[w], expected[w], own[w]) for w in windows(run.time, _WINDOW)]
        pair = compare(stretches)
        if pair is not None and abs(pair.correlation) > CLEAR and np.isfinite(pair.delay_error):
            found.append((pair.delay, pair.delay_error, k))
    # the others seem early against the late one, each by less
    delay, error, k = max(found, default=(0.0, 0.0, 0))
    if delay > max(_DELAY, 3.0 * error):
        yield late(f"wheel_speed_{k + 1}", delay, _DELAY, "the motion of the other wheels")


def robot_time_links(runs: Sequence[Run], robot: Robot) -> list[TimeLink]:
    """Links of the gyro with the heading, and of the accelerometer with the wheels."""
    rolling = rolling_matrix(robot.wheel_positions, robot.drive_directions) / robot.wheel.radius
    count = len(robot.wheels)
    found = []
    by_heading, _ = _compared_turning(runs, rolling, count)
    if by_heading is not None and abs(by_heading.correlation) > CLEAR:
        found.append(TimeLink(("yaw_rate", "yaw"), abs(by_heading.scale)))
    parts = body_windows(runs, count, 1.0, _WINDOW)
    clear = [
        abs(scale) for scale, r in (wheel_scales(parts, rolling, count) if parts else ()) if r > _TRUSTED
    ]
    if clear:
        found.append(TimeLink(("acceleration", "wheel_speed"), float(np.median(clear))))
    return found


def _compared_turning(
    runs: Sequence[Run], rolling: Array, count: int
) -> tuple[Comparison | None, Comparison | None]:
    """Comparisons of the heading with the integrated gyro, and of the wheels' yaw rate with the gyro."""
    inverse = np.linalg.pinv(rolling)[2]
    heading, wheels = [], []
    for run in runs:
        time = run.time
        rate, angle = fill_masked(run, "yaw_rate"), _joined(fill_masked(run, "yaw"))
        own = sum(inverse[k] * fill_masked(run, f"wheel_speed_{k + 1}") for k in range(count))
        turned = integral(time, rate)
        for w in windows(time, _WINDOW):
            heading.append(Stretch(time[w], turned[w], angle[w]))
            wheels.append(Stretch(time[w], rate[w], np.asarray(own)[w]))
    by_wheels = compare(wheels) if _turns(wheels, runs, rolling) else None
    return compare(heading), by_wheels


def _turns(stretches: Sequence[Stretch], runs: Sequence[Run], rolling: Array) -> bool:
    """True if the wheels turn the robot on purpose; a yaw loop that holds the heading drives them against it.

    Then the yaw rate of the wheels has a clear share in their speeds, and its sign is that of its changes.
    """
    whole = sum(float(part.x @ part.y) for part in stretches)
    changes = [(part.x - part.x.mean(), part.y - part.y.mean()) for part in stretches]
    turned = sum(float(y @ y) for _, y in changes) * float((rolling[:, 2] ** 2).sum())
    driven = sum(
        float((fill_masked(run, f"wheel_speed_{k + 1}") ** 2).sum())
        for run in runs
        for k in range(len(rolling))
    )
    return turned > _TURNING**2 * driven and whole * sum(float(x @ y) for x, y in changes) > 0.0


def _turning(runs: Sequence[Run], rolling: Array, count: int, beyond: Sequence[str]) -> Iterator[Suspicion]:
    """Yield contradictions between heading, gyro and the yaw rate of the wheels."""
    by_heading, by_wheels = _compared_turning(runs, rolling, count)
    links = [
        *clear_link(by_heading, "yaw_rate", "yaw", _TIGHT),
        *clear_link(by_wheels, "yaw_rate", "wheel_speed", _SLIPPING),
    ]
    if any(name.startswith("wheel_speed") for name in beyond):
        beyond = (*beyond, "wheel_speed")
    found = [*wrong_signs(links), *wrong_scales(links, beyond=beyond)]
    yield from found
    if by_heading is None or abs(by_heading.correlation) < CLEAR:
        return
    delay = by_heading.delay
    if abs(delay) > max(_DELAY, 3.0 * by_heading.delay_error):
        channel, other = ("yaw", "yaw_rate") if delay > 0.0 else ("yaw_rate", "yaw")
        yield late(channel, abs(delay), _DELAY, other)
    bias = -by_heading.drift / by_heading.scale
    error = by_heading.drift_error if np.isfinite(by_heading.drift_error) else 0.0
    allowed = max(_GYRO_BIAS, 4.0 * error / abs(by_heading.scale))
    if not found and abs(bias) > allowed:
        words = f"yaw_rate is off by {bias:+.4f} rad/s against the change of the heading"
        yield Suspicion("yaw_rate", "bias", float(bias), float(abs(bias) / allowed), words)


def _joined(angle: Array) -> Array:
    """Heading without jumps, for converters in radians or in degrees."""
    turn = (
        360.0 if float(np.ptp(angle)) > 7.0 and float(np.abs(np.diff(angle)).max()) > 180.0 else 2.0 * np.pi
    )
    return np.unwrap(angle, period=turn) if float(np.abs(np.diff(angle)).max()) > 0.5 * turn else angle


def _best_explanation(parts: Sequence[BodyWindow], rolling: Array, count: int) -> Iterator[Suspicion]:
    """Yield a wrong sign or two swapped wheels, where that explains the wheels far better."""
    wheels = list(range(count))
    plain = unexplained_share(parts, rolling, wheels, np.ones(count), np.ones(2))
    options: list[tuple[float, str, str, tuple[str, ...]]] = []
    for k in wheels:
        signs = np.ones(count)
        signs[k] = -1.0
        name = f"wheel_speed_{k + 1}"
        options.append((unexplained_share(parts, rolling, wheels, signs, np.ones(2)), "sign", name, ()))
    for k, name in enumerate(("acceleration_x", "acceleration_y")):
        axes = np.ones(2)
        axes[k] = -1.0
        options.append((unexplained_share(parts, rolling, wheels, np.ones(count), axes), "sign", name, ()))
    both = unexplained_share(parts, rolling, wheels, np.ones(count), -np.ones(2))
    options.append((both, "sign", "acceleration", ()))
    for a, b in itertools.combinations(wheels, 2):
        order = list(wheels)
        order[a], order[b] = b, a
        misfit = unexplained_share(parts, rolling, order, np.ones(count), np.ones(2))
        options.append((misfit, "swapped", f"wheel_speed_{a + 1}", (f"wheel_speed_{b + 1}",)))
    options.sort(key=lambda s: s[0])
    best = options[0]
    if plain < _MISFIT or best[0] > _FITS * plain:
        return
    rivals = [s for s in options[1:] if s[0] < _RIVAL * max(best[0], 0.005)]
    others = tuple(sorted({n for s in rivals for n in (s[2], *s[3])} - {best[2]}))
    what = f"and {best[3][0]} are swapped" if best[3] else "has the wrong sign"
    what = "has the wrong sign on both axes" if best[2] == "acceleration" else what
    rest = f"; others explain it as well: {', '.join(others)}" if others else ""
    left = f"{100 * best[0]:.0f} % of the wheels' motion is then unexplained, not {100 * plain:.0f} %"
    words = f"{best[2]} {what}: {left}{rest}"
    size = float(best[3][0].rsplit("_", 1)[1]) if best[3] else -1.0
    yield Suspicion(best[2], best[1], size, plain / max(best[0], 0.02), words, others)


def _scales(
    parts: Sequence[BodyWindow], rolling: Array, count: int, beyond: Sequence[str]
) -> Iterator[Suspicion]:
    along_x = np.abs(rolling[:, 0]) > np.abs(rolling[:, 1])
    links = []
    for k, (scale, correlation) in enumerate(wheel_scales(parts, rolling, count)):
        axis = "acceleration_x" if along_x[k] else "acceleration_y"
        if correlation > _TRUSTED:
            links.append(Link(axis, f"wheel_speed_{k + 1}", scale, _BODY, correlation))
    yield from wrong_scales(links, beyond=beyond)


def _currents(runs: Sequence[Run], count: int, sign: float) -> Iterator[Suspicion]:
    """Yield swapped or reversed currents: a motor works on its own wheel; sign −1 turns all speeds round."""
    work, drawn, turned = np.zeros((count, count)), np.zeros(count), np.zeros(count)
    for run in runs:
        i = np.stack([fill_masked(run, f"current_{k + 1}") for k in range(count)])
        w = np.stack([fill_masked(run, f"wheel_speed_{k + 1}") for k in range(count)])
        work += sign * i @ w.T
        drawn += (i * i).sum(axis=1)
        turned += (w * w).sum(axis=1)
    share = work / np.maximum(np.sqrt(np.outer(drawn, turned)), 1e-300)
    own = np.diagonal(share)
    order = linear_sum_assignment(-share)[1]
    moved = np.flatnonzero(order != np.arange(count))
    if len(moved) == 2 and share[np.arange(count), order].sum() - own.sum() > 2.0 * _DRIVES:
        a, b = (int(k) + 1 for k in moved)
        rivals = (f"wheel_speed_{a}", f"wheel_speed_{b}") if (own[moved] < -_DRIVES).all() else ()
        words = f"current_{a} and current_{b} are swapped: each drives the other's wheel"
        strength = float(share[np.arange(count), order].sum() - own.sum()) / _DRIVES
        yield Suspicion(f"current_{a}", "swapped", float(b), strength, words, rivals)
        return
    drives = turned > _STANDS**2 * np.median(turned)  # a wheel that is held still is braked by its current
    for k in np.flatnonzero((own < -_DRIVES) & drives):
        name = f"current_{k + 1}"
        words = f"{name} has the wrong sign: it would brake its wheel all the time"
        yield Suspicion(name, "sign", -1.0, float(-own[k] / _DRIVES) + 1.0, words)
