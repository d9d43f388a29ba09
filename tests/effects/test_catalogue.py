"""The vocabulary: names, bounds, choices, and how effects are written on the command line."""

import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from driven_plants import RIG, ROBOT
from hypothesis import given
from hypothesis import strategies as st

from omnimj.effects import EFFECTS, base_name, effects_of, parse_effect, with_effects
from omnimj.errors import InputError, UnknownNameError
from omnimj.plant.interface import RIG_CHANNELS, robot_channels

NAMES = {
    "quarter_rig": """lateral_coupling rolling_resistance rail_coulomb rail_viscous rail_stribeck
        rail_position bearing_friction floor_traction floor_patch payload grade cable_drag air_drag
        torque_constant gear_loss back_driving backlash motor_cogging roller_ripple supply_sag
        winding_heating wheel_radius
        current_bias current_scale wheel_speed_scale carriage_speed_scale acceleration_bias
        acceleration_scale sensor_delay""",
    "uto_robot": """roller_friction rolling_resistance bearing_friction floor_traction floor_patch payload
        grade air_drag torque_constant gear_loss back_driving backlash motor_cogging roller_ripple supply_sag
        winding_heating wheel_radius wheel_misalignment current_bias current_scale acceleration_bias
        acceleration_scale accelerometer_position yaw_rate_bias yaw_rate_scale sensor_delay""",
    "linear_axis": """coulomb viscous asymmetric_viscous asymmetric_coulomb stribeck position_friction
        force_offset force_scale position_scale velocity_scale payload grade cable_drag air_drag
        torque_constant backlash current_bias current_scale sensor_delay""",
}
MACHINES = {"quarter_rig": RIG, "uto_robot": ROBOT}


@pytest.mark.parametrize("plant", NAMES)
def test_the_catalogue_has_every_name_of_the_vocabulary(plant):
    assert set(NAMES[plant].split()) <= set(effects_of(plant))
    for name in effects_of(plant):
        assert plant in EFFECTS[name].plants


@pytest.mark.parametrize("plant", NAMES)
def test_every_number_lies_within_its_bounds_and_is_not_gone_at_its_typical_size(plant):
    for effect in effects_of(plant).values():
        assert effect.words and effect.where and effect.hooks and effect.amplitudes
        assert re.fullmatch("[a-z_]+", effect.name) and base_name(f"{effect.name}_2") == effect.name
        for p in effect.parameters:
            assert -math.inf < p.low <= p.typical <= p.high < math.inf and p.unit
            assert p.null_value is None or (p.low <= p.null_value <= p.high and p.typical != p.null_value)


def test_channels_to_choose_from_are_measured():
    measured = {"quarter_rig": RIG_CHANNELS, "uto_robot": robot_channels(4)}
    for plant, channels in measured.items():
        for effect in effects_of(plant).values():
            for selector in effect.selectors:
                known = channels if selector.name == "channel" else (1, 2, 3, 4)
                assert set(selector.on(4)) <= set(known)


def test_unknown_names_are_answered_with_the_choices():
    with pytest.raises(
        UnknownNameError, match=r"effect of quarter_rig 'rail_viscos'; did you mean 'rail_visc"
    ):
        with_effects(RIG, {"rail_viscos": {}})
    with pytest.raises(UnknownNameError, match=r"choices: .*roller_friction"):
        with_effects(ROBOT, {"rail_viscous": {}})
    with pytest.raises(UnknownNameError, match="choices: coefficient"):
        with_effects(RIG, {"rail_viscous": {"force": 1.0}})
    with pytest.raises(UnknownNameError, match="choices: carriage_acceleration, carriage_speed, current"):
        with_effects(RIG, {"sensor_delay": {"channel": "yaw"}})
    with pytest.raises(InputError, match="'channel' is missing"):
        with_effects(RIG, {"sensor_delay": {"delay": 0.01}})
    with pytest.raises(UnknownNameError, match="plant 'rig'"):
        effects_of("rig")


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, 1e9, True, "2", None])
def test_a_value_that_breaks_its_bounds_is_refused_with_them(value):
    with pytest.raises(
        InputError, match=r"rail_viscous\.coefficient: found .*(at most 20|a number is needed)"
    ):
        with_effects(RIG, {"rail_viscous": {"coefficient": value}})


