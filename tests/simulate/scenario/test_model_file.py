"""`--model FILE`: what is changed in a copy of a model file changes the plant and the controller."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from nightly import in_turn

from omnimj.resources import models_folder
from omnimj.signals import CurrentCommand
from omnimj.simulate.plants import make_plant
from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import read_scenario

ROBOT = (models_folder() / "uto_robot" / "robot.toml").read_text(encoding="utf-8")
RIG = (models_folder() / "quarter_rig" / "rig.toml").read_text(encoding="utf-8")
PLANTS = ("twin", "planar")
ALONG_Y = np.array([-1.0, 0.0, 1.0, 0.0])
QUICK = ("duration=0.3", "checks={}")


def changed(folder: Path, text: str, *changes: str) -> Path:
    """A copy with `table.key=value` changes, each in place or as a table that overrides the parts."""
    for change in changes:
        name, value = change.split("=")
        table, key = name.split(".")
        own = re.compile(rf"(?s)(\[{table}\].*?\n{key} = \{{ value = ).*?(?=, unit)")
        if own.search(text):
            text = own.sub(rf"\g<1>{value}", text, count=1)
        else:
            parts = (models_folder() / "parts.toml").read_text(encoding="utf-8")
            found = re.search(rf'(?s)\[{table}\].*?\n{key} = .*?unit = "(.*?)"', parts)
            assert found is not None, name
            header = f"\n[{table}]\n"
            text = text if header in text else text + header
            entry = f'{key} = {{ value = {value}, unit = "{found[1]}", source = "measured" }}\n'
            text = text.replace(header, header + entry)
    path = folder / "changed.toml"
    path.write_text(text, encoding="utf-8")
    return path


def acceleration(plant: str, model: Path | None, current: float = 1.4) -> float:
    """Along +y with a constant current in wheels 1 and 3 on natural stone, from 0.1 to 0.3 s [m/s²]."""
    scenario = read_scenario("nylon_patch", ("patches=[]", *QUICK), model)
    driven = make_plant(scenario, plant, seed=0)
    driven.reset()
    column = driven.truth_names.index("twist_y")
    speed = []
    for _ in range(300):
        driven.step(CurrentCommand(current * ALONG_Y))
        speed.append(driven.truth()[column])
    return (speed[299] - speed[99]) / 0.2


@pytest.mark.parametrize("plant", PLANTS)
def test_twice_the_mass_has_about_half_the_acceleration(tmp_path, plant):
    heavy = changed(tmp_path, ROBOT, "body.mass=31.674", "body.yaw_inertia=1.1")
    # wheels and rotors of the two driving corners add 0.7 kg that does not double, friction grows with weight
    assert acceleration(plant, heavy) / acceleration(plant, None) == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("plant", PLANTS)
def test_twice_the_torque_constant_more_than_doubles_the_acceleration(tmp_path, plant):
    strong = changed(tmp_path, ROBOT, "motor.torque_constant=0.08")
    # friction stays what it is; a small current, or the wheels would slip
    assert 2.0 < acceleration(plant, strong, 0.6) / acceleration(plant, None, 0.6) < 3.0


def test_the_two_plants_agree_about_a_changed_robot(tmp_path):
    other = changed(
        tmp_path, ROBOT, "body.mass=20.0", "motor.gear_ratio=15.0", "wheel.radius=0.06", "wheel.inertia=8e-4"
    )
    assert acceleration("twin", other) == pytest.approx(acceleration("planar", other), rel=0.05)
    assert acceleration("twin", other) < 0.6 * acceleration("twin", None)


def trace_of(name: str, plant: str, model: Path | None, *overrides: str) -> dict[str, np.ndarray]:
    return dict(run_scenario(read_scenario(name, (*QUICK, *overrides), model), plant).trace.columns)


OF_ROBOT = [
    "wheel.inertia=6e-4",
    "wheel.roller_dry=0.05",
    "bearing.dry=0.02",
    "motor.rotor_inertia=3e-6",
    "motor.no_load_torque=1e-2",
    "sensors.gyro_noise=0.01",
    "body.yaw_inertia=0.7",
    "control.speed_proportional=0.2",
]
OF_RIG = ["rig.rail_friction=1.0", "rig.rail_dry=0.3", "motor.torque_constant=0.03", "wheel.radius=0.055"]


@pytest.mark.parametrize(("change", "plant"), in_turn(OF_ROBOT, PLANTS))
def test_a_changed_value_of_the_robot_reaches_the_run(tmp_path, plant, change):
    shipped = trace_of("nylon_patch", plant, None, "drive.start_time=0.0")
    other = trace_of("nylon_patch", plant, changed(tmp_path, ROBOT, change), "drive.start_time=0.0")
    assert any((other[column] != shipped[column]).any() for column in shipped)


@pytest.mark.parametrize(("change", "plant"), in_turn(OF_RIG, PLANTS))
def test_a_changed_value_of_the_rig_reaches_the_run(tmp_path, plant, change):
    other = trace_of("rig_lateral", plant, changed(tmp_path, RIG, change))
    shipped = trace_of("rig_lateral", plant, None)
    assert abs(other["true_carriage_speed"][-1] / shipped["true_carriage_speed"][-1] - 1.0) > 0.005


def test_values_of_the_twin_alone_reach_the_twin(tmp_path):
    shipped = trace_of("nylon_patch", "twin", None, "drive.start_time=0.0")
    for change in ("contact.stiffness=3e5", "body.suspension_stiffness=8000.0", "wheel.roller_mass=0.011"):
        other = trace_of("nylon_patch", "twin", changed(tmp_path, ROBOT, change), "drive.start_time=0.0")
        assert (other["normal_force_1"] != shipped["normal_force_1"]).any(), change


def test_the_first_mass_of_the_rig_is_the_default(tmp_path):
    path = tmp_path / "mine.toml"
    shipped = read_scenario("rig_lateral")
    path.write_text(
        "description = 'x'\nplant = 'quarter_rig'\nfloor = 'pvc'\nduration = 0.1\ncurrent = 1.0\n"
    )
    light = changed(tmp_path, RIG, "rig.masses=[2.0]")
    assert read_scenario(path).drive.mass == shipped.constants.rig.masses[0]
    assert read_scenario(path, (), light).drive.mass == 2.0


@pytest.mark.parametrize("plant", PLANTS)
def test_a_copied_model_file_changes_nothing(tmp_path, monkeypatch, plant):
    monkeypatch.chdir(tmp_path)
    for name, text in (("nylon_patch", ROBOT), ("rig_lateral", RIG)):
        Path("copy.toml").write_text(text, encoding="utf-8")
        copied, shipped = trace_of(name, plant, Path("copy.toml")), trace_of(name, plant, None)
        assert all((copied[column] == shipped[column]).all() for column in shipped)
