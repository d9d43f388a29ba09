"""`omnimj wheel` and `omnimj robot` write files, print what they are, and refuse what cannot be."""

import json
import re

import mujoco
import pytest

from omnimj.cli.main import main
from omnimj.wheels import omni_wheel


def test_a_wheel_is_written_and_its_drop_stated_in_table_json_and_file(tmp_path, capsys):
    path = tmp_path / "made" / "wheel.xml"
    given = ["wheel", "omni", "--radius", "0.06", "--rollers", "8", "--rows", "2", "--out", str(path)]
    drop = omni_wheel(0.06, 8).drop
    assert main(given) == 0
    assert f"{1e6 * drop:.3g} µm" in capsys.readouterr().out
    assert main([*given, "--force", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["wheel"]["drop"] == pytest.approx(drop) and found["kind"] == "omni"
    assert found["wheel"]["mass"] == pytest.approx(0.35 * 1.2**3) and found["file"] == str(path)
    text = path.read_text(encoding="utf-8")
    comment = re.search(r"<!--(.*?)-->", text, flags=re.DOTALL)
    assert comment is not None and f"{1e6 * drop:.3g} µm" in comment[1]
    assert "omnimj wheel omni --radius 0.06" in text
    assert mujoco.MjModel.from_xml_path(str(path)).nv == 3 + 1 + 16


@pytest.mark.parametrize("layout", ["omni3", "omni4", "mecanum4"])
def test_a_robot_is_written_with_the_numbers_given(layout, tmp_path, capsys):
    path = tmp_path / "robot.xml"
    own = ["--wheelbase", "0.5", "--track", "0.45"] if layout == "mecanum4" else ["--arm", "0.3"]
    given = ["robot", "--layout", layout, "--mass", "30", "--radius", "0.07", "--wheel-mass", "1.2", *own]
    assert main([*given, "--actuators", "motor", "--out", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    m = mujoco.MjModel.from_xml_path(str(path))
    assert m.body_mass.sum() == pytest.approx(30.0) and found["mass"] == 30.0
    first = found["mounts"][0]["position"]
    assert m.body("wheel_1_wheel").pos[:2] == pytest.approx(first)
    assert m.nu == len(found["mounts"]) == int(layout[-1])
    assert m.body_subtreemass[m.body("wheel_1_wheel").id] == pytest.approx(1.2)


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (("wheel", "omni", "--rollers", "30"), "wheel: rollers: found 30 in a row; the rollers overlap"),
        (("wheel", "omni", "--rollers", "3"), "the hub would drop by 1.3 mm"),
        (("wheel", "omni", "--roller-radius", "0.04"), "must be at least 0.001 and at most 0.02 m"),
        (("wheel", "omni", "--roller-angle", "45"), "--roller-angle: is of mecanum wheels only"),
        (("wheel", "mecanum", "--rows", "2"), "--rows: is of omni wheels only"),
        (("wheel", "round",), "unknown kind 'round'"),
        (("wheel", "omni", "--radius", "-1"), "must be above 0"),
        (("wheel", "omni", "--timestep", "0.01"), "timestep: found 0.01 s; must be at most 0.002 s"),
        (("robot", "--layout", "omni5"), "unknown layout 'omni5'; did you mean 'omni4'?"),
        (("robot", "--layout", "mecanum4", "--arm", "0.3"), "--arm: is not of mecanum4"),
        (("robot", "--track", "0.3"), "--track: is not of omni4"),
        (("robot", "--mass", "1"), "robot: mass: found 1; must be at least 1.68"),
        (("robot", "--touch", "walls"), "unknown value of touch 'walls'"),
        (("robot", "--actuators", "servo"), "unknown actuator 'servo'"),
        (("robot", "--model", "file.xml"), "--model file.xml: is the file of --out"),
        (("robot", "--model", "robot.toml", "--rollers", "8"), "has 16 rollers in 2 rows"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line_and_writes_nothing(refused, argv, message):
    assert message in refused(*argv, "--out", "file.xml")


def test_a_file_is_only_replaced_on_demand(tmp_path, refused):
    path = tmp_path / "robot.xml"
    path.write_text("mine")
    assert "exists already" in refused("robot", "--out", str(path))
    assert path.read_text() == "mine"
    assert main(["robot", "--out", str(path), "--force"]) == 0
    assert path.read_text().startswith("<mujoco")


def test_the_output_is_needed(refused):
    assert "--out" in refused("wheel", "omni")
    assert "is a folder" in refused("robot", "--out", "/")
