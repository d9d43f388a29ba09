"""A plant for tests of the search: m v̇ = u − c v − F tanh(v/ε), a force drives a mass; compiled Euler.

Its effects: more dry friction, quadratic drag, a wrong mass, a wrong speed scale.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numba import njit

from omnimj.estimate.replay.interface import (
    KNOTS,
    MOST_EFFECTS,
    BaseParameter,
    CandidateEffect,
    CandidateParameter,
    Channel,
    Experiment,
    Segment,
    Setting,
    Structure,
    average_blocks,
)
from omnimj.signals import Array

STEP, SIZE = 0.002, 10


@njit(error_model="numpy")
def _driven(inputs, numbers, over_speed, table):
    """Speed after every step, shape (runs, steps); the table is a further force over speed or time."""
    mass, viscous, dry, drag = numbers
    found = np.empty_like(inputs)
    runs, steps = inputs.shape
    for run in range(runs):
        v = 0.0
        for k in range(steps):
            force = inputs[run, k] - viscous * v - dry * math.tanh(v / 0.02) - drag * v * abs(v)
            share = (v + 3.0) / 6.0 if over_speed else k / steps
            place = min(max(share, 0.0), 1.0) * (len(table) - 1)
            knot = min(int(place), len(table) - 2)
            force += table[knot] + (place - knot) * (table[knot + 1] - table[knot])
            v += STEP * force / mass
            found[run, k] = v
    return found


class Toy:
    """A replay."""

    plant = "toy"
    channels = (Channel("speed", "m/s", "speed"),)
    base = (BaseParameter("viscous", "N.s/m", 1.0, 0.8, 1.2), BaseParameter("dry", "N", 0.5, 0.4, 0.6))
    curves: Mapping[str, float] = {"speed": 0.3, "time": 0.3}
    most_effects, backward_elimination, notes = MOST_EFFECTS, False, ()
    structures: tuple[Structure, ...] = ()

    def __init__(self, truth: Mapping[str, Array], seed: int = 0, noise: float = 0.002, base=(1.05, 0.47)):
        shape = {
            "coulomb": CandidateParameter("force", "N", -0.4, 3.0, 0.3, 0.0),
            "air_drag": CandidateParameter("coefficient", "N.s2/m2", 0.0, 5.0, 0.3, 0.0),
            "payload": CandidateParameter("mass", "kg", -0.5, 2.0, 0.2, 0.0),
            "velocity_scale": CandidateParameter("scale", "1", 0.5, 1.5, 1.05, 1.0),
        }
        self.candidates = tuple(
            CandidateEffect(name, name, name, (s,), is_sensor=name.endswith("scale"))
            for name, s in shape.items()
        )
        self._inputs, segments, row = [], [], 0
        random = np.random.default_rng(seed)
        for k in range(12):
            t = np.asarray(np.arange(1500) * STEP, float)
            u = (2.0 + 0.5 * (k // 2)) * np.sign(np.sin((1.2 + 0.3 * (k // 4)) * t + 1e-9))
            self._inputs.append(u)
            count = len(t) // SIZE
            segments.append(Segment(f"run_{k}", f"c{k // 2}", row, row + count, average_blocks(t, SIZE)))
            row += count
        self.segments = tuple(segments)
        (clean,) = self.simulate([Setting(np.array(base), truth)])
        self.measured = clean + noise * random.standard_normal(clean.shape)

    def simulate(self, settings: Sequence[Setting]) -> list[Array]:
        def effect(setting: Setting, name: str, vanishing: float = 0.0) -> float:
            return float(setting.effects[name][0]) if name in setting.effects else vanishing

        none, found = np.zeros(KNOTS), []
        for s in settings:
            name, table = s.curve if s.curve is not None else ("", none)
            dry = s.base[1] + effect(s, "coulomb")
            numbers = (1.0 + effect(s, "payload"), s.base[0], dry, effect(s, "air_drag"))
            v = _driven(np.array(self._inputs), numbers, name == "speed", np.asarray(table, float))
            v *= effect(s, "velocity_scale", 1.0)
            found.append(np.concatenate([average_blocks(row, SIZE) for row in v])[:, None])
        return found

    def simulate_twin(self, setting: Setting) -> Array | None:
        return None

    def regimes(self):
        time = np.concatenate([p.time for p in self.segments])
        return {"time": ("s", time), "speed": ("m/s", self.measured[:, 0])}

    def candidate_experiments(self) -> tuple[Experiment, ...]:
        return ()

    def predict(self, settings: Sequence[Setting], experiment: Experiment) -> list[Array]:
        return []
