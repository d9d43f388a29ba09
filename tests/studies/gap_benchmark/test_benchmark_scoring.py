"""The blind benchmark: how a case is scored, and what the baselines name."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from benchmark_truths import LATE, VISCOUS, hiding

from omnimj.effects import RIG, effects_of
from omnimj.estimate.replay.base_parameters import base_parameters
from omnimj.parameters import read_floors, read_rig
from omnimj.studies.gap_benchmark.cases import FLOORS, HiddenEffect
from omnimj.studies.gap_benchmark.datasets import true_values
from omnimj.studies.gap_benchmark.scoring import score_case
from omnimj.studies.gap_benchmark.summary import summarize
from omnimj.studies.gap_benchmark.trial import LinearModel, forward_selection, sparse_regression
from omnimj.studies.gap_benchmark.unmodelled import UnmodelledEffect
from omnimj.studies.statistics import rate, wilson

NOMINAL = {p.name: p.nominal for p in base_parameters(read_rig(), read_floors(), FLOORS, ())}


def result(
    *effects: dict[str, Any], verdict: str = "named", before: float = 4.0, baselines: Any = None
) -> dict[str, Any]:
    """A result of a search, with one channel whose noise is 0.1."""
    after = 0.1 if effects else None
    return {
        "gap": {
            "verdict": verdict if effects else "no_gap",
            "effects": list(effects),
            "noise": {"carriage_speed": 0.1},
            "gap": {"heldout": {"carriage_speed": {"before": 0.1 * before, "after": after, "floor": None}}},
            "runs": [{"total_before": before}],
        },
        "seconds": 10.0,
        "baselines": baselines or {},
    }


def named(
    effect: str, *rivals: str, value: float = 3.0, half: float = 0.1, **selectors: str
) -> dict[str, Any]:
    entry = {"value": value, "low": value - half, "high": value + half, "unit": "1"}
    parameters = {p.name: entry for p in effects_of(RIG)[effect].parameters}
    return {
        "effect": effect,
        "selectors": selectors,
        "parameters": parameters,
        "indistinguishable_from": list(rivals),
    }


def test_wilson_bounds_are_those_of_the_tables():
    found = wilson(8, 10)
    assert (found.low, found.high) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    assert wilson(0, 0).value is None
    assert wilson(0, 20).low == 0.0 and wilson(20, 20).high == 1.0


def test_a_rival_covers_the_truth_but_is_not_the_first_name():
    found = score_case(hiding(VISCOUS), result(named("air_drag", "rail_viscous")), None).workflow
    assert (found.covered, found.first, found.set_sizes, found.wrong) == ((True,), (False,), (2,), 0)
    found = score_case(hiding(VISCOUS), result(named("air_drag")), None).workflow
    assert (found.covered, found.wrong) == ((False,), 1)


def test_a_late_channel_is_found_only_under_its_own_name():
    right = score_case(hiding(LATE), result(named("sensor_delay", channel="wheel_speed")), None).workflow
    wrong = score_case(hiding(LATE), result(named("sensor_delay", channel="current")), None).workflow
    open_choice = score_case(hiding(LATE), result(named("wheel_radius", "sensor_delay")), None).workflow
    assert (right.first, wrong.covered, open_choice.covered) == ((True,), (False,), (True,))


def test_the_truth_in_second_place_is_covered_but_not_first():
    found = score_case(hiding(VISCOUS), result(named("grade"), named("rail_viscous")), None).workflow
    assert (found.covered, found.first, found.wrong) == ((True,), (False,), 1)


def test_of_a_pair_each_effect_counts():
    found = score_case(hiding(VISCOUS, LATE), result(named("rail_viscous"), named("grade")), None).workflow
    assert (found.covered, found.first, found.wrong) == ((True, False), (True, False), 1)


def test_any_name_is_false_where_nothing_or_nothing_nameable_is_hidden():
    outside = UnmodelledEffect("bent_rail", 0.02, 0.5, 0.0)
    scores = [
        score_case(hiding(), result(named("grade")), None),
        score_case(hiding(), result(), None),
        score_case(hiding(outside=outside), result(named("grade"), verdict="ambiguous"), None),
    ]
    ours = summarize(scores).methods[0]
    assert (ours.false_on_null.hits, ours.false_on_null.count) == (1, 2)
    assert (ours.false_outside.hits, ours.false_outside.count) == (1, 1)
    assert ours.covered_where_named.count == 0
    assert scores[2].sizes == ("clear",)


def test_an_abstention_is_no_wrong_name_but_covers_nothing():
    scores = [
        score_case(hiding(VISCOUS), result(), None),
        score_case(hiding(VISCOUS), result(named("rail_viscous")), None),
    ]
    faint = dataclasses.replace(scores[0], visibility=1.1, visibilities=(1.1,))
    summary = summarize([*scores, faint])
    ours = summary.methods[0]
    assert (ours.covered_where_named.hits, ours.covered_where_named.count) == (1, 1)
    assert (ours.covered_visible.hits, ours.covered_visible.count) == (1, 2)
    assert (summary.abstained_visible.hits, summary.abstained_visible.count) == (1, 2)
    assert [g.no_gap for g in summary.sizes] == [0, 0, 2]


def test_an_effect_that_does_not_show_beside_another_is_not_missed():
    """RMS over channels in units of noise: 1.1 without the late channel, 5 without the viscous friction."""
    without = {"rail_viscous": {"carriage_speed": 0.5}, LATE.label: {"carriage_speed": 0.11}}
    truth = {"heldout": {"carriage_speed": 0.1}, "without": without}
    score = score_case(hiding(VISCOUS, LATE), result(named("rail_viscous")), truth)
    assert score.visible == (True, False)
    ours = summarize([score]).methods[0]
    assert (ours.covered_visible.hits, ours.covered_visible.count) == (1, 1)
    assert (ours.covered_of_gaps.hits, ours.covered_of_gaps.count) == (1, 2)


def test_a_parameter_is_right_when_its_interval_holds_the_truth_and_its_error_is_in_sizes():
    right, off = (
        score_case(hiding(VISCOUS), result(named("rail_viscous", value=value)), None).parameters[0]
        for value in (3.05, 3.6)
    )
    assert (right.inside, off.inside) == (True, False)
    assert off.error == pytest.approx(0.2)
    assert rate([bool(right.inside), bool(off.inside)]).value == 0.5


def test_the_truth_of_a_parameter_holds_what_the_base_is_off():
    case = hiding(base={**NOMINAL, "motor.torque_constant": 0.0408, "rig.rail_friction": 0.314})
    motor = HiddenEffect("torque_constant", {"scale": 0.9}, "clear")
    assert true_values(motor, case)["scale"] == pytest.approx(0.9 * 1.02)
    dry = HiddenEffect("rail_coulomb", {"force": 0.7}, "clear")
    assert true_values(dry, case)["force"] == pytest.approx(0.71)
    load = HiddenEffect("payload", {"mass": 0.35}, "clear")
    assert true_values(load, case)["mass"] == pytest.approx(0.35)
    assert true_values(VISCOUS, case) == {"coefficient": 3.0}


def test_the_held_out_gap_is_compared_with_the_true_models_on_one_scale():
    picked = {"bic": {"names": ["grade", "rail_viscous"], "heldout": {"carriage_speed": 0.2}}}
    found = score_case(
        hiding(VISCOUS),
        result(named("rail_viscous"), baselines=picked),
        {"heldout": {"carriage_speed": 0.08}},
    )
    assert found.workflow.ratio == pytest.approx(1.25)
    assert found.baselines["bic"].ratio == pytest.approx(2.5)
    assert (found.baselines["bic"].covered, found.baselines["bic"].first) == ((True,), (False,))


def linear(residual, columns, labels) -> LinearModel:
    rows = len(residual)
    fold = np.arange(rows) % 5 - 1  # a fifth is held out
    return LinearModel(
        columns,
        residual,
        (fold >= 0).astype(float),
        fold,
        fold < 0,
        int((fold >= 0).sum()),
        np.ones(1),
        labels,
        {"speed": 0.5},
    )


def test_both_baselines_find_what_is_linear_and_alone():
    random = np.random.default_rng(1)
    columns = random.standard_normal((600, 5))
    labels = ("rail_viscous", "grade", "payload", "payload")
    data = linear(columns[:, 2] * 2.0 + 0.1 * random.standard_normal(600), columns, labels)
    for picked in (sparse_regression(data), forward_selection(data)):
        assert picked.names == ("grade",)
        assert picked.heldout["speed"] == pytest.approx(0.05, rel=0.2)
