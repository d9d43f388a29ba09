"""Robots with a measured pose and no inertial unit: what is accepted, masked, and refused."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

import omnimj
from omnimj.cli.main import main
from omnimj.errors import InputError, UnknownNameError
from omnimj.recording.dataset import Run, require_inertial_unit
from omnimj.recording.logger_faults import burst_share, find_repeats, is_magnitude
from omnimj.recording.read_dataset import read_dataset
from omnimj.recording.write_dataset import write_dataset

DEFAULTS = {"floor": "pvc", "pose_measured": True}


def logged(rate: float = 20.0, wheels: int = 3, seed: int = 0) -> dict[str, np.ndarray]:
    """Four seconds of a robot on a circle, at irregular times."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.8, 1.2, round(4.0 * rate))) / rate
    columns = {"time": time, "x": np.cos(time), "y": np.sin(time), "heading": time + 1.0}
    for k in range(1, wheels + 1):
        columns[f"wheel_speed_{k}"] = 10.0 * np.sin(time + k) + 0.1 * rng.normal(size=len(time))
        columns[f"current_{k}"] = np.sin(time + k) + 0.01 * rng.normal(size=len(time))
    return columns


def written(folder: Path, *logs: dict[str, np.ndarray], defaults=DEFAULTS) -> Path:
    runs = [Run(f"run_{k}", log, MappingProxyType({}), MappingProxyType({})) for k, log in enumerate(logs)]
    write_dataset(folder, "uto_robot", defaults, runs)
    return folder


@pytest.mark.parametrize("wheels", [3, 4, 5, 12])
@pytest.mark.parametrize("rate", [20.0, 32.0, 1000.0])
def test_a_measured_pose_replaces_the_inertial_unit_at_any_rate_and_number_of_wheels(tmp_path, rate, wheels):
    dataset = read_dataset(written(tmp_path / "set", logged(rate, wheels)))
    assert dataset.pose_measured and dataset.wheels == wheels and not dataset.notes
    assert "acceleration_x" not in dataset.runs[0].columns and not dataset.runs[0].masked


def test_the_number_of_wheels_follows_from_the_columns_where_it_is_not_stated(tmp_path):
    folder = written(tmp_path / "set", logged(wheels=3))
    about = folder / "dataset.toml"
    about.write_text(about.read_text().replace("wheels = 3\n", ""))
    assert read_dataset(folder).wheels == 3
    text = '[columns]\n"w3" = { name = "wheel_speed_3" }\n'
    columns = {("w3" if name == "wheel_speed_3" else name): v for name, v in logged(wheels=3).items()}
    folder = written(tmp_path / "renamed", columns)
    about = folder / "dataset.toml"
    about.write_text(f"{about.read_text().replace('wheels = 2', '')}\n{text}")
    assert read_dataset(folder).wheels == 3


def test_a_pose_that_is_not_stated_as_measured_is_named_in_the_message(tmp_path):
    with pytest.raises(InputError, match="state pose_measured = true under") as caught:
        read_dataset(written(tmp_path / "set", logged(), defaults={"floor": "pvc"}))
    assert "has no columns acceleration_x, acceleration_y, yaw_rate, yaw" in str(caught.value)


def test_a_measured_pose_needs_all_of_its_columns(tmp_path):
    log = logged()
    del log["heading"]
    with pytest.raises(InputError, match="has no column heading"):
        read_dataset(written(tmp_path / "set", log))


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ("= true", '= "yes"', InputError, "pose_measured: found 'yes'; must be true or false"),
        ("pose_measured", "pose_mesured", UnknownNameError, "did you mean 'pose_measured'"),
        ('"uto_robot"\nwheels = 3', '"linear_axis"', InputError, "found true; linear_axis has no pose"),
        ("[runs.run_0]", "[runs.run_0]\npose_measured = true", InputError, "it holds for all runs"),
    ],
)
def test_a_wrong_statement_of_the_pose_is_refused_with_its_place(tmp_path, old, new, error, words):
    folder = written(tmp_path / "set", logged())
    about = folder / "dataset.toml"
    about.write_text(about.read_text().replace(old, new))
    with pytest.raises(error) as caught:
        read_dataset(folder)
    assert words in str(caught.value) and "dataset.toml" in str(caught.value)


