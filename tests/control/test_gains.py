"""Gains as one set: a file changes what it names, a wrong one is refused, and every gain reaches the run."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from omnimj.control.gains import GAIN_NAMES, GAIN_TABLES, Gains, read_gains, rule_of, unit_of
from omnimj.errors import InputError
from omnimj.parameters import read_robot
from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import Scenario, read_scenario, scenario_gains, with_gains

ROBOT = read_robot()
GAINS = Gains(ROBOT.control)
SHORT = ("duration=2.0", "drive.start_time=0.1", "checks={}", "drive.cruise_time=0.2")


def text(**values: object) -> str:
    """A gains file of names with `__` for the dot."""
    lines = []
    for table in GAIN_TABLES:
        own = {k.partition("__")[2]: v for k, v in values.items() if k.startswith(f"{table}__")}
        lines += [f"[{table}]"] if own else []
        for key, value in own.items():
            name = f"{table}.{key}"
            unit = unit_of(name) if name in GAIN_NAMES else "1"
            lines.append(f'{key} = {{ value = {value}, unit = "{unit}", source = "tuned" }}')
    return "\n".join([*lines, "[tuned]", 'command = "omnimj tune"', ""])


def test_every_gain_has_a_unit_and_a_rule_that_its_shipped_value_keeps():
    assert len(GAIN_NAMES) == len(set(GAIN_NAMES)) == 12
    for name in GAIN_NAMES:
        assert unit_of(name)
        assert not rule_of(name).broken_by(GAINS.value(name))


def test_a_file_changes_what_it_names_and_nothing_else(tmp_path):
    file = tmp_path / "g.toml"
    file.write_text(text(control__speed_integral=2.5, recovery__slip_cap=0.1, observer__memory=60))
    found = read_gains(file, ROBOT.control)
    changed = {"control.speed_integral": 2.5, "recovery.slip_cap": 0.1, "observer.memory": 60.0}
    assert {name: found.value(name) for name in GAIN_NAMES} == {
        n: GAINS.value(n) for n in GAIN_NAMES
    } | changed
    assert found == GAINS.changed(changed)
    assert found.control.current_limit == ROBOT.control.current_limit


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (text(control__speed_gain=1.0), r"\[control\]: unknown gain 'speed_gain'; .*speed_proportional"),
        (text(control__current_limit=9.0), "unknown gain 'current_limit'; choices: heading_proportional"),
        (
            text(recovery__slip_cap=-0.1),
            "g.toml: recovery.slip_cap: found -0.1; must be above 0 and at most 5",
        ),
        (text(recovery__grip_share=1.5), "recovery.grip_share: found 1.5"),
        (text(observer__memory='"long"'), "observer.memory: found 'long'; a number is needed"),
        (text(control__speed_integral=1.0).replace("A/rad", "A"), "the unit is 'A/rad'"),
        (text(control__speed_integral=1.0).replace('"tuned"', '"guessed"'), "unknown source 'guessed'"),
        (text(), "has no gains; omnimj tune writes such a file"),
        ("[controls]", "unknown table 'controls'; did you mean 'control'"),
        ("control = 3", r"\[control\] is not a table"),
        ("[control", "is not valid TOML"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, content, expected):
    (tmp_path / "g.toml").write_text(content)
    with pytest.raises(InputError, match=expected) as caught:
        read_gains(tmp_path / "g.toml", ROBOT.control)
    assert "\n" not in str(caught.value)


def columns(scenario: Scenario) -> dict[str, np.ndarray]:
    return dict(run_scenario(scenario, "planar", "robust", 5).trace.columns)


@cache
def with_shipped_gains() -> dict[str, np.ndarray]:
    return columns(read_scenario("degraded_motor", SHORT))


def alike(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    return all(np.array_equal(one[name], other[name], equal_nan=True) for name in one)


def test_the_shipped_gains_given_by_hand_change_nothing():
    scenario = read_scenario("degraded_motor", SHORT)
    assert alike(with_shipped_gains(), columns(with_gains(scenario, scenario_gains(scenario))))


@pytest.mark.parametrize(
    "name",
    [
        "control.speed_proportional",
        "control.speed_integral",
        "control.yaw_rate_proportional",
        "control.heading_proportional",
        "recovery.place_proportional",
        "observer.wheel_noise",
        "observer.creep_noise",
        "observer.acceleration_noise",
        "observer.memory",
    ],
)
def test_every_gain_reaches_the_run(name):
    scenario = read_scenario("degraded_motor", SHORT)
    gains = scenario_gains(scenario).changed({name: 0.5 * GAINS.value(name)})
    assert not alike(with_shipped_gains(), columns(with_gains(scenario, gains)))


@pytest.mark.parametrize(
    ("name", "scenario", "changes"),
    [
        ("recovery.slip_cap", "nylon_patch", ["duration=1.5"]),
        ("recovery.place_speed", "degraded_motor", ["faults.0.loss=1.0"]),
        ("recovery.grip_share", "oil_everywhere", ["duration=6.0"]),
    ],
)
def test_every_gain_of_recovery_reaches_a_run_that_needs_it(name, scenario, changes):
    scenario = read_scenario(scenario, (*changes, "checks={}"))
    gains = scenario_gains(scenario).changed({name: 0.25 * GAINS.value(name)})
    assert not alike(columns(scenario), columns(with_gains(scenario, gains)))


def test_a_model_file_may_mark_a_gain_as_tuned_and_the_shipped_one_does():
    assert ROBOT.provenance["control.speed_proportional"].source == "tuned"


@pytest.mark.parametrize("name", ["rig_slip", "circle_8m_kinematic"])
def test_without_a_cascade_there_are_no_gains(name):
    with pytest.raises(InputError, match="it has no cascade"):
        with_gains(read_scenario(name), GAINS)
