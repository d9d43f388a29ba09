"""`dataset.toml`: conditions of runs, renamed columns, and the place in every message."""

from __future__ import annotations

from pathlib import Path

import pytest

from omnimj.errors import InputError, UnknownNameError
from omnimj.recording.dataset import PLANT_COLUMNS
from omnimj.recording.dataset_file import DATASET_FILE, ColumnMapping, read_dataset_file

TEXT = """
plant = "quarter_rig"
[defaults]
floor = "pvc"
mass = 3.0
[columns]
rpm = { name = "wheel_speed", scale = 0.1047, offset = 0.5 }
[runs.heavy]
mass = 5.0
repeat_of = "load"
"""


def read(folder: Path, text: str):
    (folder / DATASET_FILE).write_text(text, encoding="utf-8")
    return read_dataset_file(folder, ("pvc", "natural_stone"))


def test_a_run_has_the_defaults_and_its_own_conditions_above_them(tmp_path):
    about = read(tmp_path, TEXT)
    assert about.conditions("light") == {"floor": "pvc", "mass": 3.0}
    assert about.conditions("heavy") == {"floor": "pvc", "mass": 5.0, "repeat_of": "load"}
    assert about.renamed == {"rpm": ColumnMapping("wheel_speed", 0.1047, 0.5)}
    assert about.columns == PLANT_COLUMNS["quarter_rig"] and about.wheels == 4


def test_a_condition_that_nothing_states_is_missing_by_name_and_run(tmp_path):
    about = read(tmp_path, TEXT.replace("mass = 3.0\n", ""))
    assert about.conditions("heavy")["mass"] == 5.0
    with pytest.raises(InputError, match=r"run 'light': 'mass' is missing; .*\[runs\.light\]"):
        about.conditions("light")


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ('"pvc"', '"ice"', UnknownNameError, "natural_stone"),
        ('"wheel_speed"', '"speed"', UnknownNameError, "carriage_speed"),
        ("scale = 0.1047", "scale = 0.0", InputError, "columns.'rpm'.scale"),
        ("scale = 0.1047", "scale = inf", InputError, "columns.'rpm'.scale"),
        ("mass = 5.0", "mass = -5.0", InputError, r"\[runs\.heavy\]: mass"),
        ("mass = 5.0", "weight = 5.0", UnknownNameError, "mass"),
        ('"quarter_rig"', '"tractor"', UnknownNameError, "uto_robot"),
        ('plant = "quarter_rig"', 'plant = "quarter_rig"\nwheels = 3', InputError, "wheels"),
    ],
)
def test_a_value_that_breaks_its_rule_is_refused_with_its_place(tmp_path, old, new, error, words):
    with pytest.raises(error, match=words) as caught:
        read(tmp_path, TEXT.replace(old, new))
    assert DATASET_FILE in str(caught.value) and "\n" not in str(caught.value)


def test_a_robot_states_its_number_of_wheels(tmp_path):
    about = read(tmp_path, 'plant = "uto_robot"\nwheels = 3\n[defaults]\nfloor = "pvc"\n')
    assert about.wheels == 3 and "current_3" in about.columns.required
    assert "current_4" not in about.columns.known