def test_what_is_left_out_is_filled_in():
    assert with_effects(RIG, {"grade": {}}).effects["grade"] == {"slope": 0.02}
    found = with_effects(RIG, {"bearing_friction": {"torque": 0.05}}).effects["bearing_friction"]
    assert found == {"torque": 0.05, "viscous": 0.0}  # the other amplitude is gone
    found = with_effects(RIG, {"rail_stribeck": {"force": 2.0}}).effects["rail_stribeck"]
    assert found == {"force": 2.0, "velocity": 0.15}  # the shape is typical


def test_effects_join_those_that_are_there():
    first = with_effects(RIG, {"grade": {"slope": 0.01}})
    second = with_effects(first, {"rail_viscous": {"coefficient": 1.0}, "grade": {"slope": 0.03}})
    assert second.effects == {"grade": {"slope": 0.03}, "rail_viscous": {"coefficient": 1.0}}
    assert first.effects == {"grade": {"slope": 0.01}} and RIG.effects == {}


def test_an_effect_is_written_as_name_and_values():
    assert parse_effect("rail_viscous") == ("rail_viscous", {})
    assert parse_effect("rail_viscous", "quarter_rig") == ("rail_viscous", {"coefficient": 1.5})
    name, values = parse_effect("sensor_delay_2:channel=wheel_speed,delay=0.01", "quarter_rig")
    assert (name, values) == ("sensor_delay_2", {"channel": "wheel_speed", "delay": 0.01})
    assert parse_effect("torque_constant:wheel=3,scale=.8")[1] == {"wheel": 3, "scale": 0.8}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("rail_viscos", "did you mean 'rail_viscous'"),
        ("", "unknown effect of quarter_rig ''"),
        ("rail_viscous:", "is not KEY=VALUE; e.g. --effect rail_viscous:coefficient=1.5"),
        ("rail_viscous:coefficient", "is not KEY=VALUE"),
        ("rail_viscous:coefficient=x", "a number is needed"),
        ("rail_viscous:coefficient=1,coefficient=2", "twice"),
        ("rail_viscous:force=1", "choices: coefficient"),
        ("rail_viscous:coefficient=nan", "at most 20"),
        ("sensor_delay:channel=yaw", "choices: carriage_acceleration"),
    ],
)
def test_a_wrongly_written_effect_is_explained(text, complaint):
    with pytest.raises(InputError, match=re.escape(complaint)) as caught:
        parse_effect(text, "quarter_rig")
    assert "\n" not in str(caught.value)


@given(st.text(max_size=40))
def test_any_text_is_an_effect_or_refused(text):
    for plant in (None, "quarter_rig", "uto_robot"):
        try:
            name, values = parse_effect(text, plant)
            if plant is not None:
                assert name in with_effects(MACHINES[plant], {name: values}).effects
        except InputError as error:
            assert str(error).startswith("--effect ")


@given(st.sampled_from(sorted(EFFECTS)), st.text("abcdefilmnoprstuvwy_=,.:0123456789-e", max_size=30))
def test_any_values_are_read_or_refused(name, rest):
    for plant in ("quarter_rig", "uto_robot"):
        try:
            with_effects(MACHINES[plant], dict([parse_effect(f"{name}:{rest}", plant)]))
        except InputError as error:
            assert "\n" not in str(error)


NEW_FILE = """
from omnimj.effects.effect import RIG, Effect, EffectParameter


def _bent(changes, values):
    changes.set_term("sticky", 2.5 * values["force"], sticky_place=0.7, sticky_width=0.2)


EFFECTS = (
    Effect("bent_rail", "the rail is bent", "rail", (RIG,), (EffectParameter("force", "N", -9.0, 9.0, 1.0),),
           hooks=(_bent,)),
)
"""
USES_IT = """
from omnimj.effects import apply_effects, parse_effect, with_effects
from omnimj.parameters import read_rig
name, values = parse_effect("bent_rail:force=2", "quarter_rig")
print(name, apply_effects(with_effects(read_rig(), {name: values})).terms[0].max())
"""


def test_a_new_effect_is_one_new_file(tmp_path):
    here = Path(__file__).resolve().parents[2]
    for folder in ("omnimj", "models"):
        shutil.copytree(
            here / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__", "*.png")
        )
    (tmp_path / "omnimj" / "effects" / "bent_rail.py").write_text(NEW_FILE, encoding="utf-8")
    found = subprocess.run(
        [sys.executable, "-c", USES_IT],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path), "OMNIMJ_CACHE": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.stdout.split() == ["bent_rail", "5.0"], found.stderr
