"""`omnimj import` with ROS 2 bags and MCAP files: preview, mapping, dataset."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest
from recording.made_bags import (
    COUNT,
    JOINTS,
    RATE,
    START,
    STORE,
    WRITERS,
    drive,
    header,
    number,
    pose_stamped,
    write_bag,
    write_mcap,
)
from servo_logs import SERVO, write_servo_logs

from omnimj.cli.main import main
from omnimj.recording.importing.mapping import read_mapping
from omnimj.recording.read_dataset import read_dataset

Refused = Callable[..., str]
TIME = np.arange(COUNT) / RATE


@pytest.mark.parametrize("writer", ["bag in SQLite", "MCAP, zstd"])
def test_a_preview_shows_topics_and_how_they_are_joined_and_proposes_a_mapping(tmp_path, capsys, writer):
    path = WRITERS[writer](tmp_path, drive())
    assert main(["import", str(path)]) == 0
    printed = capsys.readouterr().out
    assert f"{COUNT} rows at the header stamps of /joint_states" in printed
    assert "/voltage" in printed and "log: no header stamps" in printed and "at most 5 usual steps" in printed
    assert "left out: /rosout (std_msgs/String without numbers)" in printed
    assert "lacks: [defaults] floor, a scale of current_1" in printed
    mapping = tmp_path / "drive.mapping.toml"
    text = mapping.read_text()
    assert 'base = "/joint_states"' in text and "pose_measured = true if a camera" in text
    assert read_mapping(mapping).topics is not None


def test_a_confirmed_mapping_makes_a_dataset_with_the_values_of_the_messages(tmp_path, capsys):
    bag, mapping, out = write_bag(tmp_path / "drive", drive()), tmp_path / "m.toml", tmp_path / "set"
    assert main(["import", str(bag), "--floor", "pvc", "--mapping", str(mapping)]) == 0
    text = mapping.read_text()
    for n in (1, 2, 3, 4):
        text = text.replace(f'effort[wheel_{n}]"', f'effort[wheel_{n}]", scale = 2.0')
    mapping.write_text(text)
    assert main(["import", str(bag), "--mapping", str(mapping), "--out", str(out)]) == 0
    assert "rows with empty cells left out" in capsys.readouterr().out
    (run,) = read_dataset(out).runs
    rows = np.round(run.time * RATE).astype(int)
    assert run.time == pytest.approx(TIME[rows], abs=1e-9) and len(rows) == COUNT - 3
    for n in range(len(JOINTS)):
        assert np.array_equal(run.columns[f"wheel_speed_{n + 1}"], np.sin(3.0 * TIME[rows] + n))
        assert run.columns[f"current_{n + 1}"] == pytest.approx(2.0 * np.cos(TIME[rows] + n))
    assert run.columns["acceleration_x"] == pytest.approx(2.0 * TIME[rows], abs=1e-9)
    assert run.columns["yaw"] == pytest.approx(0.3 * TIME[rows], abs=1e-9)


def test_joints_of_any_machine_are_positions_velocities_and_forces_by_name(tmp_path):
    log, out = write_mcap(tmp_path / "arm.mcap", drive()), tmp_path / "set"
    assert main(["import", str(log), "--plant", "mjcf", "--out", str(out)]) == 0
    (run,) = read_dataset(out).runs
    assert run.columns["position:wheel_2"] == pytest.approx(TIME + 1.0)
    assert run.columns["force:wheel_3"] == pytest.approx(np.cos(TIME + 2.0))


def test_a_set_pose_is_no_measured_one(tmp_path, capsys):
    made = [(t.replace("/odom", "/target_pose"), kind, at, m) for t, kind, at, m in drive()]
    assert main(["import", str(write_mcap(tmp_path / "a.mcap", made)), "--json"]) == 0
    becomes = {one["name"]: one["becomes"] for one in json.loads(capsys.readouterr().out)["columns"]}
    assert becomes["/target_pose.pose.pose.position.x"] == "" and becomes["time"] == "time"


def test_a_pose_of_motion_capture_is_proposed_as_measured(tmp_path):
    made = [one for one in drive() if one[0] == "/joint_states"]
    pose = "geometry_msgs/msg/PoseStamped"
    made += [("/mocap", pose, at, pose_stamped(at - 400_000, 1.0, 2.0, 0.3)) for _, _, at, _ in made]
    mapping = tmp_path / "m.toml"
    assert main(["import", str(write_mcap(tmp_path / "a.mcap", made)), "--mapping", str(mapping)]) == 0
    assert read_mapping(mapping).defaults["pose_measured"] is True


def test_topics_that_are_chosen_are_read_and_no_others(tmp_path, capsys):
    log = write_mcap(tmp_path / "a.mcap", drive())
    assert main(["import", str(log), "--topics", "/imu,/voltage", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert {one["name"] for one in content["topics"]} == {"/imu", "/voltage"}
    assert "/odom (not needed)" in content["left_out"]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ('join = "cubic"', "join: unknown rule 'cubic'; choices: linear, previous"),
        ('stamps = "gps"', "stamps: unknown clock 'gps'"),
        ('base = "/imv"', "unknown topic '/imv'"),
        ("rate = 3", "unknown key 'rate'; choices: base, join, stamps"),
    ],
)
def test_a_wrong_choice_of_topics_is_one_line(tmp_path, refused: Refused, line, expected):
    log = write_mcap(tmp_path / "a.mcap", drive())
    (tmp_path / "m.toml").write_text(
        f'plant = "mjcf"\n[topics]\n{line}\n[columns]\ntime = {{ from = "time" }}\n'
        '"sensor:v" = { from = "/voltage.data" }\n'
    )
    assert expected in refused("import", str(log), "--mapping", str(tmp_path / "m.toml"))


def test_topics_beside_a_mapping_are_refused(tmp_path, refused: Refused):
    (tmp_path / "m.toml").write_text('plant = "mjcf"\n[columns]\ntime = { from = "time" }\n')
    argv = ["import", "a.mcap", "--mapping", str(tmp_path / "m.toml"), "--topics", "/imu"]
    assert "--topics: found '/imu'" in refused(*argv)


def test_efforts_that_happen_to_be_positive_keep_their_sign(tmp_path):
    """The definition of JointState says that they are signed, unlike a column of a table."""
    log, mapping = write_mcap(tmp_path / "a.mcap", drive(count=60)), tmp_path / "m.toml"
    assert main(["import", str(log), "--plant", "uto_robot", "--mapping", str(mapping)]) == 0
    assert "sign_of =" not in mapping.read_text().partition("[columns]")[2]


def write_servo_bags(folder, data) -> list[str]:
    """Bags of the runs of a servo: joint states, and the voltage without header."""
    kind, none = STORE.types["sensor_msgs/msg/JointState"], np.empty(0)
    files = []
    for run in read_dataset(data).runs:
        made = []
        for t, place, voltage in zip(*(run.columns[n] for n in ("time", *SERVO_COLUMNS)), strict=True):
            at = START + round(t * 1e9)
            joints = kind(header(at), ["shaft"], np.array([place]), none, none)
            made.append(("/joint_states", "sensor_msgs/msg/JointState", at + 200_000, joints))
            made.append(("/motor/voltage", "std_msgs/msg/Float64", at + 100_000, number(float(voltage))))
        files.append(str(write_bag(folder / run.name, made)))
    return files


SERVO_COLUMNS = ("position:shaft", "control:motor")


@pytest.mark.slow
def test_bags_of_a_servo_lead_to_the_effect_that_they_were_made_with(tmp_path, capsys):
    write_servo_logs(tmp_path / "data", load_share=0.12)
    files, mapping = write_servo_bags(tmp_path, tmp_path / "data"), tmp_path / "servo.toml"
    assert main(["import", *files, "--plant", "mjcf", "--mapping", str(mapping)]) == 0
    command = '"control:motor" = { from = "/motor/voltage.data" }\n'
    mapping.write_text(mapping.read_text().replace("# not used:\n", f"{command}# not used:\n"))
    made = tmp_path / "set"
    assert main(["import", *files, "--mapping", str(mapping), "--out", str(made)]) == 0
    assert main(["gap", str(made), "--model", str(SERVO), "--out", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "gap.json").read_text())
    assert [one["effect"] for one in found["effects"]] == ["load_friction"]
    share = found["effects"][0]["parameters"]["share"]
    assert share["low"] < 0.12 < share["high"]
