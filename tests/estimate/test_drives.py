"""Laws of `omnimj validate` for a robot: a twin that is measured validates itself, and so do its plants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.drives.compare import marker_angle, speed_groups
from omnimj.estimate.drives.validate import drives_content, validate_drives
from omnimj.parameters import read_robot
from omnimj.parameters.floor import all_floors
from omnimj.physics.kinematics import rolling_matrix
from omnimj.recording.dataset import Dataset, Run
from omnimj.resources import models_folder
from omnimj.simulate.driving import follow_wheel_speeds
from omnimj.simulate.plants import make_simulated

_FLOOR = "gray"
_SCALE = 0.903  # of the camera, as the model has it
_SPEEDS = {"slow": 0.1, "fast": 0.3}  # [m/s]
_MARKER = 0.02  # [rad]


@pytest.fixture(scope="module")
def robot():
    return read_robot(models_folder() / "robotino" / "identified.toml")


@pytest.fixture(scope="module")
def floors():
    return all_floors(models_folder() / "robotino" / "soft_floors.toml")


def _run(robot, floors, name, degrees, speed, marker=0.0):
    """A drive of 4 s in one direction, of which a camera with a turned marker takes 32 samples a second."""
    angle = np.deg2rad(degrees)
    rims = rolling_matrix(robot.wheel_positions, robot.rolling_directions)
    target = rims @ (speed * np.array([np.cos(angle), np.sin(angle), 0.0])) / robot.wheel.radius
    ramp = np.clip(np.arange(4000) / 300.0, 0.0, 1.0)[:, None]
    twin = make_simulated("twin", robot, _FLOOR, floors, ideal_sensors=True)
    trace = follow_wheel_speeds(twin, robot, ramp * target)
    ends = np.arange(31, 4000, 31)
    columns = {"time": trace["time"][ends]}
    columns |= {name: _SCALE * trace[name][ends] for name in ("x", "y")}
    columns["heading"] = trace["heading"][ends] + marker
    for channel in ("wheel_speed", "current"):
        for i in range(1, robot.wheel_count + 1):
            values = np.asarray(trace[f"{channel}_{i}"])
            columns[f"{channel}_{i}"] = np.array([values[end - 30 : end + 1].mean() for end in ends])
    return Run(name, columns, {}, {"floor": _FLOOR})


@pytest.fixture(scope="module")
def dataset(robot, floors, tmp_path_factory):
    runs = [
        _run(robot, floors, f"{word}_{degrees}", degrees, speed, _MARKER)
        for word, speed in _SPEEDS.items()
        for degrees in (20, 110, 200, 290)
    ]
    path = tmp_path_factory.mktemp("drives")
    return Dataset(path, "uto_robot", tuple(runs), (), robot.wheel_count, True)


@pytest.fixture(scope="module")
def found(dataset, robot, floors):
    return validate_drives(dataset, robot, floors)


def _groups(found, plant):
    return [group for group in found.groups if group.plant == plant]


@pytest.mark.slow
def test_a_run_of_the_twin_itself_validates_with_errors_near_zero(found):
    for group in _groups(found, "twin"):
        assert group.velocity_error < 0.01
        assert group.current_error.max() < 0.03 * group.measured_current.max()
        assert group.yaw_rate_error < 2e-3
        assert group.end_by_measured_heading < 0.02 and group.end_by_own_heading < 0.02


@pytest.mark.slow
def test_twin_and_equations_agree_where_both_share_a_floor(found):
    for twin, planar in zip(_groups(found, "twin"), _groups(found, "planar"), strict=True):
        assert planar.simulated_speed == pytest.approx(twin.simulated_speed, rel=0.03)
        assert planar.velocity_error < 0.05


@pytest.mark.slow
def test_rolling_without_slip_misses_what_a_soft_floor_takes(found):
    for twin, rolling in zip(_groups(found, "twin"), _groups(found, "rolling"), strict=True):
        assert rolling.simulated_speed == pytest.approx(_SCALE * rolling.wheel_rolling, rel=0.02)
        assert rolling.velocity_error > 5.0 * twin.velocity_error
        assert np.isnan(rolling.current_error).all()


@pytest.mark.slow
def test_the_angle_of_a_turned_marker_is_found_and_taken_out(found):
    assert found.marker["twin"][_FLOOR] == pytest.approx(_MARKER, abs=2e-3)
    assert f"{_FLOOR}: marker turned" in found.marker_notes[0]


@pytest.mark.slow
def test_too_few_runs_tell_no_angle_since_it_would_hide_their_error(found):
    assert marker_angle([run for run in found.runs if run.plant == "twin"][:3]) is None


@pytest.mark.slow
def test_runs_are_grouped_by_speed_and_each_belongs_to_one_group(found, dataset):
    slow, fast = _groups(found, "twin")
    assert {name.split("_")[0] for name in slow.runs} == {"slow"}
    assert {*slow.runs, *fast.runs} == {run.name for run in dataset.runs}
    assert speed_groups(reversed(found.numbers))[0].wheel_rolling == pytest.approx(slow.wheel_rolling)


@pytest.mark.slow
def test_a_gap_in_the_wheel_speeds_is_bridged(dataset, robot, floors, found):
    run = dataset.runs[0]
    mask = np.zeros(len(run.time), bool)
    mask[60:75] = True
    columns = {
        name: np.where(mask, 99.0, values) if "wheel" in name else values
        for name, values in run.columns.items()
    }
    holed = replace(run, columns=columns, masked={name: mask for name in columns if "wheel" in name})
    (again,) = validate_drives(replace(dataset, runs=(holed,)), robot, floors, ("planar",)).numbers[:1]
    (before,) = (one for one in found.numbers if one.run == run.name and one.plant == "planar")
    assert np.allclose(np.hypot(*again.simulated[:2]), np.hypot(*before.simulated[:2]), rtol=5e-3)


@pytest.mark.slow
def test_numbers_that_no_plant_gives_are_null_in_the_file(found):
    content = drives_content(found)
    rolling = next(group for group in content["table"] if group["plant"] == "rolling")
    assert rolling["current_error"] == [None] * 3
    assert len(content["runs"]) == 3 * 8


@pytest.mark.slow
def test_wrong_input_gives_one_clear_error(dataset, robot, floors):
    with pytest.raises(InputError, match=r"pose_measured: found false.*'pose_measured = true'"):
        validate_drives(replace(dataset, pose_measured=False), robot, floors)
    with pytest.raises(InputError, match=r"has 4 \[\[wheels\]\].*have 3"):
        validate_drives(dataset, read_robot(), floors)
    with pytest.raises(UnknownNameError, match=r"unknown plant 'moon'.*planar, twin"):
        validate_drives(dataset, robot, floors, ("moon",))
    lost = replace(dataset.runs[0], conditions={"floor": "lava"})
    with pytest.raises(UnknownNameError, match="unknown floor 'lava'"):
        validate_drives(replace(dataset, runs=(*dataset.runs[1:], lost)), robot, floors)
    backwards = [
        replace(run, columns={name: -v if name == "wheel_speed_2" else v for name, v in run.columns.items()})
        for run in dataset.runs
    ]
    with pytest.raises(InputError, match="wheel_speed_2: turns against the pose"):
        validate_drives(replace(dataset, runs=tuple(backwards)), robot, floors)
