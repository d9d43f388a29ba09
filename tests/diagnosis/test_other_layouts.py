"""Logs of a robot with another number of wheels are diagnosed with its own model, and with no other."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from omnimj.diagnosis.machines import read_machine
from omnimj.errors import InputError
from omnimj.recording.dataset import Dataset, Run
from omnimj.recording.dataset_columns import columns_for

NOTHING = MappingProxyType({})
NAMES = columns_for("uto_robot", ["current_3"]).required
LOGS = Dataset(
    Path("data"), "uto_robot", (Run("one", {name: np.zeros(3) for name in NAMES}, NOTHING, NOTHING),)
)


def test_a_row_of_three_wheels_becomes_a_measurement_of_three_wheels():
    machine = read_machine(LOGS, Path("three_wheel"))
    seen = machine.measurement(0.5, np.arange(10.0))
    assert seen.current.tolist() == [0.0, 1.0, 2.0] and seen.wheel_speed.tolist() == [3.0, 4.0, 5.0]
    assert len(machine.channels) == 10 and machine.targets == tuple(f"current_target_{i}" for i in (1, 2, 3))


def test_a_model_with_another_number_of_wheels_is_refused():
    with pytest.raises(InputError, match=r"robot.toml: has 4 \[\[wheels\]\]; the logs of data have 3"):
        read_machine(LOGS)
