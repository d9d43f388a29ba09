"""MJCF files that hold a model file: read as the model file is, and one clear line for each that is not."""

import dataclasses
import json

import mujoco
import pytest

from omnimj.errors import InputError
from omnimj.parameters import read_rig, read_robot
from omnimj.simulate.machine.linear_axis import read_axis
from omnimj.wheels import model_text, omni_wheel, robot_file, wheeled_robot

MADE = wheeled_robot("omni4")
TEXT = robot_file(MADE)


def read(folder, text):
    path = folder / "robot.xml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_robot(path)


def refusal(folder, text):
    with pytest.raises(InputError) as caught:
        read(folder, text)
    message = str(caught.value)
    assert "\n" not in message and "robot.xml" in message
    return message


def with_tables(change):
    """The file with tables that were changed in place."""
    begin = TEXT.index("data='", TEXT.index("omnimj_robot")) + len("data='")
    end = TEXT.index("'", begin)
    tables = json.loads(TEXT[begin:end])
    return TEXT[:begin] + json.dumps(change(tables)) + TEXT[end:]


@pytest.mark.parametrize("layout", ["omni3", "omni4", "mecanum4"])
def test_an_mjcf_file_and_a_model_file_are_the_same_robot(layout, tmp_path):
    made, model = wheeled_robot(layout, mass=18.0), tmp_path / "robot.toml"
    model.write_text(model_text(made), encoding="utf-8")
    from_model = read_robot(model)
    own = read(tmp_path, robot_file(made))
    assert own == dataclasses.replace(from_model, file=own.file)
    spec = mujoco.MjSpec.from_string(robot_file(made, bare=True))
    spec.compile()
    assert read(tmp_path, spec.to_xml()) == own  # as MuJoCo writes it


def test_a_file_without_tables_says_what_is_missing(tmp_path):
    missing = 'has no <custom><text name="omnimj_robot"> with motors and sensors; a file of `omnimj robot`'
    assert missing in refusal(tmp_path, "<mujoco><worldbody/></mujoco>")
    with pytest.raises(InputError, match=r"none\.xml: no such file"):
        read_robot(tmp_path / "none.xml")


def test_a_robot_that_the_twin_cannot_be_says_why(tmp_path):
    text = robot_file(wheeled_robot("omni4", omni_wheel(rollers=8)))
    assert "is a robot without a twin; has 16 rollers in 2 rows; the twin's wheel has 18" in refusal(
        tmp_path, text
    )


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        (f'pos="{0.25 * 0.5**0.5:.8g} ', 'pos="0.2 ', "wheel_1_wheel: pos: is 0.2"),
        ('euler="0 0 135"', 'euler="0 0 120"', "wheel_1_wheel: ahead: is -0.5"),
        ('mass="13.6"', 'mass="12.6"', "chassis: mass: is 12.6, its omnimj_robot says 13.6"),
        (' 0.009 0.009" mass="0"', ' 0.008 0.008" mass="0"', "roller: size: is 0.008"),
        ('pos="0 0.011 -0.041"', 'pos="0 0.011 -0.042"', "wheel_1_roller: distance from the axle: is 0.042"),
    ],
)
def test_a_file_whose_geometry_was_edited_is_not_taken_for_the_robot_of_its_tables(old, new, place, tmp_path):
    assert old in TEXT
    message = refusal(tmp_path, TEXT.replace(old, new, 1))
    assert place in message and "the file was edited" in message


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: [], "found []; tables of a model file are needed"),
        (lambda t: t | {"plant": "quarter_rig"}, "this file must say 'uto_robot'"),
        (lambda t: t | {"wheels": 3}, "at least three wheels are needed"),
        (lambda t: t | {"wheels": [3, {"position": {"value": "x"}}]}, "the file was edited"),
        (lambda t: t | {"body": []}, "[body] is not a table"),
        (lambda t: t | {"fuel": {}}, "unknown table 'fuel'"),
        (lambda t: t | {"wheel": {"radius": {"value": [], "unit": "m", "source": "chosen"}}}, "wheel.radius"),
        (lambda t: {name: t[name] for name in t if name != "control"}, "[control] is missing"),
        (lambda t: t | {"body": float("nan")}, "NaN is not finite"),
    ],
)
def test_wrong_tables_are_refused_in_one_line(change, message, tmp_path):
    assert message in refusal(tmp_path, with_tables(change))


def test_cut_off_flipped_and_hostile_files_are_refused_in_one_line(tmp_path):
    content = TEXT.encode()
    for cut in range(0, len(content) - 20, len(content) // 40):
        refusal(tmp_path, content[:cut])
    for place in range(0, len(content), len(content) // 60):
        flipped = bytearray(content)
        flipped[place] ^= 0x80  # no longer ASCII, nor UTF-8
        assert "is not valid XML" in refusal(tmp_path, bytes(flipped))
    bomb = b'<!DOCTYPE m [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><mujoco>&b;</mujoco>'
    assert "defines a document type" in refusal(tmp_path, bomb)
    refusal(tmp_path, bomb.decode().encode("utf-16"))
    refusal(tmp_path, b"<?xml version='1.0' encoding='none'?><mujoco/>")
    deep = '<mujoco><custom><text name="omnimj_robot" data="' + "[" * 100_000 + '"/></custom></mujoco>'
    assert "is not the text of a model file" in refusal(tmp_path, deep)


@pytest.mark.parametrize("read_machine", [read_rig, read_axis])
def test_the_file_of_a_robot_is_no_rig_and_no_axis(read_machine, tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(TEXT, encoding="utf-8")
    with pytest.raises(InputError, match="found 'uto_robot'"):
        read_machine(path)
