"""What a run amounts to, as numbers that can be compared."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from omnimj.simulate.run import RunResult, run_scenario
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.studies.sensitivity.trial import RESOLUTION, read_results, result_units


def driven(name: str, *settings: str, method: str = "off") -> tuple[RunResult, dict[str, str]]:
    scenario = read_scenario(name, settings)
    return run_scenario(scenario, "planar", method), result_units(scenario, method)


def test_results_are_the_metrics_and_where_the_robot_ended():
    run, units = driven("nylon_patch", "duration=1.5")
    found = read_results(run, units)
    assert set(found) == set(units) and all(value is not None for value in found.values())
    for name in set(units) & set(run.metrics):
        assert found[name] == run.metrics[name], name
    trace = run.trace
    assert (found["final_x"], found["final_y"]) == (trace["x"][-1], trace["y"][-1])
    slips = np.concatenate([trace[f"slip_velocity_{i}"] for i in range(1, 5)])
    assert found["rms_slip"] == pytest.approx(np.sqrt(np.mean(slips**2)))


def test_of_single_wheels_those_count_that_the_checks_name():
    units = result_units(read_scenario("nylon_patch"), "robust")
    assert {name for name in units if name[-1].isdigit()} == {"peak_slip_1", "peak_slip_3"}
    assert "peak_slip_1" in result_units(read_scenario("rig_slip"), "published")  # it has one wheel


def test_without_a_method_there_are_no_results_about_diagnoses():
    scenario = read_scenario("nylon_patch")
    assert {"detection_delay", "isolated", "false_alarms"} == {*result_units(scenario, "robust")} - {
        *result_units(scenario, "off")
    }


def test_every_unit_but_a_count_has_a_smallest_measurable_change():
    for name in ("nylon_patch", "circle_8m", "rig_slip"):
        assert set(result_units(read_scenario(name), "published").values()) - {""} <= set(RESOLUTION)


@pytest.mark.parametrize(("delay", "expected"), [(0.3, 0.3), (None, 0.7)])
def test_an_undetected_fault_has_a_delay_to_the_end_of_the_run(delay, expected):
    run, _ = driven("degraded_motor", "duration=1.5")
    units = {"detection_delay": "s"}
    metrics = {**run.metrics, "detection_delay": delay}
    assert read_results(dataclasses.replace(run, metrics=metrics), units)["detection_delay"] == pytest.approx(
        expected
    )


def test_without_a_fault_there_is_no_delay():
    run, _ = driven("degraded_motor", "duration=0.5", "faults=[]")
    assert read_results(run, {"detection_delay": "s"}) == {"detection_delay": None}


def test_the_rig_has_its_own():
    run, units = driven("rig_slip", "duration=0.3")
    found = read_results(run, units)
    assert found["travel"] == run.metrics["travel"] and "final_x" not in found
    assert found["rms_slip"] == pytest.approx(np.sqrt(np.mean(run.trace["slip_velocity_1"] ** 2)))
