"""A generated robot as a model file: omnimj's twin with the native contact drives it."""

import numpy as np
import pytest

from omnimj.errors import InputError
from omnimj.parameters import read_floors, read_robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.plant.mujoco.assembly import robot_model
from omnimj.simulate.run import run_scenario
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.wheels import mecanum_wheel, model_text, omni_wheel, robot_file, wheeled_robot

LAYOUTS = ["omni3", "omni4", "mecanum4"]


def written(layout, path, **numbers):
    path.write_text(model_text(wheeled_robot(layout, **numbers)), encoding="utf-8")
    return path


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_model_file_holds_the_geometry_and_masses_of_the_robot(layout, tmp_path):
    robot, made = read_robot(written(layout, tmp_path / "robot.toml", mass=18.0)), wheeled_robot(layout)
    assert robot.body.mass == 18.0 and robot.wheel.radius == 0.05
    rolling = rolling_matrix(robot.wheel_positions, robot.rolling_directions)
    assert rolling / robot.wheel.radius == pytest.approx(made.kinematics, abs=1e-9)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_twin_of_a_model_file_has_the_robot_s_mass(layout, tmp_path):
    m = robot_model(read_robot(written(layout, tmp_path / "robot.toml")), read_floors()["natural_stone"])
    assert m.body_mass.sum() == pytest.approx(15.0)
    assert m.nu == int(layout[-1])


@pytest.mark.parametrize("wheel", [omni_wheel(rollers=8), omni_wheel(rollers=6, rows=3)])
def test_wheels_that_the_twin_has_not_are_refused(wheel):
    with pytest.raises(InputError, match=r"rows; the twin's wheel has 18, in two rows of nine"):
        model_text(wheeled_robot("omni4", wheel))


@pytest.mark.parametrize("rollers", [16, 18, 20])
def test_the_twin_takes_a_mecanum_wheel_with_any_number_of_rollers(rollers, tmp_path):
    path, wheel = tmp_path / "robot.toml", mecanum_wheel(rollers=rollers, roller_radius=0.0045)
    made = wheeled_robot("mecanum4", wheel)
    path.write_text(model_text(made), encoding="utf-8")
    robot = read_robot(path)
    rolling = rolling_matrix(robot.wheel_positions, robot.rolling_directions)
    assert rolling / robot.wheel.radius == pytest.approx(made.kinematics, abs=1e-9)
    assert robot.wheel.roller_radius == 0.0045


@pytest.mark.parametrize("layout", ["omni4", "mecanum4"])
def test_the_mjcf_file_drives_as_the_model_file_does_bit_for_bit(layout, tmp_path):
    model, mjcf = written(layout, tmp_path / "robot.toml"), tmp_path / "robot.xml"
    mjcf.write_text(robot_file(wheeled_robot(layout)), encoding="utf-8")
    changes = ("duration=2", "checks={}")
    traces = [
        run_scenario(read_scenario("circle_8m", changes, path), "twin", "off").trace for path in (model, mjcf)
    ]
    assert list(traces[0].columns) == list(traces[1].columns) and len(traces[0]["time"]) > 1000
    for name in traces[0].columns:
        assert traces[0][name].tobytes() == traces[1][name].tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_twin_drives_a_circle_with_the_model_file(layout, tmp_path):
    model = written(layout, tmp_path / "robot.toml")
    result = run_scenario(read_scenario("three_wheel_circle", model_file=model), "twin", "robust")
    assert result.metrics["passed"]
    assert np.isfinite(result.trace["x"]).all()
