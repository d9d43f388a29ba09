"""Robots that the gap workflow's equations are not for are refused, by file, finding and rule."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from other_robots import mecanum, star

from omnimj.errors import InputError
from omnimj.gap.robot_layout import require_layout
from omnimj.parameters import read_robot
from omnimj.recording.dataset import Dataset, Run
from omnimj.recording.dataset_columns import columns_for, wheels_of

NOTHING = MappingProxyType({})


def logs(*wheels: int) -> Dataset:
    """Runs with the columns of robots with so many wheels."""
    runs = []
    for k, n in enumerate(wheels):
        names = columns_for("uto_robot", [f"current_{n}"]).required
        runs.append(Run(f"run_{k}", {name: np.zeros(3) for name in names}, NOTHING, NOTHING))
    return Dataset(Path("data"), "uto_robot", tuple(runs))


def test_the_shipped_robot_is_taken_with_its_own_logs():
    require_layout(logs(4, 4), read_robot())


@pytest.mark.parametrize(
    ("robot", "dataset", "found"),
    [
        (star(3), logs(3), r"robot.toml: \[\[wheels\]\]: found 3 wheels; gaps are found for 4 wheels"),
        (star(6), logs(6), "found 6 wheels"),
        (mecanum(), logs(4), r"robot.toml: wheels.0.roller_angle: found 2.35619 rad"),
        (read_robot(), logs(3), "data: has the columns of 3 wheels; gaps are found for 4"),
        (read_robot(), logs(4, 5), "run 'run_1': has the columns of 5 wheels; 'run_0' has 4"),
    ],
)
def test_others_are_refused_with_file_finding_and_rule(robot, dataset, found):
    with pytest.raises(InputError, match=found):
        require_layout(dataset, robot)


def test_a_log_has_as_many_wheels_as_its_highest_number():
    assert [wheels_of(logs(n)) for n in (3, 4, 5, 8)] == [3, 4, 5, 8]
    names = columns_for("uto_robot", ["time", "current_1", "current_5"]).required
    assert "wheel_speed_5" in names and "wheel_speed_6" not in names
    assert "current_4" in columns_for("uto_robot", ["time"]).required
