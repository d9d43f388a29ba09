"""Datasets of the twin with one or two missing effects, as a user would meet them: what must be named."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from omnimj.estimate.gap.find import find_gap
from omnimj.estimate.gap.records import Finding
from omnimj.studies.gap_benchmark import datasets
from omnimj.studies.gap_benchmark.cases import HiddenEffect, draw_cases
from omnimj.studies.gap_benchmark.machine_cases import draw_machine_cases, make_machine_dataset
from omnimj.studies.gap_benchmark.unmodelled import UnmodelledEffect, draw_unmodelled

pytestmark = pytest.mark.slow

EMPTY = [case for case in draw_cases(6) if case.kind == "null"]

COUPLING = {"roller_dry": 0.02, "roller_viscous": 0.02, "rail_dry": 0.1}
PAIRS = {
    "viscous drag beside a coupling": {"rail_viscous": {"coefficient": 2.0}, "lateral_coupling": COUPLING},
    "a weak motor beside a coupling": {"torque_constant": {"scale": 0.88}, "lateral_coupling": COUPLING},
    "dry and viscous drag": {"rail_coulomb": {"force": 2.0}, "rail_viscous": {"coefficient": 2.0}},
    "a worn wheel on a motor that warms up": {
        "wheel_radius": {"scale": 0.95},
        "winding_heating": {"rate": 0.06},
    },
    "slippery floor and drag": {
        "floor_patch": {"scale": 0.25, "start": 0.5, "end": 0.9},
        "rail_viscous": {"coefficient": 1.5},
    },
}


def searched(
    folder: Path,
    hidden: dict[str, dict[str, float]],
    structure: UnmodelledEffect | None = None,
    machine: int = 0,
) -> Finding:
    effects = tuple(HiddenEffect(name, values, "clear") for name, values in hidden.items())
    case = dataclasses.replace(EMPTY[machine], hidden=effects, structure=structure)
    datasets.make_dataset(case, folder / "data")
    return find_gap(folder / "data")


def reported_sets(finding: Finding) -> list[set[str]]:
    return [{e.effect, *e.indistinguishable_from} for e in finding.effects]


@pytest.mark.parametrize("name", PAIRS)
def test_both_of_two_effects_are_covered_and_nothing_else_is_named(tmp_path, name):
    hidden = PAIRS[name]
    sets = reported_sets(searched(tmp_path, hidden))
    assert all(any(effect in names for names in sets) for effect in hidden)
    assert all(names & set(hidden) for names in sets)


def test_a_slippery_stretch_of_the_floor_is_found(tmp_path):
    finding = searched(tmp_path, {"floor_patch": {"scale": 0.25, "start": 0.5, "end": 0.9}}, machine=1)
    (effect,) = finding.effects
    assert effect.effect == "floor_patch" and not effect.indistinguishable_from
    assert effect.parameters["start"].value == pytest.approx(0.5, abs=0.02)
    assert effect.parameters["end"].value == pytest.approx(0.9, abs=0.02)


@pytest.mark.parametrize(("angle", "machine"), [(0.08, 0), (0.04, 2)])
def test_play_of_the_gear_is_found_although_predictions_have_no_fine_derivative_by_it(
    tmp_path, angle, machine
):
    """Impacts move with the play: over less than a hundredth of a degree predictions change at random."""
    (effect,) = searched(tmp_path, {"backlash": {"angle": angle}}, machine=machine).effects
    assert effect.effect == "backlash" and not effect.indistinguishable_from
    found = effect.parameters["angle"]
    assert found.value == pytest.approx(angle, rel=0.1)
    assert found.low is not None and found.low > 0.5 * angle


def test_runs_that_all_go_forward_cannot_tell_a_tilted_rail_from_rolling_resistance(tmp_path, monkeypatch):
    forward = tuple(planned for planned in datasets._PLAN if planned[0] in ("constant", "ramp"))
    monkeypatch.setattr(datasets, "_PLAN", forward)
    structure = draw_unmodelled("friction_law", 0.7, np.random.default_rng(2))
    finding = searched(tmp_path, {"grade": {"slope": 0.01}}, structure)
    assert any({"grade", "rolling_resistance"} <= names for names in reported_sets(finding))


@pytest.mark.parametrize(
    ("number", "covered"),
    [
        (3, {"position_bias", "saturation"}),  # random curves that hardly bend gain as much as an offset
        (14, {"armature", "grade"}),  # a negative spring is the best effect alone
    ],
)
def test_two_effects_of_a_servo_are_found_although_others_look_as_good_at_first(tmp_path, number, covered):
    case = draw_machine_cases("servo_arm", 113)[number]
    assert {one.effect for one in case.hidden} == covered
    make_machine_dataset(case, tmp_path / "data")
    sets = reported_sets(find_gap(tmp_path / "data"))
    assert len(sets) == 2
    assert all(any(effect in names for names in sets) for effect in covered)


@pytest.mark.parametrize("number", [3, 14])
def test_no_delay_is_named_where_force_and_position_are_on_one_clock(tmp_path, number):
    """An offset of the clocks against a delay only interpolates: noise falls, nothing else changes."""
    case = draw_machine_cases("linear_axis", 113)[number]
    make_machine_dataset(case, tmp_path / "data")
    assert "sensor_delay" not in {
        name for names in reported_sets(find_gap(tmp_path / "data")) for name in names
    }
