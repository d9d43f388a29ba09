"""A robot with more than four wheels is driven, identified, and has effects of its own at each wheel."""

from __future__ import annotations

import math

import pytest

from omnimj.effects import with_effects
from omnimj.effects.machine import parse_effect
from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.robot.identify import identify_robot
from omnimj.estimate.robot.model_text import model_text
from omnimj.parameters import read_robot
from omnimj.resources import models_folder
from omnimj.workflows import record


def wheel(k, wheels, radius=0.25):
    angle = 2.0 * math.pi * k / wheels
    x, y = math.cos(angle), math.sin(angle)
    return (
        "[[wheels]]\n"
        f'position = {{ value = [{radius * x}, {radius * y}], unit = "m", source = "chosen" }}\n'
        f'drives_along = {{ value = [{y}, {-x}], unit = "1", source = "chosen" }}\n'
    )


@pytest.fixture(scope="module")
def six(tmp_path_factory):
    """Model file of a robot with six wheels, heavier than the shipped one with three."""
    text = (models_folder() / "three_wheel" / "robot.toml").read_text(encoding="utf-8")
    head, _, rest = text.partition("# Wheels 1-3")
    tail = rest[rest.index("# Gains") :]
    head = head.replace("mass = { value = 12.0", "mass = { value = 24.0", 1).replace(
        "value = 0.42", "value = 0.84"
    )
    head = head.replace('"parts.toml"', f'"{(models_folder() / "parts.toml").as_posix()}"')
    file = tmp_path_factory.mktemp("six") / "robot.toml"
    file.write_text(head + "\n".join(wheel(k, 6) for k in range(6)) + "\n" + tail, encoding="utf-8")
    return file


def test_effects_of_a_wheel_need_a_wheel_that_the_robot_has(six):
    robot = with_effects(read_robot(six), {"torque_constant": {"wheel": 6, "scale": 0.9}})
    assert robot.effects["torque_constant"]["wheel"] == 6
    with pytest.raises(UnknownNameError, match=r"wheel '?7'?.*1, 2, 3, 4, 5, 6"):
        with_effects(robot, {"wheel_radius": {"wheel": 7, "scale": 1.01}})
    with pytest.raises(UnknownNameError, match=r"wheel '?5'?.*1, 2, 3, 4$"):
        with_effects(read_robot(), {"wheel_radius": {"wheel": 5, "scale": 1.01}})
    with pytest.raises(UnknownNameError, match="current_5"):
        with_effects(read_robot(), {"sensor_delay": {"channel": "current_5", "delay": 0.01}})
    assert parse_effect("bearing_friction:wheel=5,torque=0.02", "uto_robot")[1]["wheel"] == 5
    with pytest.raises((UnknownNameError, InputError)):
        parse_effect("bearing_friction:wheel=13,torque=0.02", "uto_robot")


@pytest.mark.slow
def test_six_wheels_are_identified_one_by_one(six, tmp_path):
    effects = {
        "torque_constant": {"wheel": 5, "scale": 0.92},
        "bearing_friction": {"wheel": 6, "torque": 0.04},
    }
    dataset = record("robot_missions", tmp_path / "logs", plant="planar", model=six, effects=effects)
    found = identify_robot(dataset, read_robot(six))
    mean = (5.0 + 0.92) / 6.0
    for i in range(1, 7):
        expected = (0.92 if i == 5 else 1.0) / mean
        assert found[f"torque_ratio_{i}"].value == pytest.approx(expected, rel=0.02)
    size = found["torque_constant"].value / (mean * found.robot.motor.torque_constant)
    more = found["dry_loss_6"].value - found["dry_loss_1"].value
    assert more / size == pytest.approx(0.04, abs=0.01)
    (tmp_path / "model.toml").write_text(model_text(found), encoding="utf-8")
    assert read_robot(tmp_path / "model.toml").wheel_count == 6
