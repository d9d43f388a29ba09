"""Logs of robots with other than four wheels."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from omnimj.diagnosis.logs import read_machine
from omnimj.errors import InputError
from omnimj.recording.dataset import Run
from omnimj.recording.read_dataset import read_dataset
from omnimj.recording.write_dataset import write_dataset

NAMES = ("acceleration_x", "acceleration_y", "yaw_rate", "yaw")


def written(folder, wheels):
    rng = np.random.default_rng(wheels)
    names = [f"{name}_{i}" for name in ("current", "wheel_speed") for i in range(1, wheels + 1)]
    columns: dict[str, Any] = {"time": 0.001 * np.arange(200)}
    columns |= {name: rng.normal(0.0, 0.1, 200) for name in (*names, *NAMES)}
    run = Run("one", MappingProxyType(columns), MappingProxyType({}), MappingProxyType({"floor": "pvc"}))
    write_dataset(folder, "uto_robot", {}, [run])
    return columns


@pytest.mark.parametrize("wheels", [3, 4, 6])
def test_logs_of_any_number_of_wheels_come_back_as_they_were_written(tmp_path, wheels):
    columns, dataset = written(tmp_path / "data", wheels), read_dataset(tmp_path / "data")
    assert dataset.wheels == wheels
    assert ("wheels" in (tmp_path / "data" / "dataset.toml").read_text()) == (wheels != 4)
    for name, values in columns.items():
        assert np.array_equal(dataset.runs[0].columns[name], values)


def test_a_machine_with_other_wheels_than_the_logs_is_refused_and_the_right_one_reads_rows(tmp_path):
    written(tmp_path / "data", 3)
    dataset = read_dataset(tmp_path / "data")
    with pytest.raises(
        InputError, match=r"has 4 \[\[wheels\]\]; the logs of .*data have 3 wheels; pass --model"
    ):
        read_machine(dataset)
    machine = read_machine(dataset, Path("three_wheel"))
    measured = machine.measurement(0.5, np.arange(10.0))
    assert measured.current.tolist() == [0, 1, 2] and measured.wheel_speed.tolist() == [3, 4, 5]
    assert measured.acceleration.tolist() == [6, 7] and (measured.yaw_rate, measured.yaw) == (8, 9)


@pytest.mark.parametrize("value", ["2", "13", "3.5", "true", '"three"'])
def test_a_number_of_wheels_that_no_robot_has_is_refused_in_one_line(tmp_path, value):
    written(tmp_path / "data", 3)
    path = tmp_path / "data" / "dataset.toml"
    path.write_text(path.read_text().replace("wheels = 3", f"wheels = {value}"))
    with pytest.raises(InputError, match=r"dataset\.toml: wheels"):
        read_dataset(tmp_path / "data")


def test_a_plant_without_wheels_to_count_has_none(tmp_path):
    written(tmp_path / "data", 3)
    path = tmp_path / "data" / "dataset.toml"
    path.write_text(path.read_text().replace('"uto_robot"', '"quarter_rig"'))
    with pytest.raises(InputError, match="quarter_rig has none to count"):
        read_dataset(tmp_path / "data")
