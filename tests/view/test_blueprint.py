"""A recording opens with what its scenario is about, derived from the scenario's content alone."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest
from diagnosed_runs import with_robust
from rerun.chunk import RrdReader

from omnimj.plant.faults import fault_record
from omnimj.simulate.detectors import default_method, make_detector
from omnimj.simulate.scenario.listing import scenario_names
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.view.rerun.blueprint import Focus, focus_of
from omnimj.view.rerun.recording import live_blueprint, write_recording

CASES = {
    "nylon_patch": ("slip_velocity", "traction_force"),
    "three_wheel_nylon": ("slip_velocity", "traction_force"),
    "oil_everywhere": ("slip_velocity", "traction_force"),
    "degraded_motor": ("current", "effectiveness"),
    "circle_8m_wheel_locked": ("current", "effectiveness"),
    "three_wheel_weak_motor": ("current", "effectiveness"),
    "slip_then_motor": ("slip_velocity", "traction_force", "residual_slip", "current", "effectiveness"),
    "sensor_faults": ("acceleration", "yaw_rate", "heading"),
    "square_path": ("heading", "yaw_rate"),
    "circle_8m": ("heading", "wheel_speed"),
    "ramp": ("normal_force", "current"),
    "rig_slip": ("current", "slip_velocity", "speed"),
    "rig_lateral": ("current", "slip_velocity", "speed"),
}


def subject(name: str) -> Focus:
    scenario = read_scenario(name)
    return focus_of(scenario, [fault_record(fault) for fault in scenario.faults])


@pytest.mark.parametrize("name", CASES)
def test_the_plots_that_come_first_are_those_of_the_scenarios_faults_floor_and_drive(name):
    found = subject(name)
    assert found.plots[: len(CASES[name])] == CASES[name] and found.heading


def test_a_path_is_seen_from_above_and_a_ramp_from_the_side():
    names = ("circle_8m", "square_path", "three_wheel_circle", "ramp", "nylon_patch", "rig_slip")
    views = {name: (subject(name).from_above, subject(name).from_the_side) for name in names}
    paths = dict.fromkeys(("circle_8m", "square_path", "three_wheel_circle"), (True, False))
    assert views == {
        **paths,
        "ramp": (False, True),
        "nylon_patch": (False, False),
        "rig_slip": (False, False),
    }


def test_a_scenarios_name_and_number_of_wheels_do_not_matter():
    scenario = read_scenario("degraded_motor")
    renamed = dataclasses.replace(scenario, name="ramp")
    faults = [fault_record(fault) for fault in scenario.faults]
    assert focus_of(renamed, faults) == focus_of(scenario, faults)
    assert focus_of(renamed, [{"kind": "sensor", "channel": "wheel_speed_2", "wheel": None}]).plots == (
        "wheel_speed",
    )
    assert focus_of(renamed, []) == Focus()


def test_every_shipped_scenario_has_a_subject_but_those_without_anything_to_show():
    without = [one.name for one in map(read_scenario, scenario_names()) if not subject(one.name).heading]
    assert without == []


def blueprint_of(path) -> tuple[list[str], list[str]]:
    """Names of containers and views, and which lines' widths are overridden."""
    (blueprint,) = RrdReader(path).blueprints()
    names, widths = [], []
    for chunk in RrdReader(path).stream(store=blueprint).to_chunks():
        batch = chunk.to_record_batch()
        for column in ("ViewBlueprint:display_name", "ContainerBlueprint:display_name"):
            if column in batch.schema.names:
                names += [row[0] for row in batch.column(column).to_pylist() if row]
        if "SeriesLines:widths" in batch.schema.names:
            widths += [(chunk.entity_path, row) for row in batch.column("SeriesLines:widths").to_pylist()]
    return names, widths


def test_the_recording_shows_it_with_the_concerned_wheels_bold(
    tmp_path, robot_trace, robot_scenario, robot_metrics
):
    write_recording(tmp_path / "run.rrd", with_robust(robot_trace), robot_scenario, robot_metrics)
    names, widths = blueprint_of(tmp_path / "run.rrd")
    wanted = {"Slip and traction", "What the machine did", "Path from above"}
    assert wanted <= set(names)
    assert names.count("Slip velocity [m/s]") == 1, "no plot twice"
    bold = {re.findall(r"overrides/plots/(\w+)", entity)[0]: np.array(row) > 3.0 for entity, row in widths}
    assert bold["slip_velocity"].tolist() == [False, True, True, False], "wheels 2 and 3 are broken"
    assert bold["residual_motor"].tolist() == [False, True, True, False] + 4 * [False], "thresholds are not"


@pytest.mark.parametrize("name", scenario_names())
def test_every_shipped_scenario_can_be_watched_as_it_is_driven(name):
    scenario = read_scenario(name)
    method = make_detector(default_method(scenario), scenario)
    names = () if method is None else tuple(method.log_names)
    faults = [fault_record(fault) for fault in scenario.faults]
    blueprint = live_blueprint(scenario, 5.0, (0.0, 0.0), default_method(scenario), names, faults)
    views = json.dumps(shown(blueprint.root_container))
    assert subject(name).heading in views and "What the machine did" in views


def shown(part) -> list:
    """Names of a container and of what is in it."""
    return [part.name, [shown(one) for one in getattr(part, "contents", ()) if hasattr(one, "name")]]
