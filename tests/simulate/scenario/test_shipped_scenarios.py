"""Shipped scenarios: each passes its checks, and every check can fail."""

from __future__ import annotations

import dataclasses

import pytest
from nightly import representative, three_wheels_nightly

from omnimj.simulate.detectors import default_method
from omnimj.simulate.run import RunResult, run_scenario
from omnimj.simulate.scenario.checks import Check
from omnimj.simulate.scenario.listing import scenario_names
from omnimj.simulate.scenario.scenario import Scenario, read_scenario
from omnimj.simulate.summary import summarize

NAMES = scenario_names()
ON_TWIN = [name for name in NAMES if "kinematic" not in name and name != "ramp"]
"""Scenarios of which the fastest plant is not the twin; `ramp` runs on the twin anyway."""
LONG = 20.0
"""Duration from which on the twin is left to nightly runs [s]."""


def fastest_plant(scenario: Scenario) -> str | None:
    """The fastest plant that can drive it: the planar one has a flat floor only."""
    return None if scenario.level == "kinematic" or scenario.scene is not None else "planar"


def driven(name: str, *overrides: str, plant: str | None = None) -> RunResult:
    scenario = read_scenario(name, overrides)
    return run_scenario(scenario, plant or fastest_plant(scenario), default_method(scenario))


def beyond(check: Check, value: float) -> Check:
    """The same check with a limit that the value just misses."""
    margin = 1e-6 * abs(value) + 1e-9
    return dataclasses.replace(check, limit=value + margin if check.bound == "min" else value - margin)


def require_checks_that_pass_and_can_fail(run: RunResult) -> None:
    """Evaluates the recorded run again with limits turned against it."""
    checks = run.metrics["checks"]
    assert checks, "a scenario without checks says nothing"
    assert run.metrics["passed"], checks
    values = {entry["name"]: entry["value"] for entry in checks}
    turned = tuple(beyond(c, values[c.name]) for c in run.scenario.checks if c.name in values)
    again = summarize(dataclasses.replace(run.scenario, checks=turned), run.trace)
    assert len(again["checks"]) == len(checks) and not any(entry["ok"] for entry in again["checks"])


@pytest.mark.parametrize("name", NAMES)
def test_a_scenario_passes_its_checks_on_the_fastest_plant_and_each_check_can_fail(name):
    require_checks_that_pass_and_can_fail(driven(name))


@pytest.mark.parametrize(
    "name",
    [
        *three_wheels_nightly(name for name in ON_TWIN if read_scenario(name).duration <= LONG),
        *(pytest.param(n, marks=pytest.mark.slow) for n in ON_TWIN if read_scenario(n).duration > LONG),
    ],
)
def test_a_scenario_passes_its_checks_on_the_twin(name):
    require_checks_that_pass_and_can_fail(driven(name, plant="twin"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "healed", "check"),
    [
        ("nylon_patch", "patches.0.floor=natural_stone", "peak_slip_1"),
        ("degraded_motor", "faults.0.loss=0.01", "rms_current_1"),
        ("soft_floor_circle", "drive.creep_floor=", "path_error_max"),
        ("soft_edge", "patches=[]", "path_error_max"),
        ("circle_8m", "drive.heading_hold=false", "max_yaw_excursion"),
        ("square_path", "drive.yaw_loop=false", "path_error_max"),
        ("square_path_open_loop", "drive.yaw_loop=true", "path_error_max"),
        ("square_path_kinematic_open_loop", "drive.yaw_loop=true", "tracking_error_max"),
        ("circle_8m_kinematic", "kinematics.weights.0=1.0", "tracking_error_max"),
        ("rig_lateral", "lateral_speed=0.0", "final_current"),
        ("rig_motor", "faults=[]", "final_current"),
        ("rig_slip", "faults=[]", "peak_slip_1"),
        ("ramp", "scene=scene", "rms_current_4"),
    ],
)
def test_without_its_subject_a_scenario_fails_its_check(name, healed, check):
    metrics = driven(name, healed).metrics
    assert not metrics["passed"]
    assert check in [entry["name"] for entry in metrics["checks"] if not entry["ok"]]


