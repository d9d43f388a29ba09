"""What holds for every effect of the catalogue, on every plant that simulates it."""

import numpy as np
import pytest
from driven_plants import RIG, RIG_CASES, ROBOT, ROBOT_CASES, plain, rig_run, robot_run, selections

from omnimj.effects import apply_effects, effects_of, with_effects

KINDS = ("planar", "twin")
LATERAL = 0.3


def run(plant, machine, kind, steps):
    if plant == "quarter_rig":
        return rig_run(machine, kind, steps, LATERAL)
    return robot_run(machine, kind, steps)


def without(plant, kind, steps):
    return plain("rig", kind, steps, LATERAL) if plant == "quarter_rig" else plain("robot", kind, steps)


CASES = [("quarter_rig", RIG, 900, *case) for case in RIG_CASES]
CASES += [("uto_robot", ROBOT, 1300, *case) for case in ROBOT_CASES]
IDS = ["-".join((plant[:5], name, *map(str, choice.values()))) for plant, _, _, name, choice in CASES]


BOTH = [
    pytest.param(*case, kind, id=f"{kind}-{label}", marks=[pytest.mark.slow] * ((place + k) % 2))
    for place, (case, label) in enumerate(zip(CASES, IDS, strict=True))
    for k, kind in enumerate(KINDS)
]
"""Every case on both plants; the fast suite takes one of the two, in turn."""


@pytest.mark.slow
@pytest.mark.parametrize(("plant", "machine", "steps", "name", "choice", "kind"), BOTH)
def test_a_typical_size_shows_and_the_vanishing_value_is_nothing(plant, machine, steps, name, choice, kind):
    effect = effects_of(plant)[name]
    untouched = without(plant, kind, steps)
    nothing = with_effects(machine, {name: {**effect.null_values(), **choice}})
    assert np.array_equal(run(plant, nothing, kind, steps), untouched)
    typical = run(plant, with_effects(machine, {name: choice}), kind, steps)
    assert np.all(np.isfinite(typical))
    assert np.abs(typical - untouched).max() > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plant", "machine", "steps", "name", "choice"),
    CASES,
    ids=IDS,
)
def test_at_its_bounds_an_effect_leaves_finite_numbers(plant, machine, steps, name, choice):
    effect = effects_of(plant)[name]
    for bound in ("low", "high"):
        values = {p.name: p.typical if p.null_value is None else getattr(p, bound) for p in effect.parameters}
        found = run(plant, with_effects(machine, {name: {**values, **choice}}), "planar", steps)
        assert np.all(np.isfinite(found)), bound
        assert np.abs(found).max() < 1e5, bound


@pytest.mark.parametrize(("plant", "machine"), [("quarter_rig", RIG), ("uto_robot", ROBOT)])
def test_all_effects_at_once_fit_into_one_machine(plant, machine):
    every = {name: selections(effect, 1)[0] for name, effect in effects_of(plant).items()}
    loaded = with_effects(machine, every)
    steps = 400
    for kind in KINDS:
        found = run(plant, loaded, kind, steps)
        assert np.all(np.isfinite(found))
        assert np.abs(found - run(plant, machine, kind, steps)).max() > 0.1


@pytest.mark.parametrize("machine", [RIG, ROBOT])
def test_a_machine_without_effects_is_applied_unchanged(machine):
    found = apply_effects(machine)
    assert found.machine is machine
    assert not found.terms.any() and not found.channels and not found.floor_changes
    assert (found.payload, found.slope) == ((0.0, 0.0, 0.0), (0.0, 0.0))
    assert np.all(found.torque_scale == 1.0) and np.all(found.radius_scale == 1.0)
