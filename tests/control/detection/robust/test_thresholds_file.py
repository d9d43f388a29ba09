"""Thresholds of the robust method from a file: what is in it counts, all else is as shipped."""

from __future__ import annotations

import pytest

from omnimj.control.detection.robust.thresholds import THRESHOLD_UNITS, Thresholds, read_thresholds
from omnimj.errors import InputError


def text(**values) -> str:
    numbers = {"motor": 25.0, "drag": 31.0, "accelerometer": 41.0, "slip": 0.002, "worn": 0.08} | values
    lines = [
        f'{name} = {{ value = {value}, unit = "{THRESHOLD_UNITS.get(name, "1")}", source = "measured" }}'
        for name, value in numbers.items()
        if value is not None
    ]
    return "\n".join(["[thresholds]", *lines, "[calibration]", "hours = 2.0", ""])


def test_five_thresholds_are_read_and_the_others_are_as_shipped(tmp_path):
    (tmp_path / "t.toml").write_text(text())
    assert read_thresholds(tmp_path / "t.toml") == Thresholds(
        motor=25.0, drag=31.0, accelerometer=41.0, slip=0.002, worn=0.08
    )


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (text(motor=-1.0), "t.toml: thresholds.motor: found -1.0; must be above 0"),
        (text(motor="inf"), "thresholds.motor: found inf"),
        (text(slip='"much"'), "thresholds.slip: found 'much'; a number is needed"),
        (text(drag=None), r"t.toml: \[thresholds\]: 'drag' is missing"),
        (text(settling=1.0), "unknown key 'settling'; choices: accelerometer, drag, motor, slip, worn"),
        ("", r"t.toml: \[thresholds\] is missing"),
        ("thresholds = 3", r"\[thresholds\] is not a table"),
        ("[threshold]", "unknown key 'threshold'; did you mean 'thresholds'"),
        ("[thresholds", "is not valid TOML"),
        (text().replace("nats", "N", 1), "thresholds.motor.unit: found 'N'; the unit is 'nats'"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, content, expected):
    (tmp_path / "t.toml").write_text(content)
    with pytest.raises(InputError, match=expected) as caught:
        read_thresholds(tmp_path / "t.toml")
    assert "\n" not in str(caught.value)
