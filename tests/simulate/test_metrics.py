"""Metrics and checks against closed forms, and the schema of `metrics.json`."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.plant.ground import Patch
from omnimj.recording.json_files import write_json
from omnimj.signals import Trace
from omnimj.simulate.judging import patch_records
from omnimj.simulate.metrics import compute_metrics, distance_to_path, metric_units
from omnimj.simulate.run import RunResult, run_scenario
from omnimj.simulate.scenario.checks import Check, CheckResult, evaluate_checks, read_checks
from omnimj.simulate.scenario.listing import scenario_names
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.simulate.summary import summarize

SCHEMA = json.loads((Path(__file__).parent.parent / "schema" / "metrics.json").read_text(encoding="utf-8"))
UNITS = metric_units("uto_robot", 4, True, False)


def driven(scenario_name: str, *overrides: str) -> RunResult:
    scenario = read_scenario(scenario_name, overrides)
    flat = scenario.level == "physics" and scenario.scene is None
    return run_scenario(scenario, "planar" if flat else None)


def straight(offset: float = 0.0, turn: float = 0.0, rows: int = 101) -> Trace:
    """1 m/s along x for a second, `offset` to the left of the plan, turning to `turn`."""
    t = np.linspace(0.0, 1.0, rows)
    zero = np.zeros(rows)
    columns = {
        "time": t,
        "x": t,
        "y": zero + offset,
        "heading": turn * t,
        "twist_x": zero + 1.0,
        "twist_y": zero,
    }
    columns |= {"target_x": t, "target_y": zero, "target_heading": zero}
    for i in range(1, 5):
        columns |= {f"slip_velocity_{i}": -0.1 * i * t, f"current_{i}": zero + 0.5 * (-1) ** i}
    return Trace(columns)


def test_a_parallel_course_is_its_offset_away_from_the_path():
    found = compute_metrics(straight(offset=0.3), UNITS)
    assert found["path_error_max"] == pytest.approx(0.3)
    assert found["path_error_rms"] == pytest.approx(0.3)
    assert found["tracking_error_max"] == pytest.approx(0.3)


def test_a_robot_that_is_late_is_on_the_path_but_not_where_it_should_be():
    trace = straight()
    late = Trace({**trace.columns, "x": 0.8 * trace["time"]})
    found = compute_metrics(late, UNITS)
    assert found["path_error_max"] == pytest.approx(0.0, abs=1e-12)
    assert found["tracking_error_max"] == pytest.approx(0.2)


def test_speed_slip_and_current_are_those_of_the_columns():
    found = compute_metrics(straight(), UNITS)
    assert found["final_speed"] == found["mean_speed"] == found["peak_speed"] == 1.0
    assert [found[f"peak_slip_{i}"] for i in range(1, 5)] == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert found["rms_current"] == pytest.approx(0.5)
    assert found["rms_current_3"] == pytest.approx(0.5)


@given(turn=st.floats(-9.0, 9.0), turns=st.integers(-3, 3))
def test_the_heading_excursion_does_not_care_how_the_heading_is_wrapped(turn, turns):
    trace = straight(turn=turn)
    assert compute_metrics(trace, UNITS)["max_yaw_excursion"] == pytest.approx(abs(turn))
    wrapped = Trace(
        {**trace.columns, "heading": np.mod(trace["heading"], 2.0 * math.pi) + 2 * math.pi * turns}
    )
    assert compute_metrics(wrapped, UNITS)["max_yaw_excursion"] == pytest.approx(abs(turn), abs=1e-9)


def test_without_truth_the_measured_heading_counts_and_the_place_is_unknown():
    truth = ("x", "y", "heading", "twist_x", "twist_y")
    trace = straight(turn=0.2)
    columns = {name: values for name, values in trace.columns.items() if name not in truth}
    found = compute_metrics(Trace({**columns, "yaw": np.mod(trace["heading"] - 0.001, 2 * math.pi)}), UNITS)
    assert found["max_yaw_excursion"] == pytest.approx(0.199)
    assert found["path_error_max"] is None and found["final_speed"] is None


def test_the_rig_travels_as_far_as_its_speed_carries_it():
    run = driven("rig_constant_current")
    trace, metrics = run.trace, run.metrics
    integral = np.trapezoid(trace["true_carriage_speed"], trace["time"])
    assert metrics["travel"] == pytest.approx(integral, rel=1e-6)
    assert metrics["max_yaw_excursion"] is None and metrics["path_error_max"] is None


@given(st.floats(0.0, 2.0 * math.pi), st.floats(0.0, 5.0))
def test_the_distance_to_a_circle_is_the_difference_of_the_radii(angle, radius):
    phi = np.linspace(0.0, 2.0 * math.pi, 5001)
    circle = 3.0 * np.column_stack([np.cos(phi), np.sin(phi)])
    point = radius * np.array([[math.cos(angle), math.sin(angle)]])
    sagitta = 3.0 * (1.0 - math.cos(phi[1] / 2.0))
    assert distance_to_path(point, circle)[0] == pytest.approx(abs(radius - 3.0), abs=1.01 * sagitta)


@given(
    st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=1, max_size=6),
    st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3)), min_size=1, max_size=4),
)
def test_the_distance_to_a_finely_sampled_path_is_the_nearest_sample(corners, points):
    steps = np.linspace(0.0, 1.0, 400)[:, None]
    legs = [np.array(a) + steps * (np.array(b) - np.array(a)) for a, b in pairwise(corners)]
    path = np.vstack([np.array(corners[:1]), *legs])
    brute = np.min(np.linalg.norm(np.array(points)[:, None] - path[None], axis=2), axis=1)
    found = distance_to_path(np.array(points), path)
    assert np.all(found <= brute + 1e-9)
    assert np.all(found >= brute - 0.01)  # half a step of the longest leg, 5.7 m / 400 / 2


def test_a_robot_that_never_moves_has_a_path_of_one_point():
    assert distance_to_path(np.array([[3.0, 4.0]]), np.zeros((50, 2))).tolist() == [5.0]


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-4, 4), st.floats(-0.6, 0.6), st.floats(-0.4, 0.4))
def test_a_patch_covers_what_lies_in_its_own_rectangle(x, y, yaw, along, across):
    patch = Patch("nylon", (x, y), (0.6, 0.4), yaw)
    point = (
        x + along * math.cos(yaw) - across * math.sin(yaw),
        y + along * math.sin(yaw) + across * math.cos(yaw),
    )
    margin = min(abs(abs(along) - 0.3), abs(abs(across) - 0.2))
    if margin > 1e-9:
        assert bool(patch.covers(point)) == (abs(along) < 0.3 and abs(across) < 0.2)


def test_a_patch_is_a_fault_from_the_first_contact_to_the_last():
    # wheel 1 is 0.25 m ahead and crosses [0.5, 0.7] at 1 m/s; wheel 3 follows 0.5 m behind
    patches = [Patch("nylon", (0.6, 0.0), (0.2, 0.1))]
    wheels = np.array([(0.25, 0.0), (0.0, -0.25), (-0.25, 0.0), (0.0, 0.25)])
    records = patch_records(straight(rows=1001), patches, "natural_stone", wheels)
    assert [(r["wheel"], r["kind"], r["floor"]) for r in records] == [
        (1, "slip", "nylon"),
        (3, "slip", "nylon"),
    ]
    assert records[0]["onset"] == pytest.approx(0.25, abs=2e-3)
    assert records[0]["end"] == pytest.approx(0.45, abs=2e-3)
    assert records[1]["onset"] == pytest.approx(0.75, abs=2e-3)
    assert records[1]["end"] == pytest.approx(0.95, abs=2e-3)


def test_a_patch_that_is_never_left_has_no_end_and_one_of_the_same_floor_is_no_fault():
    wheels = np.array([(0.0, 0.0)])
    ahead = [Patch("oil", (1.0, 0.0), (1.0, 1.0))]
    assert patch_records(straight(), ahead, "pvc", wheels)[0]["end"] is None
    assert patch_records(straight(), ahead, "oil", wheels) == []
    covered = [*ahead, Patch("pvc", (1.0, 0.0), (1.0, 1.0))]
    assert patch_records(straight(), covered, "pvc", wheels) == []


@pytest.mark.parametrize("name", scenario_names())
def test_metrics_keep_to_the_schema(name):
    begins = () if read_scenario(name).level == "kinematic" else ("faults=[]",)  # before most onsets
    metrics = driven(name, "duration=1.0", *begins).metrics
    jsonschema.validate(metrics, SCHEMA)
    json.dumps(metrics, allow_nan=False)


def test_metrics_list_every_fault_in_order_of_its_onset():
    patch = driven("nylon_patch").metrics["faults"]
    assert [(f["kind"], f["wheel"], f["onset"]) for f in patch] == [("slip", 1, 0.0)]
    assert 1.0 < patch[0]["end"] < 2.0
    motor = driven("degraded_motor").metrics["faults"]
    assert motor == [{"kind": "motor", "wheel": 1, "onset": 0.8, "end": None, "loss": 0.57}]
    kinds = [f["kind"] for f in driven("square_path_kinematic", "duration=1.0").metrics["faults"]]
    assert kinds == ["misalignment", "misalignment"]


def test_an_interrupted_run_has_not_passed():
    run = driven("nylon_patch")
    assert run.metrics["passed"]
    about = {**run.trace.about, "interrupted": True}
    cut = Trace({name: values[:2000] for name, values in run.trace.columns.items()}, about)
    metrics = summarize(run.scenario, cut)
    assert not metrics["passed"] and metrics["interrupted"]
    assert metrics["duration"] == pytest.approx(1.999)


def test_metrics_are_written_as_strict_json(tmp_path):
    metrics = driven("nylon_patch", "duration=0.1").metrics
    write_json(tmp_path / "metrics.json", metrics)
    assert json.loads((tmp_path / "metrics.json").read_text(encoding="utf-8")) == metrics


@given(st.floats(allow_nan=True, allow_infinity=True), st.floats(-10, 10))
def test_a_number_that_is_not_finite_passes_no_check(value, limit):
    highest, lowest = (
        CheckResult(Check("m", "max", limit), value),
        CheckResult(Check("m", "min", limit), value),
    )
    if math.isfinite(value):
        assert highest.ok == (value <= limit) and lowest.ok == (value >= limit)
    else:
        assert not highest.ok and not lowest.ok


def test_a_metric_that_is_missing_fails_its_check():
    checks = read_checks({"peak_speed": {"min": 0.0, "max": 9.0}}, "here: checks", ("peak_speed",))
    assert [(c.bound, c.limit) for c in checks] == [("min", 0.0), ("max", 9.0)]
    assert [j.ok for j in evaluate_checks(checks, {})] == [False, False]
    assert [j.ok for j in evaluate_checks(checks, {"peak_speed": 1.0})] == [True, True]