FASTER_WHEEL = 'faults=[{ kind = "wheel_radius", wheel = 1, onset = 0.0, scale = 1.1 }]'
HALF_CURRENT = 'faults=[{ kind = "sensor", channel = "current", mode = "scale", size = 0.5, onset = 0.0 }]'
FREE_WHEEL = 'faults=[{ kind = "free", wheel = 1, onset = 2.0 }]'
WEAK_MOTOR = 'faults=[{ kind = "motor", wheel = 4, onset = 1.0, loss = 0.9 }]'
OTHER_WHEEL = 'faults=[{ kind = "wheel_radius", wheel = 1, onset = 1.0, scale = 1.6 }]'
HALF_WHEEL = 'faults=[{ kind = "wheel_radius", wheel = 1, onset = 1.0, scale = 0.5 }]'
RUNAWAY = 'faults=[{ kind = "hard_over", wheel = 1, onset = 4.0 }]'
SPOILED = {
    "circle_8m_wheel_lost": ("faults=[]", "floor=oil"),
    "circle_8m_wheel_locked": ("faults=[]", "floor=oil"),
    "oil_everywhere": ("faults=[]", RUNAWAY, OTHER_WHEEL),
    "payload_20_percent": (OTHER_WHEEL, HALF_WHEEL, "floor=oil"),
    "sensor_faults": ("faults=[]", OTHER_WHEEL),
    "slip_then_motor": (OTHER_WHEEL, HALF_WHEEL, "floor=oil"),
    "two_motors_lost": ("faults=[]", "floor=oil"),
    "three_motors_lost": ("faults=[]",),
    "three_wheel_circle": (FREE_WHEEL, "drive.speed=1.1", OTHER_WHEEL, "floor=oil"),
    "three_wheel_weak_motor": ("faults=[]", "floor=oil", "faults.0.loss=1.0", OTHER_WHEEL),
    "three_wheel_nylon": ("patches=[]", "floor=oil", OTHER_WHEEL, "drive.yaw_loop=false"),
    "circle_8m": (FREE_WHEEL, "drive.speed=0.5", "drive.speed=1.1", OTHER_WHEEL),
    "circle_8m_kinematic": ("kinematics.weights.0=1.0", "kinematics.weights.0=10000.0"),
    "degraded_motor": ("faults.0.loss=1.0", "floor=oil", "faults.0.loss=0.01", OTHER_WHEEL),
    "nylon_patch": ("drive.yaw_loop=false", "floor=oil", "patches=[]", OTHER_WHEEL),
    "ramp": ("scene=scene", "duration=5.0", "floor=oil", WEAK_MOTOR),
    "rig_constant_current": ("current=0.5", "duration=1.6", FASTER_WHEEL, HALF_CURRENT),
    "rig_lateral": ("current=0.4", "duration=1.6", FASTER_WHEEL, HALF_CURRENT),
    "rig_motor": ("faults=[]", "faults.0.braking_torque=0.003", "current=0.4", "duration=2.0"),
    "rig_slip": ("faults=[]", "current=0.4", "duration=1.6"),
    "soft_floor_circle": ("drive.creep_floor=", "duration=8.0", OTHER_WHEEL, "drive.yaw_loop=false"),
    "soft_edge": ("patches=[]", "drive.creep_floor=", OTHER_WHEEL, "drive.yaw_loop=false"),
    "square_path": ("drive.yaw_loop=false", "duration=20.0", OTHER_WHEEL),
    "square_path_kinematic": ("drive.yaw_loop=false",),
    "square_path_kinematic_open_loop": ("drive.yaw_loop=true", "kinematics.misalignment.0=0.01"),
    "square_path_open_loop": ("drive.yaw_loop=true", "duration=20.0", "faults.0.angle=0.01", OTHER_WHEEL),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_every_check_of_a_scenario_fails_for_some_other_physics(name):
    can_fail = set()
    for spoiled in SPOILED[name]:
        checks = driven(name, spoiled).metrics["checks"]
        can_fail |= {(check["name"], check["bound"]) for check in checks if not check["ok"]}
    assert can_fail == {(check.name, check.bound) for check in read_scenario(name).checks}


@pytest.mark.parametrize(
    ("weight", "distance"),
    representative((1000.0, 0.0164), (1.0, 0.499), (100.0, 0.180), (10000.0, 0.0016)),
)
def test_in_the_published_plant_a_larger_weight_keeps_the_circle_closer(weight, distance):
    overrides = (f"kinematics.weights.0={weight}", "checks.tracking_error_max=1.0")
    assert driven("circle_8m_kinematic", *overrides).metrics["tracking_error_max"] == pytest.approx(
        distance, rel=0.01
    )
