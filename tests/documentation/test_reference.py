"""The reference says what the code does: effects, keys of scenarios, columns, units, schemas."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from omnimj.documentation.reference import (
    SCHEMA_FOLDER,
    effects_page,
    scenario_keys_page,
    schemas_page,
    table,
)
from omnimj.documentation.staging import DOCS
from omnimj.effects.catalogue import PLANTS, effects_of
from omnimj.plant.faults import FAULT_KINDS
from omnimj.recording.dataset import PLANT_COLUMNS
from omnimj.recording.dataset_file import CONDITION_KEYS, PLANNED_RUNS, POSE_MEASURED, read_dataset_file
from omnimj.recording.importing.units import known_units, target_unit
from omnimj.simulate.scenario.checks import BOUNDS, METHODS
from omnimj.simulate.scenario.overrides import known_keys

DATASETS = (DOCS / "datasets.md").read_text(encoding="utf-8")
TESTS = Path(__file__).parent.parent


def rows(text: str) -> list[list[str]]:
    """Cells of all lines of tables."""
    return [
        [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        for line in text.splitlines()
        if line.startswith("|")
    ]


def section(text: str, title: str) -> str:
    return text.split(f"`{title}`\n", 1)[1].split("\n## ", 1)[0]


@pytest.mark.parametrize("plant", PLANTS)
def test_the_page_of_effects_has_each_parameter_with_its_unit_and_bounds(plant):
    page = effects_page()
    for name, effect in effects_of(plant).items():
        text = page.split(f"### `{name}`\n", 1)[1].split("\n##", 1)[0]
        for parameter in effect.parameters:
            numbers = [f"{value:.4g}" for value in (parameter.low, parameter.high, parameter.typical)]
            found = [
                row for row in rows(text) if row[:5] == [f"`{parameter.name}`", parameter.unit, *numbers]
            ]
            assert len(found) == 1, (name, parameter)


def test_the_page_of_scenario_keys_has_every_key_that_can_be_set():
    page = scenario_keys_page()
    elsewhere = {*BOUNDS, *METHODS}  # in the sentence on checks
    for plant in ("uto_robot", "quarter_rig"):
        keys = {key for names in known_keys(plant, 4).values() for key in names}
        assert [key for key in sorted(keys - elsewhere) if f"`{key}`" not in page] == []
    assert [kind for kind in FAULT_KINDS if f"### `{kind}`" not in page] == []


@pytest.mark.parametrize("plant", PLANT_COLUMNS)
def test_the_page_of_datasets_has_the_columns_of_each_plant_with_their_units(plant):
    columns, text = PLANT_COLUMNS[plant], section(DATASETS, plant)
    listed = {row[0].strip("`"): row[1] for row in rows(text) if row[0].startswith("`")}
    expected = {re.sub(r"_\d+$", "_N", name) for name in columns.known}
    parts = {re.sub(r":.*", ":", name) for name in listed if ":" in name}
    assert {name for name in listed if ":" not in name} == expected
    assert parts == set(columns.prefixes)
    if plant != "mjcf":
        numbered = {name: target_unit(name.replace("_N", "_1")) for name in listed}
        assert {name: unit.replace("²", "2") for name, unit in listed.items()} == numbered
    for key in columns.conditions:
        assert re.search(rf"Needed for every run:.*`{key}`", text)


def test_the_page_of_datasets_has_every_key_and_every_unit():
    keys = (*CONDITION_KEYS, POSE_MEASURED, PLANNED_RUNS, "plant", "model", "wheels")
    assert [key for key in keys if f"| `{key}` |" not in DATASETS] == []
    assert [unit for unit in known_units() if f"`{unit}`" not in DATASETS] == []


def test_the_example_of_a_dataset_file_is_one(tmp_path):
    (example,) = re.findall(r"```toml\n(.*?)```", DATASETS, flags=re.DOTALL)
    (tmp_path / "dataset.toml").write_text(example, encoding="utf-8")
    found = read_dataset_file(tmp_path)
    assert found.renamed["i_fl [mA]"].scale == 0.001
    assert found.conditions("square_b")["floor"] == "natural_stone"


@pytest.mark.parametrize("name", [path.stem for path in sorted(SCHEMA_FOLDER.glob("*.json"))])
def test_a_shipped_schema_is_the_one_that_tests_hold_against_outputs(name):
    assert (SCHEMA_FOLDER / f"{name}.json").read_bytes() == (TESTS / "schema" / f"{name}.json").read_bytes()


def test_every_schema_is_shipped_and_all_its_first_keys_are_on_the_page():
    page = schemas_page()
    for file in (TESTS / "schema").glob("*.json"):
        assert (SCHEMA_FOLDER / file.name).exists()
        text = page.split(f"## `{file.name}`", 1)[1].split("\n## ", 1)[0]
        assert [key for key in json.loads(file.read_text())["properties"] if f"`{key}`" not in text] == []


def test_a_bar_in_a_cell_does_not_end_it():
    assert rows(table(("a", "b"), [("x | y", "z")]))[2] == ["x \\| y", "z"]
