"""The gap workflow on a machine that only its MJCF file describes."""

import json

import mujoco
import numpy as np
import pytest
from servo_logs import SERVO, write_servo_logs

from omnimj.cli.main import main
from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.read_dataset import read_dataset
from omnimj.resources import models_folder
from omnimj.workflows import record

AXIS = models_folder() / "linear_axis" / "linear_axis.xml"
TRUTH = [0.012, 0.025, 0.52, 4.8, 0.0005]


@pytest.mark.slow
def test_hidden_friction_is_found_and_the_new_model_file_explains_the_logs(tmp_path, capsys):
    data, out = tmp_path / "data", tmp_path / "out"
    write_servo_logs(data, load_share=0.12)
    assert main(["gap", str(data), "--model", str(SERVO), "--out", str(out)]) == 0
    assert "load_friction (shaft)" in capsys.readouterr().out
    found = json.loads((out / "gap.json").read_text())
    assert found["model"] == "model.xml" and [e["effect"] for e in found["effects"]] == ["load_friction"]
    share = found["effects"][0]["parameters"]["share"]
    assert share["low"] < 0.12 < share["high"] and share["value"] == pytest.approx(0.12, rel=0.1)
    assert mujoco.MjModel.from_xml_path(str(out / "model.xml")).njnt == 1
    new = voltage_mismatch(data, out / "model.xml", {})
    true = voltage_mismatch(data, SERVO, {"load_friction (shaft)": np.array([0.12])}, TRUTH)
    assert new < 1.15 * true


def voltage_mismatch(data, file, effects, base=None):
    replay = MachineReplay(read_dataset(data), read_machine_file(file))
    base = [b.nominal for b in replay.base] if base is None else base
    (found,) = replay.simulate([Setting(np.array(base), effects)])
    return float(np.sqrt(np.nanmean((replay.measured - found)[:, 0] ** 2)))


@pytest.mark.slow
def test_an_empty_machine_gets_no_name(tmp_path):
    write_servo_logs(tmp_path / "data")
    assert main(["gap", str(tmp_path / "data"), "--model", str(SERVO), "--out", str(tmp_path / "out")]) == 0
    assert json.loads((tmp_path / "out" / "gap.json").read_text())["verdict"] == "no_gap"


@pytest.mark.slow
def test_logs_of_an_axis_are_searched_with_an_mjcf_file(tmp_path):
    record("axis_moves", tmp_path / "data", 4, 1, effects={"asymmetric_viscous": {"difference": 60.0}})
    order = ["gap", str(tmp_path / "data"), "--model", str(AXIS), "--out", str(tmp_path / "out")]
    assert main(order) == 0
    found = json.loads((tmp_path / "out" / "gap.json").read_text())
    assert (found["plant"], found["verdict"], found["model"]) == ("mjcf", "named", "model.xml")
    (effect,) = found["effects"]
    assert (effect["effect"], effect["selectors"]) == ("asymmetric_viscous", {"joint": "carriage"})
    assert effect["parameters"]["difference"]["value"] == pytest.approx(60.0, rel=0.01)
    assert read_machine_file(tmp_path / "out" / "model.xml").effects["asymmetric_viscous"]


def test_a_run_states_the_mass_of_a_body(tmp_path):
    write_servo_logs(tmp_path / "data", runs=1)
    file = tmp_path / "data" / "dataset.toml"
    file.write_text(file.read_text() + '"mass:arm" = 0.6\n')
    (run,) = read_dataset(tmp_path / "data").runs
    assert run.conditions == {"mass:arm": 0.6}


def test_a_dataset_without_a_model_asks_for_its_file(tmp_path, capsys):
    write_servo_logs(tmp_path / "data", runs=1)
    assert main(["gap", str(tmp_path / "data"), "--out", str(tmp_path / "out")]) == 2
    assert "needs its MJCF file" in capsys.readouterr().err


def test_a_dataset_names_its_model_beside_it(tmp_path):
    write_servo_logs(tmp_path / "data", runs=1)
    file = tmp_path / "data" / "dataset.toml"
    file.write_text(f'model = "../servo.xml"\n{file.read_text()}')
    assert read_dataset(tmp_path / "data").model == tmp_path / "data" / "../servo.xml"
