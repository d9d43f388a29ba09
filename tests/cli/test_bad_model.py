"""Model files and MJCF with mistakes: one clear line that names the file, exit code 2, nothing driven."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable

import pytest
from mentions import mentions

from omnimj.resources import models_folder

ROBOT = (models_folder() / "uto_robot" / "robot.toml").read_text(encoding="utf-8")
RIG = (models_folder() / "quarter_rig" / "rig.toml").read_text(encoding="utf-8")
PARTS = (models_folder() / "parts.toml").read_text(encoding="utf-8")
ON_ROBOT = ("run", "nylon_patch", "--plant", "planar")
ON_RIG = ("run", "rig_lateral", "--plant", "planar")
Refused = Callable[..., str]


def torque_constant(value: str, unit: str = '"N.m/A"', source: str = '"text"') -> str:
    return f"\n[motor]\ntorque_constant = {{ value = {value}, unit = {unit}, source = {source} }}\n"


MODELS = [
    (torque_constant("0.0"), "mine.toml: motor.torque_constant: found 0.0; must be above 0"),
    (torque_constant("nan"), "found nan; must be above 0 and finite"),
    (torque_constant("1e400"), "found inf; must be above 0 and finite"),
    (torque_constant("true"), "found True; a number is needed"),
    (torque_constant("[0.04]"), "found [0.04]; a number is needed"),
    (
        torque_constant("0x" + "f" * 5000),
        "mine.toml: is not valid TOML; a whole number has more than 64 bits",
    ),
    (torque_constant("0.04", unit='"N.m"'), "motor.torque_constant.unit: found 'N.m'; the unit is 'N.m/A'"),
    (torque_constant("0.04", source='"tekst"'), "unknown source 'tekst'; did you mean 'text'?"),
    (torque_constant("0.04", source="[1]"), "unknown source [1]; choices: chosen"),
    ("\n[motor]\ntorque_constant = 0.04\n", 'write { value = …, unit = "N.m/A", source = "…" }'),
    ("\n[motor]\ntorque_constant = { value = 0.04 }\n", "'unit' is missing"),
    ("\n[motor]\ntorque = 1\n", "[motor]: unknown key 'torque'; did you mean 'no_load_torque'?"),
    ("\n[motr]\n", "unknown table 'motr'; did you mean 'motor'?"),
    (
        "\n[wheel]\nrows = { value = 1.5, unit = '1', source = 'text' }\n",
        "rows: found 1.5; must be a whole number",
    ),
    (
        "\n[sensors]\nsample_rate = { value = 1e9, unit = 'Hz', source = 'text' }\n",
        "at least 100 and at most 10000",
    ),
    ("\n[motor]\n[motor]\n", "is not valid TOML; Cannot declare ('motor',) twice"),
]


@pytest.mark.parametrize(("argv", "shipped"), [(ON_ROBOT, ROBOT), (ON_RIG, RIG)], ids=["robot", "rig"])
@pytest.mark.parametrize(("added", "expected"), MODELS)
def test_a_model_file_with_a_mistake(refused: Refused, tmp_path, argv, shipped, added, expected):
    (tmp_path / "mine.toml").write_text(shipped + added, encoding="utf-8")
    message = refused(*argv, "--model", str(tmp_path / "mine.toml"))
    assert "mine.toml" in message and expected in message


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("[body]", "[bdy]", "unknown table 'bdy'; did you mean 'body'?"),
        ("mass = {", "mas = {", "[body]: unknown key 'mas'; did you mean 'mass'?"),
        ("15.837", "2.0", "body.unsprung_mass: found 0.75; 4 corners must weigh less than the robot"),
        ("value = 0.75", "value = 0.3", "wheel.mass: found 0.35; must be below body.unsprung_mass, 0.3"),
        ("[0.25, 0.0]", "[0.25]", "wheels.1: position and drives_along need two numbers each"),
        ("[0.25, 0.0]", "5", "wheels.1.position: found 5; a list of numbers is needed"),
        ("[0.0, -1.0]", "[0.0, -0.9]", "wheels.1.drives_along: found [0.0, -0.9]; must have length 1"),
        ("[[wheels]]", "[[weels]]", "unknown table 'weels'"),
        ('"parts.toml"', '"nope.toml"', "parts: found 'nope.toml'; no such file beside it or in"),
        ('"parts.toml"', "5", "parts: found 5; a file name is needed"),
        ('plant = "uto_robot"', "", "plant: found None; this file must say 'uto_robot'"),
    ],
)
def test_a_robot_that_cannot_be(refused: Refused, tmp_path, old, new, expected):
    assert old in ROBOT
    (tmp_path / "mine.toml").write_text(ROBOT.replace(old, new), encoding="utf-8")
    message = refused(*ON_ROBOT, "--model", str(tmp_path / "mine.toml"))
    assert "mine.toml" in message and expected in message


def test_a_robot_whose_wheels_drive_one_way_only(refused: Refused, tmp_path):
    one_way = re.sub(r"(drives_along = \{ value =) \[.*?\]", r"\1 [1.0, 0.0]", ROBOT)
    (tmp_path / "mine.toml").write_text(one_way, encoding="utf-8")
    assert "cannot drive the robot along x, along y" in refused(
        *ON_ROBOT, "--model", str(tmp_path / "mine.toml")
    )


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("3.9593, 2.9593, 1.9593", "3.9593, 0.3", "rig.masses: found 0.3; must be above wheel.mass, 0.35"),
        ("value = 0.1,", "value = 2.0,", "rig.start_position: found 2; must be below rig.rail_length, 1.7"),
        ("[3.9593, 2.9593, 1.9593]", "3.9593", "rig.masses: found 3.9593; a list of numbers is needed"),
    ],
)
def test_a_rig_that_cannot_be(refused: Refused, tmp_path, old, new, expected):
    assert old in RIG
    (tmp_path / "mine.toml").write_text(RIG.replace(old, new), encoding="utf-8")
    assert expected in refused(*ON_RIG, "--model", str(tmp_path / "mine.toml"))


def test_the_model_of_the_other_plant(refused: Refused, tmp_path):
    for argv, other, wanted in ((ON_ROBOT, RIG, "uto_robot"), (ON_RIG, ROBOT, "quarter_rig")):
        (tmp_path / "mine.toml").write_text(other, encoding="utf-8")
        assert f"this file must say '{wanted}'" in refused(*argv, "--model", str(tmp_path / "mine.toml"))


def test_a_mistake_in_the_parts_is_reported_with_the_parts_file(refused: Refused, tmp_path):
    (tmp_path / "mine.toml").write_text(ROBOT, encoding="utf-8")
    for old, new, expected in (
        ("value = 0.040", "value = -1", "parts.toml: motor.torque_constant: found -1"),
        ("torque_constant", "torque_konstant", "parts.toml: [motor]: unknown key 'torque_konstant'"),
        ("[motor]", "[motr]", "parts.toml: unknown table 'motr'"),
        ("[motor]", "[motor", "parts.toml: is not valid TOML"),
    ):
        (tmp_path / "parts.toml").write_text(PARTS.replace(old, new, 1), encoding="utf-8")
        assert expected in refused(*ON_ROBOT, "--model", str(tmp_path / "mine.toml"))


def test_a_run_too_long_for_its_sample_rate(refused: Refused, tmp_path):
    fast = "\n[sensors]\nsample_rate = { value = 1e4, unit = 'Hz', source = 'chosen' }\n"
    (tmp_path / "mine.toml").write_text(ROBOT + fast, encoding="utf-8")
    argv = ("--set", "duration=1800", "--model", str(tmp_path / "mine.toml"))
    assert mentions(refused(*ON_ROBOT, *argv), "duration", "found 1800", "at most 200 s", "10000 Hz")


@pytest.mark.parametrize(
    ("scenario", "scene", "content", "expected"),
    [
        ("nylon_patch", "uto_robot/uto_robot.xml", b"<mujoco>", "XML"),
        ("nylon_patch", "uto_robot/uto_robot.xml", b"", "Empty file"),
        ("nylon_patch", "uto_robot/scene.xml", bytes(range(256)), "XML"),
        ("nylon_patch", "uto_wheel.xml", b"<mujoco><fly/></mujoco>", "unrecognized element"),
        ("rig_lateral", "quarter_rig/quarter_rig.xml", b"<mujoco/>", "Empty include file"),
    ],
)
def test_an_mjcf_that_mujoco_does_not_read(
    refused: Refused, tmp_path, monkeypatch, scenario, scene, content, expected
):
    shutil.copytree(models_folder(), tmp_path / "models")
    (tmp_path / "models" / scene).write_bytes(content)
    monkeypatch.setattr("omnimj.plant.mujoco.assembly.models_folder", lambda: tmp_path / "models")
    message = refused("run", scenario)
    assert "scene.xml: is not a model that MuJoCo reads" in message and expected in message
