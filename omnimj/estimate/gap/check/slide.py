"""Relations between the channels of a single slide: velocity and position, force and motion.

Its rigid bodies need the force m a and a constant one, so that the logs alone show the mass.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.signal import savgol_filter

from omnimj.effects.parts import BODY
from omnimj.estimate.gap.check.columns import fill_masked, unwrap_counter
from omnimj.estimate.gap.check.compare import (
    CLEAR,
    TIGHT,
    clear_link,
    late_velocity,
    solve_scaled,
    velocity_comparison,
)
from omnimj.estimate.gap.check.suspicions import Link, Suspicion, unit_of, wrong_scales, wrong_signs
from omnimj.estimate.gap.check.time_base import TimeLink
from omnimj.plant.mujoco.machine import Machine
from omnimj.plant.mujoco.quantities import is_hinge
from omnimj.recording.dataset import MASS_OF, Run
from omnimj.signals import Array

_FORCE_DELAY = 0.008  # [s] largest healthy delay between motion and force
_SMOOTH = 0.03  # [s] filter length for differentiating a position
_MASS = np.log(3.0)  # permitted |log| of implied over declared mass
_FAR = 0.1  # [s] largest delay in the search


@dataclass(frozen=True)
class _Slide:
    """Columns of the only joint and of its actuator."""

    machine: Machine
    position: str
    velocity: str
    input: str
    is_force: bool

    @property
    def force_per_unit(self) -> float:
        """Force on the joint per unit of its input."""
        (drive,) = self.machine.drives
        return drive.gear * (1.0 if self.is_force else drive.gain)

    def mass(self, run: Run) -> float:
        """Moving mass of a run, armature included [kg]."""
        model, stated = self.machine.mj_model, 0.0
        for key, value in run.conditions.items():
            if key.startswith(MASS_OF):
                stated += float(value) - self.machine.values[BODY, key.removeprefix(MASS_OF), "mass"]
        full, data = np.zeros((1, 1)), mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        return float(full[0, 0]) + stated


def _slide(runs: Sequence[Run], machine: Machine) -> _Slide:
    (joint,), (drive,) = machine.joints, machine.drives
    force = f"force:{drive.name}"
    is_force = all(force in run.columns for run in runs)
    name = force if is_force else f"control:{drive.name}"
    return _Slide(machine, f"position:{joint}", f"velocity:{joint}", name, is_force)


def is_slide(machine: Machine) -> bool:
    """True for a machine of a single slide with an actuator that does not hold a position itself."""
    if not len(machine.joints) == len(machine.drives) == 1:
        return False
    return machine.drives[0].position_gain == 0.0 and not is_hinge(machine.mj_model, machine.joints[0])


def slide_suspicions(
    runs: Sequence[Run], machine: Machine, beyond: Sequence[str] = ()
) -> Iterator[Suspicion]:
    """Yield contradictions between the channels of a slide; `beyond` as for `wrong_scales`."""
    slide = _slide(runs, machine)
    pair = velocity_comparison(runs, machine.joints[0])
    links = []
    if pair is not None and abs(pair.correlation) > CLEAR:
        links += clear_link(pair, slide.velocity, slide.position, TIGHT)
        yield from (replace(s, or_channels=()) for s in late_velocity(pair, machine.joints[0]))
    motion = _motion(runs, slide)
    links += motion.links(slide)
    yield from wrong_signs(links)
    yield from (_settled(s, slide, beyond) for s in wrong_scales(links, beyond=beyond))
    if slide.is_force:  # an actuator may answer late
        yield from motion.late(slide)


def slide_time_links(runs: Sequence[Run], machine: Machine) -> list[TimeLink]:
    """Link of the input with the second derivative of the position: F = m a gives τ² = declared/fitted m."""
    slide = _slide(runs, machine)
    links = _motion(runs, slide).links(slide)
    return [
        TimeLink((slide.input, slide.position), float(np.sqrt(abs(link.scale))), 2)
        for link in links
        if link.scale
    ]


def _motion(runs: Sequence[Run], slide: _Slide) -> _Motion:
    """Force of the actuator, compared with the motion."""
    return _Motion.of([run for run in runs if slide.input in run.columns], slide)


def _settled(found: Suspicion, slide: _Slide, beyond: Sequence[str]) -> Suspicion:
    """Blame the position if the machine cannot reach it, else the input."""
    if {found.channel, *found.or_channels} != {slide.input, slide.position}:
        return found
    is_place = slide.position in beyond
    name, other = (slide.position, slide.input) if is_place else (slide.input, slide.position)
    size = found.size if name == found.channel else 1.0 / found.size
    size = unit_of(size, name)[0] or size
    words = f"{name} is {size:.4g} times the value implied by {slide.input} and the declared mass"
    if is_place:
        words += ", and the joint cannot reach it"
    return replace(found, channel=name, size=size, words=words, or_channels=() if is_place else (other,))


class _Motion:
    """Drive force compared with the measured motion, F = m a + b v + C sgn v + F₀."""

    def __init__(self, rows: list[tuple[Array, Array, Array, Array]], masses: list[float]):
        self._rows, self._masses = rows, masses

    @classmethod
    def of(cls, runs: Sequence[Run], slide: _Slide) -> _Motion:
        """Smooth the motion of all runs; each sample represents its smoothing window."""
        rows, masses = [], []
        for run in runs:
            step = float(np.median(np.diff(run.time)))
            place = unwrap_counter(fill_masked(run, slide.position))
            length = max(7, round(_SMOOTH / step) // 2 * 2 + 1)
            if len(place) <= 3 * length:
                continue
            speed = savgol_filter(place, length, 3, deriv=1, delta=step)
            acceleration = savgol_filter(place, length, 3, deriv=2, delta=step)
            pushed = savgol_filter(slide.force_per_unit * fill_masked(run, slide.input), length, 3)
            keep = slice(length, len(place) - length)
            rows.append((run.time[keep], pushed[keep], speed[keep], acceleration[keep]))
            masses.append(slide.mass(run))
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
        whole = solve_scaled(gram, slope, rcond=1e-10)
        scale = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
        squared = sum(float((np.interp(t - delay, t, f) ** 2).sum()) for t, f, _, _ in self._rows)
        left = max(squared - float(whole @ slope), 0.0)
        inverse = np.linalg.pinv(gram / np.outer(scale, scale))
        weight = float((whole[0] * scale[0]) ** 2 / max(inverse[0, 0], 1e-300))
        return whole, left / max(total, 1e-300), weight / max(total, 1e-300)

    def links(self, slide: _Slide) -> list[Link]:
        """Return the link of input and position: declared over fitted mass, with its sign."""
        if not self._rows:
            return []
        whole, left, weight = self._fit(0.0)
        if left > 0.5 or weight < 0.05 or whole[0] == 0.0:
            return []
        declared = float(np.mean(self._masses))
        # a position in millimetres makes the mass look a thousand times smaller
        weight = float(np.sqrt(max(1.0 - left, 0.0)))
        return [Link(slide.input, slide.position, float(declared / whole[0]), _MASS, weight)]

    def late(self, slide: _Slide) -> Iterator[Suspicion]:
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
            name = slide.position if found > 0.0 else slide.input
            words = f"{name} is {1e3 * abs(found):.0f} ms late: force and motion then fit"
            yield Suspicion(name, "delay", abs(found), abs(found) / allowed, words)
