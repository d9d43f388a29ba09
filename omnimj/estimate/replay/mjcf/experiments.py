"""Motions of one joint that a user could make, and the inputs that they need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from omnimj.effects.parts import BODY, Part
from omnimj.estimate.replay.interface import Experiment
from omnimj.estimate.replay.mjcf.log import MachineLog
from omnimj.estimate.replay.mjcf.settings import Spans, held_mass
from omnimj.plant.mujoco.machine import Machine
from omnimj.signals import Array

_LENGTH = 8.0  # [s]
_LOAD = 0.5  # added mass over that of the bodies, or over what the measured forces hold
# share of the measured range, and of the joint's top speed
_MOVES = {
    "slow sweep": (1.0, 0.05, "slowly over the whole range and back"),
    "fast sine": (1.0, 1.0, "in a sine over the whole range at full speed"),
    "short fast sine": (0.15, 1.0, "in a sine over a seventh of the range at full speed"),
    "creeping sine": (0.15, 0.05, "in a slow sine over a seventh of the range"),
}


def machine_experiments(machine: Machine, spans: Spans) -> tuple[Experiment, ...]:
    """Candidate motions of every excited joint; the other joints stay in the middle of their range."""
    found = []
    for joint in machine.joints:
        if spans[joint].is_excited:
            for name, (_, _, words) in _MOVES.items():
                about = {"joint": joint, "move": name, "duration": _LENGTH}
                found.append(Experiment(f"{name} of {joint}", f"move {joint} {words}", about))
    if len(machine.joints) == 1 and machine.parts(BODY):
        added = _load(machine, spans)
        found += [_loaded(one, added) for one in found]
    return tuple(found)


def _load(machine: Machine, spans: Spans) -> float:
    """Mass to put on the last body [kg]: a light link under a strong motor needs more than its own weight."""
    own = float(machine.mj_model.body_mass.sum())
    return float(f"{_LOAD * max(own, held_mass(machine, machine.parts(BODY)[-1], spans)):.2g}")


def _loaded(plain: Experiment, added: float) -> Experiment:
    """Motion with a mass put on [kg]: separates effects that scale with mass from those that do not."""
    run = {**plain.run, "added_mass": added}
    return Experiment(f"{plain.name}, loaded", f"{plain.words}, {added:g} kg put on", run)


def added_masses(machine: Machine, experiment: Experiment) -> list[dict[Part, float]]:
    """Stated masses of a candidate motion, as `columns.stated_masses`, of its one stretch."""
    if "added_mass" not in experiment.run:
        return []
    part = (BODY, machine.parts(BODY)[-1], "mass")
    return [{part: machine.values[part] + float(experiment.run["added_mass"])}]


def moved_log(log: MachineLog, joints: Sequence[str], spans: Spans, experiment: Experiment) -> MachineLog:
    """Log of a candidate motion, without inputs.

    Args:
      log: Measured logs, whose clock and filters it has.
    """
    share, pace, _ = _MOVES[str(experiment.run["move"])]
    count = round(float(experiment.run["duration"]) / log.period) // log.size * log.size
    times = np.arange(count) * log.period
    shape = (count, len(joints))
    position, speed, acceleration = np.empty(shape), np.zeros(shape), np.zeros(shape)
    for j, name in enumerate(joints):
        span = spans[name]
        position[:, j] = 0.5 * (span.low + span.high)
        if name == experiment.run["joint"]:
            reach = 0.5 * share * (span.high - span.low)
            rate = pace * span.speed / reach
            position[:, j] += reach * np.sin(rate * times)
            speed[:, j] = reach * rate * np.cos(rate * times)
            acceleration[:, j] = -reach * rate * rate * np.sin(rate * times)
    nothing: Array = np.full(shape, np.nan)
    return replace(
        log,
        stretches=np.array([(0, count, 0, 1)]),
        windows=np.array([(0, count, 0)]),
        run_of_stretch=(0,),
        times=times,
        position=position,
        speed=speed,
        acceleration=acceleration,
        balanced_speed=speed,
        limited_speed=speed,
        inputs=np.zeros(shape),
        enabled=np.ones(shape, bool),
        velocity=nothing,
        sensors=np.zeros((count, log.sensors.shape[1])),
        valid=np.ones(shape, bool),
    )
