"""Values ten times beyond what the machine can do hold a dataset back, however few they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rig_runs import dataset, twin_run

from omnimj.errors import DataFaultError
from omnimj.estimate.gap.check.acceptance import sound_dataset
from omnimj.parameters import read_floors, read_rig


@pytest.fixture(scope="module")
def healthy():
    rig, stone = read_rig(), read_floors()["natural_stone"]
    return dataset(*(twin_run(rig, stone, current, seed) for seed, current in enumerate((0.6, 1.2))))


def with_values(data, channel: str, value: float, rows: slice):
    run = data.runs[0]
    values = np.array(run.columns[channel], float)
    values[rows] = value
    return replace(data, runs=(replace(run, columns={**run.columns, channel: values}), *data.runs[1:]))


@pytest.mark.parametrize(
    ("channel", "value"), [("current", 1e6), ("carriage_speed", 40.0), ("carriage_acceleration", -1e5)]
)
def test_two_samples_far_beyond_the_machine_hold_the_data_back_unless_they_are_accepted(
    healthy, channel, value
):
    wrong = with_values(healthy, channel, value, slice(100, 102))
    with pytest.raises(DataFaultError, match=f"magnitude: {channel} reaches"):
        sound_dataset(wrong, read_rig())
    accepted, check = sound_dataset(wrong, read_rig(), accept=True)
    assert any(s.kind == "magnitude" and s.channel == channel for s in check.suspicions)
    assert any(f"{channel} reaches" in note for note in accepted.notes)


def test_two_samples_that_a_push_may_cause_do_not(healthy):
    sound_dataset(with_values(healthy, "carriage_speed", 2.0, slice(100, 102)), read_rig())
    sound_dataset(healthy, read_rig())
