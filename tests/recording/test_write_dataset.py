"""Datasets come back bit for bit, and writing takes away nothing that omnimj did not write."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType

import made_datasets as made
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from omnimj.errors import InputError
from omnimj.recording.dataset import Run
from omnimj.recording.read_dataset import LARGEST, read_dataset
from omnimj.recording.write_dataset import FORMATS, DatasetWriter, write_dataset
from omnimj.signals import Array

DEFAULTS = {"floor": "natural_stone", "mass": 3.9593}


def made_run(name: str = "a", repeat_of: str | None = None, **conditions: float | str) -> Run:
    merged = {**DEFAULTS, **conditions}
    return Run(name, made.rig_columns(), MappingProxyType({}), MappingProxyType(merged), repeat_of)


def names_in(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


finite = st.floats(allow_nan=False, allow_infinity=False)
measured = st.floats(-LARGEST, LARGEST)


@pytest.mark.slow
@pytest.mark.parametrize("table_format", FORMATS)
@given(cells=st.lists(measured, min_size=50, max_size=60), extra=st.lists(finite, min_size=60, max_size=60))
def test_every_number_comes_back_bit_for_bit(tmp_path_factory, table_format, cells, extra):
    count = len(cells)
    columns = {name: values[:count] for name, values in made.rig_columns().items()}
    columns["current"], columns["of my own"] = np.array(cells, float), np.array(extra[:count], float)
    run = Run("a", columns, MappingProxyType({}), MappingProxyType({}))
    folder = tmp_path_factory.mktemp("written")
    write_dataset(folder, "quarter_rig", DEFAULTS, [run], table_format=table_format)
    back = read_dataset(folder).runs[0]
    assert list(back.columns) == list(columns)
    for name, values in columns.items():
        assert back.columns[name].tobytes() == values.tobytes()


plain_text = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=20)


@pytest.mark.slow
@given(plain_text, plain_text, st.floats(0.001, 1e300))
def test_every_condition_comes_back(tmp_path_factory, description, repeat_of, mass):
    assume(description.strip() and repeat_of.strip())
    folder = tmp_path_factory.mktemp("conditions")
    runs = [made_run("a", description=description, mass=mass), made_run("b", repeat_of)]
    write_dataset(folder, "quarter_rig", DEFAULTS, runs)
    a, b = read_dataset(folder).runs
    assert dict(a.conditions) == {**DEFAULTS, "description": description, "mass": mass}
    assert b.repeat_of == repeat_of and a.repeat_of is None and dict(b.conditions) == DEFAULTS


@given(name=st.text(min_size=1, max_size=12))
def test_any_name_is_written_or_refused(tmp_path_factory, name):
    folder = tmp_path_factory.mktemp("name")
    try:
        write_dataset(folder, "quarter_rig", DEFAULTS, [made_run(name)])
    except InputError:
        assert not names_in(folder)
        return
    assert [run.name for run in read_dataset(folder).runs] == [name]


@pytest.mark.parametrize("name", ["", ".", "..", ".a", "a/b", "../a", "a\\b", "a\0", "a\n", "a ", "\ud800"])
def test_a_name_that_is_no_file_name_is_refused(tmp_path, name):
    with pytest.raises(InputError, match="is not a valid file name"):
        write_dataset(tmp_path / "new", "quarter_rig", DEFAULTS, [made_run(name)])


def test_after_each_run_the_folder_is_a_whole_dataset(tmp_path):
    writer = DatasetWriter(tmp_path / "new", "quarter_rig", DEFAULTS)
    assert not (tmp_path / "new").exists()
    for count, name in enumerate("abc", start=1):
        writer.add(made_run(name))
        assert [run.name for run in read_dataset(tmp_path / "new").runs] == list("abc")[:count]
        assert names_in(tmp_path / "new") == [*(f"{n}.parquet" for n in "abc"[:count]), "dataset.toml"]
    with pytest.raises(InputError, match="twice"):
        writer.add(made_run("a"))


def test_nothing_is_written_over_without_force(tmp_path):
    (tmp_path / "mine.txt").write_text("precious")
    with pytest.raises(InputError, match="is not empty"):
        write_dataset(tmp_path, "quarter_rig", DEFAULTS, [made_run()])
    write_dataset(tmp_path, "quarter_rig", DEFAULTS, [made_run()], force=True)
    assert names_in(tmp_path) == ["a.parquet", "dataset.toml", "mine.txt"]


def test_force_replaces_an_earlier_recorded_dataset_with_all_its_runs(tmp_path):
    write_dataset(tmp_path, "quarter_rig", DEFAULTS, [made_run("a"), made_run("b")])
    write_dataset(tmp_path, "quarter_rig", DEFAULTS, [made_run("c")], force=True, table_format="csv")
    assert names_in(tmp_path) == ["c.csv", "dataset.toml"]


def test_force_keeps_the_earlier_dataset_until_the_first_run_is_there(tmp_path):
    write_dataset(tmp_path, "quarter_rig", DEFAULTS, [made_run("a")])
    DatasetWriter(tmp_path, "quarter_rig", DEFAULTS, force=True)
    assert names_in(tmp_path) == ["a.parquet", "dataset.toml"]


def test_measured_data_are_never_deleted(tmp_path):
    measured = made.write_rig(tmp_path / "measured")
    with pytest.raises(InputError, match=r"has a dataset\.toml of another origin"):
        write_dataset(measured, "quarter_rig", DEFAULTS, [made_run()], force=True)
    write_dataset(tmp_path / "ours", "quarter_rig", DEFAULTS, [made_run()])
    (tmp_path / "ours" / "theirs.csv").write_text("time\n")
    with pytest.raises(InputError, match=r"has a file theirs\.csv; it would become a run"):
        write_dataset(tmp_path / "ours", "quarter_rig", DEFAULTS, [made_run()], force=True)
    (tmp_path / "loose").mkdir()
    (tmp_path / "loose" / "theirs.CSV").write_text("time\n")
    with pytest.raises(InputError, match=r"has a file theirs\.CSV"):
        write_dataset(tmp_path / "loose", "quarter_rig", DEFAULTS, [made_run()], force=True)
    assert names_in(measured) == ["dataset.toml", "stone_090.csv"]


def test_a_format_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(InputError, match="unknown format 'xlsx'; choices: csv, parquet"):
        write_dataset(tmp_path, "quarter_rig", DEFAULTS, [made_run()], table_format="xlsx")


def test_the_same_runs_give_the_same_bytes(tmp_path):
    contents: list[list[bytes]] = []
    for k in range(2):
        folder = tmp_path / str(k)
        write_dataset(folder, "quarter_rig", DEFAULTS, [made_run()])
        contents.append([(folder / name).read_bytes() for name in names_in(folder)])
    assert contents[0] == contents[1]


def test_a_column_name_with_a_comma_survives_csv(tmp_path):
    columns: dict[str, Array] = {**made.rig_columns(), 'a, "b"': np.zeros(60)}
    run = Run("a", columns, MappingProxyType({}), MappingProxyType(DEFAULTS))
    write_dataset(tmp_path, "quarter_rig", DEFAULTS, [run], table_format="csv")
    assert list(read_dataset(tmp_path).runs[0].columns) == list(columns)
