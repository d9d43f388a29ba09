"""Robots that the gap workflow's equations are not for are refused, by file, finding and rule."""

from __future__ import annotations

from pathlib import Path

import pytest
from other_robots import mecanum, star

from omnimj.errors import InputError
from omnimj.estimate.replay.robot.runs import require_layout
from omnimj.parameters import read_robot
from omnimj.recording.dataset import Dataset


def logs(wheels: int) -> Dataset:
    """Of a robot with so many wheels."""
    return Dataset(Path("data"), "uto_robot", (), (), wheels)


def test_the_shipped_robot_is_taken_with_its_own_logs():
    require_layout(logs(4), read_robot())


@pytest.mark.parametrize(
    ("robot", "dataset", "found"),
    [
        (star(3), logs(3), r"robot.toml: \[\[wheels\]\]: found 3 wheels; gaps are found for 4 wheels"),
        (star(6), logs(6), "found 6 wheels"),
        (mecanum(), logs(4), r"robot.toml: wheels.1.roller_angle: found 2.35619 rad"),
        (read_robot(), logs(3), "data: has the columns of 3 wheels; gaps are found for 4"),
    ],
)
def test_others_are_refused_with_file_finding_and_rule(robot, dataset, found):
    with pytest.raises(InputError, match=found):
        require_layout(dataset, robot)