def test_rows_that_repeat_the_row_before_are_masked_with_their_neighbours_and_reported(tmp_path):
    log = logged(50.0)
    for name in [name for name in log if name[:5] in ("wheel", "curre")]:
        log[name][60:67] = log[name][59]
    dataset = read_dataset(written(tmp_path / "set", log))
    run = dataset.runs[0]
    assert np.flatnonzero(run.masked["wheel_speed_1"]).tolist() == list(range(59, 68))
    assert set(run.masked) == {name for name in log if name[:5] in ("wheel", "curre")}
    assert (
        "run run_0: 7 rows repeat currents and wheel speeds of the row before in motion" in dataset.notes[0]
    )


def test_a_pose_that_stands_while_the_wheels_turn_is_masked(tmp_path):
    log = logged(50.0)
    for name in ("x", "y", "heading"):
        log[name][100:120] = log[name][99]
    masked = read_dataset(written(tmp_path / "set", log)).runs[0].masked
    assert set(masked) == {"x", "y", "heading"} and masked["x"][100:120].all()


def test_readings_slower_than_the_log_are_no_faults_until_they_stop():
    moving = np.ones(1000, dtype=bool)
    slow = np.repeat(np.arange(200.0), 5)
    assert not find_repeats([slow], moving).any()
    slow[500:540] = slow[500]
    assert 35 <= find_repeats([slow], moving).sum() <= 40


def test_rest_is_no_fault():
    assert not find_repeats([np.zeros(100)], np.zeros(100, dtype=bool)).any()


def test_a_current_without_its_sign_is_masked_where_its_wheel_turns_backwards(tmp_path):
    log = logged(50.0)
    log["current_2"] = np.abs(log["current_2"])
    dataset = read_dataset(written(tmp_path / "set", log))
    backwards = log["wheel_speed_2"] < 0.0
    assert np.array_equal(dataset.runs[0].masked["current_2"], backwards)
    assert [note.split(" though")[0] for note in dataset.notes] == ["current_2 is never negative"]


def test_a_current_of_a_wheel_that_turns_one_way_may_be_positive():
    speed = [np.linspace(1.0, 2.0, 99)]
    assert not is_magnitude([np.ones(99)], speed) and is_magnitude(
        [np.ones(99)], [np.linspace(-1.0, 1.0, 99)]
    )


def test_samples_that_arrive_in_bursts_are_reported(tmp_path):
    log = logged(50.0)
    log["time"] = np.sort((0.1 * np.arange(40.0)[:, None] + 0.001 * np.arange(5.0)).ravel()).astype(float)
    assert burst_share(log["time"]) == pytest.approx(0.8, abs=0.01)
    notes = read_dataset(written(tmp_path / "set", log)).notes
    assert any("80% of the samples arrive in bursts; their times are those of arrival" in n for n in notes)


@pytest.mark.parametrize("command", ["diagnose", "calibrate"])
def test_work_that_needs_the_inertial_unit_says_what_is_missing(tmp_path, capsys, command):
    folder = written(tmp_path / "set", logged(1000.0, 4))
    more = ["--false-alarms-per-hour", "1"] if command == "calibrate" else []
    assert main([command, str(folder), *more, "--out", str(tmp_path / "out")]) == 2
    line = capsys.readouterr().err
    assert (
        line.count("\n") == 1 and "run 'run_0' has no acceleration_x, acceleration_y, yaw_rate, yaw" in line
    )
    assert not (tmp_path / "out").exists()


def test_from_python_too(tmp_path):
    dataset = omnimj.read_dataset(written(tmp_path / "set", logged(1000.0, 4)))
    with pytest.raises(InputError, match="this command needs the inertial unit"):
        require_inertial_unit(dataset)
    with pytest.raises(InputError, match="has no acceleration_x"):
        omnimj.diagnose(dataset)


@pytest.mark.slow
def test_the_twin_is_recorded_with_a_measured_pose_at_a_stated_rate(tmp_path, monkeypatch, capsys):
    from omnimj.simulate.suites import recording

    planned = recording.planned_runs
    monkeypatch.setattr(recording, "planned_runs", lambda *a, **k: planned(*a, **k)[:1])
    argv = ["record", "robot_missions", "--plant", "planar", "--pose-rate", "40"]
    assert main([*argv, "--out", str(tmp_path / "set")]) == 0
    dataset = read_dataset(tmp_path / "set")
    (run,) = dataset.runs
    assert dataset.pose_measured and dataset.wheels == 4 and "yaw" not in run.columns
    assert np.diff(run.time) == pytest.approx(0.025)
    assert main(["record", "rig_currents", "--pose-rate", "40", "--out", str(tmp_path / "rig")]) == 2
    assert "--pose-rate: rig_currents records quarter_rig; only robots have a pose" in capsys.readouterr().err
