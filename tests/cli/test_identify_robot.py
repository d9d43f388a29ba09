"""`omnimj identify` on the logs of a robot, and the other commands on its files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from driven_missions import as_run, driven
from foreign_robot.foreign_dataset import loaded_moment, write_dataset
from foreign_robot.foreign_drive import drive
from foreign_robot.true_robot import Fault, draw_robot

from omnimj.cli.main import main
from omnimj.control.detection.robust.thresholds import read_thresholds
from omnimj.diagnosis import model_misfit
from omnimj.parameters import read_floors, read_robot
from omnimj.recording.write_dataset import write_dataset as write_runs

FILES = ["floors.toml", "identification.json", "model.toml", "report.md", "thresholds.toml"]


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """A minute and a bit of motion, and the folder that `omnimj identify` wrote from it."""
    folder = tmp_path_factory.mktemp("robot")
    runs = [as_run(driven(28.0, seed), f"run_{seed}") for seed in (11, 12, 13)]
    write_runs(folder / "healthy", "uto_robot", {"floor": "natural_stone"}, runs)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model_misfit, "INJECTIONS", 4)  # how many of them are found is a test of its own
        assert main(["identify", str(folder / "healthy"), "--out", str(folder / "out")]) == 0
    return folder / "healthy", folder / "out"


@pytest.mark.slow
def test_it_writes_model_floors_thresholds_numbers_and_report(identified):
    _, out = identified
    assert sorted(path.name for path in out.iterdir()) == FILES
    assert read_robot(out / "model.toml").motor.back_driving_efficiency > 0.0
    assert read_floors(out / "floors.toml")["natural_stone"].source.startswith("identified")
    assert read_thresholds(out / "thresholds.toml").motor > 0.0
    content = json.loads((out / "identification.json").read_text(encoding="utf-8"))
    assert content["command"].startswith("omnimj identify") and len(content["runs"]) == 3
    one = content["parameters"]["torque_ratio_2"]
    assert one["low"] < one["value"] < one["high"] and one["source"] == "data"
    assert content["floors"]["natural_stone"]["form"] in content["floors"]["natural_stone"]["forms"]
    report = (out / "report.md").read_text(encoding="utf-8")
    assert "rests on the model file's torque constant" in report and "did not excite" in report


@pytest.mark.slow
def test_other_commands_accept_its_files(identified, tmp_path, plain_files):
    _, out = identified
    files = ["--model", str(out / "model.toml"), "--floors", str(out / "floors.toml")]
    run = ["run", "circle_8m", "--plant", "planar", "--set", "duration=2.0", *files]
    assert main([*run, "--thresholds", str(out / "thresholds.toml"), "--out", str(tmp_path / "run")]) in (
        0,
        1,
    )


def judged_drives(robot, seed, rng):
    """14 logs of 40 s of one robot, and what is in each: nothing, a weak motor, or a slip."""
    cases = [("healthy", 0)] * 6 + [(kind, wheel) for kind in ("motor", "slip") for wheel in (1, 2, 3, 4)]
    logs, truths = {}, {}
    for k, (kind, wheel) in enumerate(cases):
        faults, mission = (), 1000 * seed + 500 + k
        if kind == "motor":
            faults = (Fault("motor", wheel, float(rng.uniform(10, 20)), float(rng.uniform(0.3, 0.6))),)
        if kind == "slip":
            grip, lasting = float(rng.uniform(0.1, 0.25)), float(rng.uniform(3, 6))
            onset, _ = loaded_moment(drive(robot, mission, 40.0), wheel, grip * robot.grip, lasting, 8.0)
            faults = (Fault("slip", wheel, onset, grip, onset + lasting),)
        logs[f"log_{k:02d}"], truths[f"log_{k:02d}"] = drive(robot, mission, 40.0, faults), faults
    return logs, truths


@pytest.mark.slow
@pytest.mark.parametrize("law", ["multiplies", "divides", "own"])
def test_ten_healthy_minutes_make_the_diagnosis_of_a_robot_right(law, tmp_path, measured):
    rng = np.random.default_rng([61, 77])
    robot = draw_robot(61, law, torque_constant_spread=0.05, doubled_bearings=2)
    if law == "multiplies":  # half as stiff as the floors of the source
        robot = replace(robot, slope=1.2)
    if law == "own":  # nobody mounts an inertial unit exactly at the centre
        robot = replace(robot, sensors=replace(robot.sensors, acceleration_place=(0.07, -0.05)))
    write_dataset(tmp_path / "healthy", {f"run_{k:02d}": drive(robot, 61000 + k, 40.0) for k in range(15)})
    logs, truths = judged_drives(robot, 61, rng)
    write_dataset(tmp_path / "judged", logs)
    out, told = tmp_path / "robot", tmp_path / "diagnosed"
    assert main(["identify", str(tmp_path / "healthy"), "--out", str(out)]) == 0
    files = [f"--{name}={out}/{name}.toml" for name in ("model", "floors", "thresholds")]
    assert main(["diagnose", str(tmp_path / "judged"), *files, "--out", str(told)]) == 0
    runs = json.loads((told / "diagnoses.json").read_text(encoding="utf-8"))["runs"]
    right = 0
    for name, faults in truths.items():
        named = {(d["kind"], *d["wheels"]) for d in runs[name]["diagnoses"]}
        assert faults or not named, f"{name} is healthy and has {named}"
        right += named == {(f.kind, f.wheel) for f in faults}
    measured(f"wrong diagnoses of 14, gear law {law}", 14 - right, 1)
    assert right >= 13
