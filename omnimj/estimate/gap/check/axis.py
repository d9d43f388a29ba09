"""Relations between the channels of a linear axis: velocity and position, force and motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import savgol_filter

from omnimj.estimate.gap.check.columns import fill_masked, unwrap_counter
from omnimj.estimate.gap.check.compare import Comparison, Stretch, compare, integral, split_stretch
from omnimj.estimate.gap.check.suspicions import Link, Suspicion, unit_of, wrong_scales, wrong_signs
from omnimj.estimate.gap.check.time_base import TimeLink
from omnimj.parameters import Axis
from omnimj.recording.dataset import Run
from omnimj.signals import Array

NOISY = ("force", "current", "velocity", "position")

_WINDOW = 4.0  # [s] longest stretch of one comparison
_CLEAR = 0.6
_TIGHT = np.log(1.04)
_DELAY = 0.004  # [s] largest healthy delay between velocity and position
_FORCE_DELAY = 0.008  # [s] largest healthy delay between motion and force
_SMOOTH = 0.03  # [s] filter length for differentiating a position
_MASS = np.log(3.0)  # permitted |log| of implied over declared mass
_DRIVES = 0.2
_FAR = 0.1  # [s] largest delay in the search
_BEYOND = 3.0  # range of a position in guide lengths, above which the position is wrong


def axis_suspicions(runs: Sequence[Run], axis: Axis, beyond: Sequence[str] = ()) -> Iterator[Suspicion]:
    """Yield contradictions between the channels of an axis.

    Args:
      runs: All runs.
      axis: Declared mass, force constant and travel.
      beyond: Channels with values that the machine cannot reach.
    """
    pair = velocity_comparison(runs)
    links = []
    if pair is not None and abs(pair.correlation) > _CLEAR:
        links.append(Link("velocity", "position", pair.scale, _TIGHT, abs(pair.correlation)))
        late = pair.delay
        error = pair.delay_error if np.isfinite(pair.delay_error) else 0.0
        if abs(late) > max(_DELAY, 3.0 * error):
            name, other = ("position", "velocity") if late > 0.0 else ("velocity", "position")
            words = f"{name} is {1e3 * abs(late):.1f} ms late against {other}"
            yield Suspicion(name, "delay", abs(late), abs(late) / _DELAY, words)
    force, motion = _motion(runs, axis)
    links += motion.links(force)
    yield from wrong_signs(links)
    yield from (_settled(s, runs, axis, force) for s in wrong_scales(links, beyond=beyond))
    yield from motion.late(force)


def axis_time_links(runs: Sequence[Run], axis: Axis) -> list[TimeLink]:
    """Links of velocity and force with the change of the position; F = m a gives τ² = declared m/fitted m."""
    found = []
    pair = velocity_comparison(runs)
    if pair is not None and abs(pair.correlation) > _CLEAR and pair.scale != 0.0:
        found.append(TimeLink(("velocity", "position"), abs(pair.scale)))
    force, motion = _motion(runs, axis)
    found += [
        TimeLink((force, "position"), float(np.sqrt(abs(link.scale))), 2)
        for link in motion.links(force)
        if link.scale
    ]
    return found


def velocity_comparison(runs: Sequence[Run]) -> Comparison | None:
    """Comparison of the position with the integrated velocity."""
    stretches = []
    for run in runs:
        if "velocity" in run.columns:
            moved = integral(run.time, fill_masked(run, "velocity"))
            place = unwrap_counter(fill_masked(run, "position"))
            size = max(60, int(_WINDOW / max(float(np.median(np.diff(run.time))), 1e-6)))
            stretches += [
                Stretch(run.time[w], moved[w], place[w]) for w in split_stretch(len(run.time), size)
            ]
    return compare(stretches) if stretches else None


def _motion(runs: Sequence[Run], axis: Axis) -> tuple[str, _Motion]:
    """Channel of the drive, and its force compared with the motion."""
    force = "force" if all("force" in run.columns for run in runs) else "current"
    constant = 1.0 if force == "force" else axis.axis.force_constant
    logged = [run for run in runs if force in run.columns]
    return force, _Motion.of(logged, force, constant, axis.axis.mass)


def _settled(found: Suspicion, runs: Sequence[Run], axis: Axis, force: str) -> Suspicion:
    """Blame the position if its range exceeds the length of the guide, else the force."""
    if {found.channel, *found.or_channels} != {force, "position"}:
        return found
    far = max(float(np.ptp(fill_masked(run, "position"))) for run in runs)
    is_place = far > _BEYOND * 2.0 * axis.axis.travel
    name, other = ("position", force) if is_place else (force, "position")
    size = found.size if name == found.channel else 1.0 / found.size
    size = unit_of(size, name)[0] or size
    words = f"{name} is {size:.4g} times the value implied by {force} and the declared mass"
    if is_place:
        words += f", and a travel of {far:.4g} m is beyond the guide"
    return replace(found, channel=name, size=size, words=words, or_channels=() if is_place else (other,))


class _Motion:
    """Drive force compared with the measured motion, F = m a + b v + C sgn v + F₀."""

    def __init__(self, rows: list[tuple[Array, Array, Array, Array]], masses: list[float]):
        self._rows, self._masses = rows, masses

    @classmethod
    def of(cls, runs: Sequence[Run], force: str, constant: float, mass: float) -> _Motion:
        """Smooth the motion of all runs; each sample represents its smoothing window."""
        rows, masses = [], []
        for run in runs:
            step = float(np.median(np.diff(run.time)))
            place = unwrap_counter(fill_masked(run, "position"))
            length = max(7, round(_SMOOTH / step) // 2 * 2 + 1)
            if len(place) <= 3 * length:
                continue
            speed = savgol_filter(place, length, 3, deriv=1, delta=step)
            acceleration = savgol_filter(place, length, 3, deriv=2, delta=step)
            pushed = savgol_filter(constant * fill_masked(run, force), length, 3)
            keep = slice(length, len(place) - length)
            rows.append((run.time[keep], pushed[keep], speed[keep], acceleration[keep]))
            declared = run.conditions.get("mass")
            masses.append(float(declared) if isinstance(declared, int | float) else mass)
        return cls(rows, masses)

    def _fit(self, delay: float) -> tuple[Array, float, float]:
        """Return the fitted m, b, C and F₀, the unexplained share and the weight of the acceleration term."""
        gram, slope, total = np.zeros((4, 4)), np.zeros(4), 0.0
        for time, force, speed, acceleration in self._rows:
            pushed = np.interp(time - delay, time, force)
            top = max(float(np.abs(speed).max()), 1e-12)
            base = np.stack([acceleration, speed, np.tanh(20.0 * speed / top), np.ones_like(speed)], axis=1)
            gram += base.T @ base
            slope += base.T @ pushed
            total += float(((pushed - pushed.mean()) ** 2).sum())
        scale = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
        whole = np.linalg.lstsq(gram / np.outer(scale, scale), slope / scale, rcond=1e-10)[0] / scale
        squared = sum(float((np.interp(t - delay, t, f) ** 2).sum()) for t, f, _, _ in self._rows)
        left = max(squared - float(whole @ slope), 0.0)
        inverse = np.linalg.pinv(gram / np.outer(scale, scale))
        weight = float((whole[0] * scale[0]) ** 2 / max(inverse[0, 0], 1e-300))
        return whole, left / max(total, 1e-300), weight / max(total, 1e-300)

    def links(self, force: str) -> list[Link]:
        """Return the link of force and position: declared over fitted mass, with its sign."""
        if not self._rows:
            return []
        whole, left, weight = self._fit(0.0)
        if left > 0.5 or weight < 0.05 or whole[0] == 0.0:
            return []
        declared = float(np.mean(self._masses))
        # a position in millimetres makes the mass look a thousand times smaller
        return [
            Link(force, "position", float(declared / whole[0]), _MASS, float(np.sqrt(max(1.0 - left, 0.0))))
        ]

    def late(self, force: str) -> Iterator[Suspicion]:
        """Yield a position that lags behind the force, or a force that is logged late."""
        if not self._rows:
            return
        step = float(np.median(np.diff(self._rows[0][0])))
        delays = np.arange(-_FAR, _FAR + 1e-9, max(0.002, step))
        left = np.array([self._fit(d)[1] for d in delays])
        k = int(left.argmin())
        found, now = float(delays[k]), float(self._fit(0.0)[1])
        allowed = max(_FORCE_DELAY, 2.0 * step)
        if 0 < k < len(delays) - 1 and abs(found) > allowed and left[k] < 0.5 * now and left[k] < 0.2:
            name = "position" if found > 0.0 else force
            words = f"{name} is {1e3 * abs(found):.0f} ms late: force and motion then fit"
            yield Suspicion(name, "delay", abs(found), abs(found) / allowed, words)
