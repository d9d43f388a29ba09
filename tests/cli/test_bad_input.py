"""Bad input of every kind: one clear line on stderr, exit code 2, nothing driven and nothing written."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from omnimj.cli.main import main
from omnimj.plant.planar import PlanarRobot
from omnimj.plant.planar_rig import PlanarRig
from omnimj.resources import models_folder, scenarios_folder

ROBOT = (models_folder() / "uto_robot" / "robot.toml").read_text(encoding="utf-8")
RIG = (models_folder() / "quarter_rig" / "rig.toml").read_text(encoding="utf-8")
PARTS = (models_folder() / "parts.toml").read_text(encoding="utf-8")
NYLON = (scenarios_folder() / "nylon_patch.toml").read_text(encoding="utf-8")
ON_ROBOT = ("run", "nylon_patch", "--plant", "planar")
ON_RIG = ("run", "rig_lateral", "--plant", "planar")
DEEP = "[" * 100_000
Refused = Callable[..., str]


@pytest.fixture
def refused(capsys, monkeypatch, tmp_path) -> Refused:
    """Calls the command in an empty folder; returns its one line."""
    empty = tmp_path / "empty"
    empty.mkdir()
    monkeypatch.chdir(empty)

    def driven(self):
        raise AssertionError("driven")

    monkeypatch.setattr(PlanarRobot, "reset", driven)
    monkeypatch.setattr(PlanarRig, "reset", driven)

    def call(*argv: str) -> str:
        code = main(list(argv))
        out, err = capsys.readouterr()
        lines = [line for line in err.splitlines() if not line.startswith("compiling native code")]
        assert (code, out, len(lines)) == (2, "", 1), (code, out, err)
        assert lines[0].startswith("omnimj") and not lines[0].startswith("omnimj: omnimj")
        assert not list(empty.iterdir())
        return lines[0]

    return call


@pytest.mark.parametrize(
    ("argv", "told"),
    [
        (["--nope"], "required: COMMAND"),
        (["fly"], "choose from 'scenarios', 'run', 'bench'"),
        (["run"], "required: scenario"),
        (["run", "nylon_patch", "extra"], "omnimj run: found 'extra', one argument too many"),
        (["run", "nylon_patch", "--sede", "1"], "unknown option '--sede'; did you mean '--seed'?"),
        (["run", "nylon_patch", "--outt=x"], "unknown option '--outt'; did you mean '--out'?"),
        (["scenarios", "nylon_patch"], "omnimj scenarios: found 'nylon_patch'"),
        (["run", ""], "unknown scenario ''; choices: circle_8m"),
        (["run", "."], "unknown scenario '.'"),
        (["run", "nylon_path"], "did you mean 'nylon_patch'?"),
        (["run", "nylon_patch\n"], "unknown scenario 'nylon_patch\\n'"),
        (["run", "x" * 300], "unknown scenario 'xxx"),
        (["run", "nylon_patch.toml"], "nylon_patch.toml: no such scenario file; give the path"),
        (["run", "no/such"], "no/such: no such scenario file"),
        (["run", "../empty"], "../empty: is a folder"),
        (["run", "/" + "y" * 5000 + ".toml"], "File name too long"),
    ],
)
def test_a_command_or_scenario_that_does_not_exist(refused: Refused, argv, told):
    assert told in refused(*argv)


@pytest.mark.parametrize(
    ("argv", "told"),
    [
        *((["--seed", seed], f"argument --seed: found '{seed}'") for seed in ("x", "-1", "1.5", "", "1_0", "inf")),
        (["--seed", "9" * 5000], "must be a whole number, at least 0"),
        (["--seed", str(2**63)], f"below {2**63}"),
        (["--seed"], "expected one argument"),
        (["--plant", ""], "--plant: unknown plant ''; choices: planar, twin"),
        (["--plant", "Twin"], "did you mean 'twin'?"),
        (["--plant", "serial:/dev/ttyUSB0?baud=1"], "drives no real robot"),
        (["--plant", "udp:robot:9000"], "drives no real robot"),
        (["--method", "best"], "--method: found 'best'"),
        (["--method", ""], "--method: found ''"),
        (["--force"], "--force: there is no --out"),
        (["--model", "no_such.toml"], "no_such.toml: no such file"),
        (["--model", "."], ".: is a folder; a TOML file is needed"),
        (["--model", "/dev/null"], "plant: found None; this file must say"),
    ],
)
def test_an_option_out_of_its_range(refused: Refused, argv, told):
    assert told in refused(*ON_ROBOT[:2], *argv)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("duration", "--set 'duration': is not KEY=VALUE; e.g. --set faults.0.wheel=3"),
        ("=1", "is not KEY=VALUE"),
        ("a..b=1", "is not KEY=VALUE"),
        ("a=", "--set a: unknown key 'a'; choices: checks, description, drive, duration"),
        ("__class__=1", "unknown key '__class__'"),
        ("floor.x=1", "'floor' is a single value"),
        ("patches.1.floor=oil", "there is no patches.1"),
        ("patches.-1.floor=oil", "'-1' is not an index"),
        ("patches.²=1", "is not an index"),
        ("duration=", "nylon_patch.toml: duration: found ''; a number is needed"),
        ("duration=nan", "found nan; must be at least 0.01 and at most 1800"),
        ("duration=1e9", "found 1000000000.0; must be at least 0.01 and at most 1800"),
        ("duration=true", "found True; a number is needed"),
        ("duration=1979-05-27", "a number is needed"),
        ("duration=0x" + "f" * 5000, "a number is needed"),
        ("duration=" + "9" * 5000, "a number is needed"),
        ("floor=" + DEEP, "unknown floor"),
        ("floor=" + "x" * 100_000, "unknown floor"),
        ("floor=lava", "floor: unknown floor 'lava'; choices: dry_asphalt"),
        ("floor=5", "floor: found 5; one line of text is needed"),
        ("level=dream", "level: unknown level 'dream'; choices: kinematic, physics"),
        ("description=", "description: found ''; one line of text"),
        ("drive=5", "drive: found 5; a table is needed"),
        ("drive.kind=fly", "unknown drive 'fly'; choices: circle, hold"),
        ("drive.speed=0", "drive.speed: found 0; must be above 0"),
        ("drive.sped=1", "did you mean 'speed'?"),
        ("drive.start=[1]", "two numbers [x, y] are needed"),
        ("drive.yaw_loop=1", "must be true or false"),
        ("faults=5", "write [[faults]]"),
        ("faults=[5]", "faults.0: found 5; a table is needed"),
        ("faults=[{}]", "faults.0: 'kind' is missing; choices: all_wheel_slip"),
        ('faults=[{kind="slip", onset=0, wheel=1, floor="lava"}]', "faults.0.floor: unknown floor 'lava'"),
        ('faults=[{kind="slip", onset=0, wheel=5, grip=0.1}]', "wheel: found 5; must be at least 1 and at most 4"),
        ('faults=[{kind="slip", onset=99, wheel=1, grip=0.1}]', "onset: found 99; must be at least 0 and at most 4"),
        ('faults=[{kind="motor", onset=0, wheel=1, loss=1.5}]', "loss: found 1.5"),
        ('faults=[{kind="payload", onset=0, mass=101}]', "mass: found 101"),
        ('faults=[{kind="sensor", onset=0, channel="nose", mode="bias", size=1}]', "unknown channel 'nose'"),
        ("patches.0.floor=lava", "patches.0.floor: unknown floor 'lava'"),
        ("patches.0.size=[0, 1]", "patches.0.size[0]: found 0; must be above 0"),
        ("patches.0.center=[inf, 1]", "patches.0.center[0]: found inf"),
        ("checks.peak_sped=1", "did you mean 'peak_speed'?"),
        ("checks.peak_speed=nan", "checks.peak_speed: found nan"),
        ("checks.peak_speed={}", "give min, max or both"),
        ("plant=quarter_rig", "a scenario belongs to its plant"),
        ("current=1", "unknown key 'current'"),
        ("kinematics.plant=published", "it needs level = 'kinematic'"),
    ],
)
def test_a_value_that_cannot_be_set(refused: Refused, text, told):
    message = refused(*ON_ROBOT, "--set", text)
    assert told in message and len(message) < 1000


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("current=1.6", "current: found 1.6; must be at least -1.5 and at most 1.5"),
        ("mass=0.35", "mass: found 0.35; must be above 0.35"),
        ("lateral_speed=9", "lateral_speed: found 9; must be at least -0.5 and at most 0.5"),
        ("drive.kind=hold", "unknown key 'drive'"),
        ('faults=[{kind="payload", onset=0, mass=-9}]', "faults.0.mass: found -9; must be above -3.6"),
        ('faults=[{kind="free", onset=0, wheel=2}]', "wheel: found 2"),
        ('faults=[{kind="sensor", onset=0, channel="yaw", mode="freeze"}]', "unknown channel 'yaw'"),
        ("checks.max_yaw_excursion=1", "unknown key 'max_yaw_excursion'; choices: final_current"),
    ],
)
def test_a_value_that_cannot_be_set_on_the_rig(refused: Refused, text, told):
    assert told in refused(*ON_RIG, "--set", text)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("kinematics=5", "kinematics: found 5; a table is needed"),
        ("kinematics.weights=[1e-320, 1, 1, 1]", "kinematics.weights[0]: found 1e-320; must be at least 1e-09"),
        ("kinematics.lost_wheel=0", "must be at least 1 and at most 4"),
        ("kinematics.misalignment=[1, 1, 1, 1]", "at most 0.5"),
        ('faults=[{kind="free", wheel=1, onset=0}]', "no effect at the kinematic level"),
        ("checks.rms_current=1", "unknown metric 'rms_current'"),
    ],
)
def test_a_value_that_cannot_be_set_at_the_kinematic_level(refused: Refused, text, told):
    assert told in refused("run", "circle_8m_kinematic", "--set", text)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "plant: unknown plant None; choices: quarter_rig, uto_robot"),
        (b"plant = ", "is not valid TOML"),
        (bytes(range(256)), "is not valid TOML; 'utf-8' codec"),
        (NYLON.encode("utf-16"), "is not valid TOML"),
        (f"a = {DEEP}".encode(), "nested too deeply"),
        (b"a." * 5000 + b"a = 1", "unknown plant None"),
        (b"plant = 0x" + b"f" * 5000, "a whole number has more than 64 bits"),
        (b"plant = 1" + b"0" * 5000, "is not valid TOML"),
        (NYLON.replace("duration = 4.0", "").encode(), "duration: is missing; a number is needed"),
        (NYLON.replace("duration", "durration", 1).encode(), "'durration'; did you mean 'duration'?"),
        (NYLON.replace("[drive]", "[driv]").encode(), "unknown key of a uto_robot scenario 'driv'"),
        (NYLON.replace("[[patches]]", "[patches]").encode(), "write [[patches]], with two brackets"),
        (NYLON.replace("uto_robot", "submarine").encode(), "unknown plant 'submarine'"),
        (NYLON.replace("uto_robot", "quarter_rig").encode(), "unknown key of a quarter_rig scenario 'drive'"),
        (NYLON[:150].encode(), "mine.toml"),
    ],
)
def test_a_scenario_file_that_is_none(refused: Refused, tmp_path, content, told):
    (tmp_path / "mine.toml").write_bytes(content)
    message = refused("run", str(tmp_path / "mine.toml"), "--plant", "planar")
    assert "mine.toml" in message and told in message


def torque_constant(value: str, unit: str = '"N.m/A"', source: str = '"text"') -> str:
    return f"\n[motor]\ntorque_constant = {{ value = {value}, unit = {unit}, source = {source} }}\n"


MODELS = [
    (torque_constant("0.0"), "mine.toml: motor.torque_constant: found 0.0; must be above 0"),
    (torque_constant("nan"), "found nan; must be above 0 and finite"),
    (torque_constant("1e400"), "found inf; must be above 0 and finite"),
    (torque_constant("true"), "found True; a number is needed"),
    (torque_constant("[0.04]"), "found [0.04]; a number is needed"),
    (torque_constant("0x" + "f" * 5000), "mine.toml: is not valid TOML; a whole number has more than 64 bits"),
    (torque_constant("0.04", unit='"N.m"'), "motor.torque_constant.unit: found 'N.m'; the unit is 'N.m/A'"),
    (torque_constant("0.04", source='"tekst"'), "unknown source 'tekst'; did you mean 'text'?"),
    (torque_constant("0.04", source="[1]"), "unknown source [1]; choices: chosen"),
    ("\n[motor]\ntorque_constant = 0.04\n", 'write { value = …, unit = "N.m/A", source = "…" }'),
    ("\n[motor]\ntorque_constant = { value = 0.04 }\n", "'unit' is missing"),
    ("\n[motor]\ntorque = 1\n", "[motor]: unknown key 'torque'; did you mean 'no_load_torque'?"),
    ("\n[motr]\n", "unknown table 'motr'; did you mean 'motor'?"),
    ("\n[wheel]\nrows = { value = 1.5, unit = '1', source = 'text' }\n", "rows: found 1.5; must be a whole number"),
    ("\n[sensors]\nsample_rate = { value = 1e9, unit = 'Hz', source = 'text' }\n", "at least 100 and at most 10000"),
    ("\n[motor]\n[motor]\n", "is not valid TOML; Cannot declare ('motor',) twice"),
]


@pytest.mark.parametrize(("argv", "shipped"), [(ON_ROBOT, ROBOT), (ON_RIG, RIG)], ids=["robot", "rig"])
@pytest.mark.parametrize(("added", "told"), MODELS)
def test_a_model_file_with_a_mistake(refused: Refused, tmp_path, argv, shipped, added, told):
    (tmp_path / "mine.toml").write_text(shipped + added, encoding="utf-8")
    message = refused(*argv, "--model", str(tmp_path / "mine.toml"))
    assert "mine.toml" in message and told in message


@pytest.mark.parametrize(
    ("old", "new", "told"),
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
def test_a_robot_that_cannot_be(refused: Refused, tmp_path, old, new, told):
    assert old in ROBOT
    (tmp_path / "mine.toml").write_text(ROBOT.replace(old, new), encoding="utf-8")
    message = refused(*ON_ROBOT, "--model", str(tmp_path / "mine.toml"))
    assert "mine.toml" in message and told in message


def test_a_robot_whose_wheels_drive_one_way_only(refused: Refused, tmp_path):
    one_way = re.sub(r"(drives_along = \{ value =) \[.*?\]", r"\1 [1.0, 0.0]", ROBOT)
    (tmp_path / "mine.toml").write_text(one_way, encoding="utf-8")
    assert "cannot drive the robot along x, along y" in refused(*ON_ROBOT, "--model", str(tmp_path / "mine.toml"))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("3.9593, 2.9593, 1.9593", "3.9593, 0.3", "rig.masses: found 0.3; must be above wheel.mass, 0.35"),
        ("value = 0.1,", "value = 2.0,", "rig.start_position: found 2; must be below rig.rail_length, 1.7"),
        ("[3.9593, 2.9593, 1.9593]", "3.9593", "rig.masses: found 3.9593; a list of numbers is needed"),
    ],
)
def test_a_rig_that_cannot_be(refused: Refused, tmp_path, old, new, told):
    assert old in RIG
    (tmp_path / "mine.toml").write_text(RIG.replace(old, new), encoding="utf-8")
    assert told in refused(*ON_RIG, "--model", str(tmp_path / "mine.toml"))


def test_the_model_of_the_other_plant(refused: Refused, tmp_path):
    for argv, other, wanted in ((ON_ROBOT, RIG, "uto_robot"), (ON_RIG, ROBOT, "quarter_rig")):
        (tmp_path / "mine.toml").write_text(other, encoding="utf-8")
        assert f"this file must say '{wanted}'" in refused(*argv, "--model", str(tmp_path / "mine.toml"))


def test_a_mistake_in_the_parts_is_told_of_the_parts_file(refused: Refused, tmp_path):
    (tmp_path / "mine.toml").write_text(ROBOT, encoding="utf-8")
    for old, new, told in (
        ("value = 0.040", "value = -1", "parts.toml: motor.torque_constant: found -1"),
        ("torque_constant", "torque_konstant", "parts.toml: [motor]: unknown key 'torque_konstant'"),
        ("[motor]", "[motr]", "parts.toml: unknown table 'motr'"),
        ("[motor]", "[motor", "parts.toml: is not valid TOML"),
    ):
        (tmp_path / "parts.toml").write_text(PARTS.replace(old, new, 1), encoding="utf-8")
        assert told in refused(*ON_ROBOT, "--model", str(tmp_path / "mine.toml"))


def test_a_run_too_long_for_its_sample_rate(refused: Refused, tmp_path):
    fast = "\n[sensors]\nsample_rate = { value = 1e4, unit = 'Hz', source = 'chosen' }\n"
    (tmp_path / "mine.toml").write_text(ROBOT + fast, encoding="utf-8")
    argv = ("--set", "duration=1800", "--model", str(tmp_path / "mine.toml"))
    assert "duration: found 1800; at most 200 s at a sample rate of 10000 Hz" in refused(*ON_ROBOT, *argv)


def test_a_file_that_may_not_be_read(refused: Refused, tmp_path, monkeypatch):
    def forbidden(self, *_):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "read_bytes", forbidden)
    assert "nylon_patch.toml: cannot be read (Permission denied)" in refused(*ON_ROBOT)


def test_an_out_that_cannot_be_a_run(refused: Refused, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("precious")
    (tmp_path / "taken" / "run.rrd").mkdir(parents=True)
    (tmp_path / "link").symlink_to("nowhere")
    file = str(tmp_path / "full" / "mine.txt")
    for out, force, told in (
        (tmp_path / "full", (), "is not empty; choose another folder, or --force"),
        (file, (), "is a file; a folder is needed"),
        (file, ("--force",), "is a file; a folder is needed"),
        (f"{file}/below", (), "mine.txt is a file; a folder is needed"),
        (tmp_path / "link", (), "is a link that leads nowhere"),
        (tmp_path / "taken", ("--force",), "has a folder run.rrd"),
        (tmp_path / ("n" * 300), (), "File name too long"),
    ):
        assert told in refused(*ON_ROBOT, "--out", str(out), *force)
    assert (tmp_path / "full" / "mine.txt").read_text() == "precious"


def test_an_out_that_may_not_be_written(refused: Refused, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    (tmp_path / "shut").mkdir()
    for out in ("shut", "shut/a/run"):
        message = refused(*ON_ROBOT, "--out", str(tmp_path / out))
        assert f"cannot be written, {tmp_path / 'shut'} is read-only" in message


@pytest.mark.parametrize(
    ("scenario", "scene", "content", "told"),
    [
        ("nylon_patch", "uto_robot/uto_robot.xml", b"<mujoco>", "XML"),
        ("nylon_patch", "uto_robot/uto_robot.xml", b"", "Empty file"),
        ("nylon_patch", "uto_robot/scene.xml", bytes(range(256)), "XML"),
        ("nylon_patch", "uto_wheel.xml", b"<mujoco><fly/></mujoco>", "unrecognized element"),
        ("rig_lateral", "quarter_rig/quarter_rig.xml", b"<mujoco/>", "Empty include file"),
    ],
)
def test_an_mjcf_that_mujoco_does_not_read(refused: Refused, tmp_path, monkeypatch, scenario, scene, content, told):
    shutil.copytree(models_folder(), tmp_path / "models")
    (tmp_path / "models" / scene).write_bytes(content)
    monkeypatch.setattr("omnimj.twin.assembly.models_folder", lambda: tmp_path / "models")
    message = refused("run", scenario)
    assert "scene.xml: is not a model that MuJoCo reads" in message and told in message
