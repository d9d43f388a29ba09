"""Relations between the channels of any machine: velocity and position of a joint, input and motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from omnimj.estimate.gap.check.columns import column_suspicions
from omnimj.estimate.gap.check.compare import CLEAR, TIGHT, clear_link, late_velocity, velocity_comparison
from omnimj.estimate.gap.check.magnitudes import Limit, beyond_reach, magnitude_suspicions
from omnimj.estimate.gap.check.slide import is_slide, slide_suspicions, slide_time_links
from omnimj.estimate.gap.check.suspicions import GROSS, Suspicion, wrong_scales, wrong_signs
from omnimj.estimate.gap.check.time_base import TimeLink
from omnimj.plant.mujoco.machine import Machine
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array

_EXPLAINS = 0.3  # share of an input's variance that only the motion of the links explains


def machine_suspicions(dataset: Dataset, machine: Machine) -> Iterator[Suspicion]:
    """Yield defects of the columns and contradictions between them."""
    names = [f"position:{joint}" for joint in machine.joints]
    speeds = [f"velocity:{joint}" for joint in machine.joints]
    inputs = [f"{kind}:{drive.name}" for drive in machine.drives for kind in ("force", "control")]
    powered = replace(dataset, runs=[_powered(run, machine) for run in dataset.runs])
    yield from column_suspicions(powered, (*names, *speeds, *inputs), (*speeds, *names), names)
    large = list(magnitude_suspicions(powered.runs, tuple(_limits(machine)), (*speeds, *names)))
    yield from large
    if is_slide(machine):
        yield from slide_suspicions(powered.runs, machine, beyond_reach(large))
        return
    for joint in machine.joints:
        yield from _velocity_suspicions(dataset.runs, joint)
    yield from _input_suspicions(dataset, machine)


def _limits(machine: Machine) -> Iterator[Limit]:
    """Limits of joints and actuators, where the MJCF file states them."""
    m = machine.mj_model
    for j, joint in enumerate(machine.joints):
        if m.jnt_limited[j]:
            low, high = m.jnt_range[j].tolist()
            words = f"the range of {joint} is {low:.4g} to {high:.4g}"
            half = 0.5 * (high - low)
            yield Limit(f"position:{joint}", half, half, words, True)
    for drive in machine.drives:
        kinds = {"force": drive.force_range, "control": drive.command_range}
        for kind, ends in kinds.items():
            most = max(abs(end) for end in ends)
            if np.isfinite(most):
                words = f"the largest {kind} of {drive.name} is {most:.4g}"
                yield Limit(f"{kind}:{drive.name}", most, most, words)


def _powered(run: Run, machine: Machine) -> Run:
    """The run with the inputs of actuators masked where these are off."""
    masked = dict(run.masked)
    for drive in machine.drives:
        enabled = run.columns.get(f"enabled:{drive.name}")
        for name in (f"force:{drive.name}", f"control:{drive.name}"):
            if enabled is not None and name in run.columns:
                off = np.asarray(enabled) < 0.5
                masked[name] = np.asarray(masked.get(name, np.zeros(len(off), bool))) | off
    return replace(run, masked=masked)


def _velocity_suspicions(runs: Sequence[Run], joint: str) -> Iterator[Suspicion]:
    pair = velocity_comparison(runs, joint)
    if pair is None or abs(pair.correlation) <= CLEAR:
        return
    links = clear_link(pair, f"velocity:{joint}", f"position:{joint}", TIGHT)
    yield from wrong_signs(links)
    yield from wrong_scales(links)
    yield from late_velocity(pair, joint)


def _input_suspicions(dataset: Dataset, machine: Machine) -> Iterator[Suspicion]:
    """Inputs that act against the motion that they cause, or that are far from what it needs."""
    from omnimj.estimate.replay.mjcf.replay import MachineReplay  # loads MuJoCo

    servos = {f"control:{drive.name}" for drive in machine.drives if drive.position_gain}
    for name, balance in MachineReplay(dataset, machine).input_balances().items():
        scale, share = _scale(*balance)
        if share < _EXPLAINS:
            continue
        if scale < 0.0:
            words = f"{name} acts against the motion that it causes: it has the wrong sign"
            yield Suspicion(name, "sign", -1.0, 4.0 * share, words)
        elif abs(np.log(scale)) > GROSS:
            words = f"{name} is {scale:.4g} times the value that the motion of the links needs"
            others = () if name in servos else ("masses of the model",)
            yield Suspicion(name, "unit", scale, abs(np.log(scale)) / GROSS, words, others)


def _scale(force: Array, rigid: Array, speed: Array) -> tuple[float, float]:
    """Scale s of F = s R + b v + C sgn v + F_0, and the share of F's variance that only R explains."""
    top = max(float(np.abs(speed).max()), 1e-12)
    others = np.stack([speed, np.tanh(20.0 * speed / top), np.ones_like(speed)], axis=1)
    rest = [y - others @ np.linalg.lstsq(others, y, rcond=None)[0] for y in (force, rigid)]
    squares = float(rest[1] @ rest[1])
    if squares <= 0.0:
        return 1.0, 0.0
    scale = float(rest[1] @ rest[0]) / squares
    whole = max(float(((force - force.mean()) ** 2).sum()), 1e-300)
    return scale, scale * scale * squares / whole


def machine_time_links(runs: Sequence[Run], machine: Machine) -> list[TimeLink]:
    """Links of velocities with the change of positions, and of a slide's input with its motion."""
    found = slide_time_links(runs, machine) if is_slide(machine) else []
    for joint in machine.joints:
        pair = velocity_comparison(runs, joint)
        if pair is not None and abs(pair.correlation) > CLEAR and pair.scale != 0.0:
            found.append(TimeLink((f"velocity:{joint}", f"position:{joint}"), abs(pair.scale)))
    return found
