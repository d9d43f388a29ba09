"""What a dataset's folder may look like, and how each mistake in one is refused."""

from __future__ import annotations

import os
from pathlib import Path

import made_datasets as made
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mentions import mentions

from omnimj.errors import InputError, UnknownNameError
from omnimj.plant.interface import RIG_CHANNELS, robot_channels
from omnimj.recording.dataset import PLANT_COLUMNS
from omnimj.recording.read_dataset import read_dataset

GOOD = made.csv_text(made.rig_columns())
LINES = GOOD.splitlines()
ROBOT = 'plant = "uto_robot"\n[defaults]\nfloor = "pvc"\n'
AXIS = 'plant = "linear_axis"\n'


def refused(folder: Path) -> str:
    """The one line that the folder is refused with; nothing in it has changed."""
    before = {file.name: file.stat().st_mtime_ns for file in folder.iterdir()} if folder.is_dir() else {}
    with pytest.raises(InputError) as caught:
        read_dataset(folder)
    after = {file.name: file.stat().st_mtime_ns for file in folder.iterdir()} if folder.is_dir() else {}
    message = str(caught.value)
    assert before == after and "\n" not in message and str(folder) in message
    return message


def with_row(row: int, text: str) -> str:
    """The good file with another row; the header is row 1."""
    return "\n".join([*LINES[: row - 1], text, *LINES[row:]]) + "\n"


def with_cell(row: int, column: str, text: str) -> str:
    cells = LINES[row - 1].split(",")
    cells[LINES[0].split(",").index(column)] = text
    return with_row(row, ",".join(cells))


# -- what is good --------------------------------------------------------------------------------------------


def test_numbers_come_back_bit_for_bit(tmp_path):
    run = read_dataset(made.write_rig(tmp_path)).runs[0]
    for name, values in made.rig_columns().items():
        assert run.columns[name].tobytes() == values.tobytes()
    assert run.name == "stone_090" and run.condition == "stone_090" and not run.masked
    assert dict(run.conditions) == {"floor": "natural_stone", "mass": 3.9593}


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + GOOD,
        GOOD.replace("\n", "\r\n"),
        GOOD.replace(",", " , "),
        ",".join(f'"{name}"' for name in LINES[0].split(",")) + "\n" + "\n".join(LINES[1:]),
        "\n".join([LINES[0], *(",".join(f'"{cell}"' for cell in line.split(",")) for line in LINES[1:])]),
        "\n\n".join(LINES) + "\n\n\n",
        "\n".join(f"{line}," for line in LINES),
        "\n".join([f"{LINES[0]},note", *(f'{line},"a, b"' for line in LINES[1:])]),
        "\n".join([f"{LINES[0]},note", *(f"{line}," for line in LINES[1:])]),
    ],
    ids=["mark", "crlf", "spaces", "quoted names", "quoted", "empty lines", "comma", "text", "empty"],
)
def test_any_way_to_write_a_csv_file_gives_the_same_numbers(tmp_path, text):
    run = read_dataset(made.write_rig(tmp_path, a=text)).runs[0]
    assert all(run.columns[name].tobytes() == v.tobytes() for name, v in made.rig_columns().items())
    assert set(run.columns) == set(made.rig_columns())


def test_numbers_that_python_reads_and_arrow_does_not_are_numbers(tmp_path):
    text = with_cell(5, "current", " 1.5e0") + "\n   \n"  # a line of spaces stops the quick way
    assert read_dataset(made.write_rig(tmp_path, a=text)).runs[0].columns["current"][3] == 1.5


def test_an_unknown_column_is_kept_if_it_holds_numbers_and_ignored_if_not(tmp_path):
    others = ("temperature", "comment", "half")
    rows = [f"{line},{20 + k},ok,{k if k % 2 else ''}" for k, line in enumerate(LINES[1:])]
    text = "\n".join([",".join([LINES[0], *others]), *rows])
    for patient in ("", "\n  \n"):
        run = read_dataset(made.write_rig(tmp_path / str(len(patient)), a=text + patient)).runs[0]
        assert run.columns["temperature"].tolist() == [20.0 + k for k in range(60)]
        assert "comment" not in run.columns
        assert np.isnan(run.columns["half"][::2]).all() and run.columns["half"][1] == 1.0


def test_parquet_and_csv_give_the_same_run(tmp_path):
    columns = made.rig_columns()
    folder = made.write_rig(tmp_path, a=columns)
    table = pa.table({**columns, "note": ["x"] * 60, "whole": pa.array([*range(59), None])})
    pq.write_table(table, folder / "b.parquet")
    (folder / "notes.txt").write_text("kept apart")
    (folder / ".a.csv").write_text("of some editor")
    first, second = read_dataset(folder).runs
    assert (first.name, second.name) == ("a", "b")
    for name in columns:
        assert first.columns[name].tobytes() == second.columns[name].tobytes()
    assert "note" not in second.columns and np.isnan(second.columns["whole"][59])


def test_sideways_speed_is_zero_where_it_was_not_measured(tmp_path):
    columns = made.rig_columns()
    del columns["lateral_speed"]
    assert not read_dataset(made.write_rig(tmp_path, a=columns)).runs[0].columns["lateral_speed"].any()


def test_columns_are_renamed_and_scaled_to_the_channels(tmp_path):
    columns = made.rig_columns()
    columns["v_car [mm/s]"] = 1000.0 * columns.pop("carriage_speed")
    columns["volts"] = (columns.pop("current") - 0.25) / 0.5
    toml = made.RIG + '[columns]\n"v_car [mm/s]" = { name = "carriage_speed", scale = 0.001 }\n'
    toml += 'volts = { name = "current", scale = 0.5, offset = 0.25 }\n'
    run = read_dataset(made.write_rig(tmp_path, toml, a=columns)).runs[0]
    for name, values in made.rig_columns().items():
        np.testing.assert_allclose(run.columns[name], values, rtol=1e-14, atol=1e-15)
    assert "volts" not in run.columns


def test_two_columns_may_trade_their_names(tmp_path):
    toml = made.RIG + '[columns]\ncurrent = { name = "wheel_speed" }\nwheel_speed = { name = "current" }\n'
    run = read_dataset(made.write_rig(tmp_path, toml)).runs[0]
    assert run.columns["current"].tobytes() == made.rig_columns()["wheel_speed"].tobytes()


def test_a_run_states_what_differs_from_the_defaults(tmp_path):
    toml = made.RIG + '[runs.a]\nfloor = "pvc"\nmass = 2\nrepeat_of = "p"\ndescription = "wet"\n'
    toml += "date = 2024-05-01\n[runs.b]\n"
    a, b = read_dataset(made.write_rig(tmp_path, toml, a=GOOD, b=GOOD)).runs
    expected = {"floor": "pvc", "mass": 2.0, "description": "wet", "date": "2024-05-01"}
    assert dict(a.conditions) == expected and a.repeat_of == "p" and a.condition == "p"
    assert b.conditions["floor"] == "natural_stone" and b.repeat_of is None


def test_the_columns_of_a_dataset_are_the_channels_of_the_plants():
    rig, robot = PLANT_COLUMNS["quarter_rig"], PLANT_COLUMNS["uto_robot"]
    assert (*rig.required, *rig.zero_if_absent) == ("time", *RIG_CHANNELS)
    assert robot.required == ("time", *robot_channels(4))


def test_robot_and_axis_have_columns_of_their_own(tmp_path):
    run = read_dataset(made.write_rig(tmp_path / "robot", ROBOT, a=made.robot_columns())).runs[0]
    assert not run.masked and set(run.columns) == set(made.robot_columns())
    by_force = made.axis_columns()
    by_current = {"time": by_force["time"], "current": by_force["force"], "position": by_force["position"]}
    runs = read_dataset(made.write_rig(tmp_path / "axis", AXIS, a=by_force, b=by_current)).runs
    assert [set(run.columns) for run in runs] == [set(by_force), set(by_current)]
    assert not runs[0].conditions


def test_a_user_s_floor_may_be_named(tmp_path):
    folder = made.write_rig(tmp_path, made.RIG.replace("natural_stone", "oak"))
    assert read_dataset(folder, floors=("oak",)).runs[0].conditions["floor"] == "oak"
    assert "unknown floor 'oak'" in refused(folder)


def test_what_was_read_cannot_be_changed_by_accident(tmp_path):
    run = read_dataset(made.write_rig(tmp_path)).runs[0]
    with pytest.raises(ValueError, match="read-only"):
        run.columns["current"][0] = 1.0


def test_a_long_run_is_read_quickly(tmp_path):
    columns = made.rig_columns(60_000)
    text = made.csv_text(columns)
    run = read_dataset(made.write_rig(tmp_path, a=text)).runs[0]
    assert len(run.time) == 60_000


# -- what is wrong with the table ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (with_cell(7, "current", "abc"), "a.csv: row 7, column 'current': found 'abc'; a finite number"),
        (with_cell(7, "current", "NaN"), "row 7, column 'current': found 'NaN'"),
        (with_cell(7, "current", "-inf"), "row 7, column 'current': found '-inf'"),
        (with_cell(7, "current", "1e999"), "row 7, column 'current': found '1e999'"),
        (with_cell(7, "current", ""), "row 7, column 'current': found an empty cell"),
        (with_cell(7, "current", "   "), "row 7, column 'current': found an empty cell"),
        (with_cell(7, "current", "1_0"), "row 7, column 'current': found '1_0'"),
        (with_cell(7, "current", "٣"), "row 7, column 'current': found '٣'"),
        (with_cell(7, "current", "0x1F"), "row 7, column 'current': found '0x1F'"),
        (with_cell(7, "current", '"1,5"'), "row 7, column 'current': found '1,5'"),
        (with_cell(61, "lateral_speed", "x"), "row 61, column 'lateral_speed': found 'x'"),
        (with_row(9, LINES[8] + ",3"), "row 9: has 7 cells; the header has 6 columns"),
        (with_row(9, LINES[8].rpartition(",")[0]), "row 9: has 5 cells"),
        (with_row(9, "end of run"), "row 9: has the one cell 'end of run'"),
        (with_cell(9, "time", repr(0.06)), "row 9, column 'time': found 0.06 after 0.06; must increase"),
        (with_cell(9, "time", "0"), "row 9, column 'time': found 0 after 0.06"),
        ("\n".join(LINES[:50]), "has 49 samples; at least 50 are needed"),
        (LINES[0], "has 0 samples"),
        (LINES[0] + "\n", "has 0 samples"),
        ("", "a.csv: is empty"),
        ("\n" + GOOD, "has no header"),
        (",,,\n", "has no column names"),
        (GOOD.replace(",", ";"), "row 1: found 'time;current"),
        (GOOD.replace("wheel_speed", "current"), "row 1: has column 'current' twice"),
        (GOOD.replace("wheel_speed", " current "), "row 1: has column 'current' twice"),
        (GOOD.replace("wheel_speed", "omega"), "has no column wheel_speed; quarter_rig needs time, current,"),
        (GOOD.replace("wheel_speed", "omega"), "the file has time, current, omega"),
        (GOOD.replace("time", "t").replace("current", "i"), "has no columns time, current"),
        (GOOD.replace("time", "time\0"), "has no column time"),
        (with_row(9, '"' + LINES[8]), "row 9: has the one cell"),
    ],
)
def test_a_wrong_csv_file_is_refused_with_its_place(tmp_path, text, expected):
    message = refused(made.write_rig(tmp_path, a=text))
    assert expected in message and "a.csv" in message


def test_rows_are_counted_with_empty_lines_and_the_header(tmp_path):
    text = "\n".join([*LINES[:4], "", "", *LINES[4:]])
    broken = text.replace(LINES[5], LINES[5].replace("0.04", "0.01", 1))
    assert "row 8, column 'time': found 0.01 after 0.03" in refused(made.write_rig(tmp_path, a=broken))


def test_the_first_of_several_mistakes_is_reported(tmp_path):
    text = with_cell(30, "time", "x").replace(LINES[40], "y")
    assert "row 30" in refused(made.write_rig(tmp_path, a=text))


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
def test_a_header_in_another_encoding_is_refused(tmp_path, encoding):
    folder = made.write_rig(tmp_path)
    (folder / "b.csv").write_bytes(GOOD.replace("time", "time,µ").encode(encoding))
    assert "b.csv: row 1: is not UTF-8 text" in refused(folder)


def test_a_comment_in_another_encoding_is_no_mistake(tmp_path):
    rows = "\n".join([f"{LINES[0]},remark", *(f"{line},µ" for line in LINES[1:])])
    folder = made.write_rig(tmp_path)
    (folder / "b.csv").write_bytes(rows.encode("latin-1"))
    assert len(read_dataset(folder).runs) == 2


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"current": pa.array(["x"] * 60)}, "column 'current' holds string"),
        ({"current": pa.array([True] * 60)}, "column 'current' holds bool"),
        ({"time": pa.array(range(60), pa.timestamp("us"))}, "column 'time' holds timestamp"),
        ({"current": pa.array([*range(59), None])}, "row 60, column 'current': found an empty cell"),
        ({"current": pa.array([*[0.0] * 59, np.nan])}, "row 60, column 'current': found nan"),
        ({"current": pa.array([*[0.0] * 59, np.inf])}, "row 60, column 'current': found inf"),
        ({"time": pa.array([0, *range(59)])}, "row 2, column 'time': found 0 after 0"),
        ({"current": None}, "has no column current"),
    ],
)
def test_a_wrong_parquet_file_is_refused_with_its_place(tmp_path, change, expected):
    columns = {k: v for k, v in {**made.rig_columns(), **change}.items() if v is not None}
    folder = made.write_rig(tmp_path)
    pq.write_table(pa.table(columns), folder / "b.parquet")
    assert expected in refused(folder)


def test_a_parquet_file_with_a_column_twice_is_refused(tmp_path):
    folder, columns = made.write_rig(tmp_path), made.rig_columns()
    table = pa.table([*columns.values(), columns["current"]], names=[*columns, "current"])
    pq.write_table(table, folder / "b.parquet")
    assert "has column 'current' twice" in refused(folder)


# -- what is wrong with dataset.toml or the folder -----------------------------------------------------------


@pytest.mark.parametrize(
    ("toml", "expected"),
    [
        ("", "dataset.toml: 'plant' is missing; a dataset has one; choices: linear_axis, mjcf, quarter_rig"),
        ("plant", "dataset.toml: is not valid TOML; Expected '='"),
        ("plant = 3", "plant: unknown plant 3"),
        ('plant = "quarter_rigg"', "unknown plant 'quarter_rigg'; did you mean 'quarter_rig'?"),
        (made.RIG + "speed = 3\n", "[defaults]: unknown key 'speed'; choices: date"),
        (made.RIG + "masss = 3\n", "did you mean 'mass'?"),
        ('plants = "x"\n' + made.RIG, "unknown key 'plants'; did you mean 'plant'?"),
        (made.RIG.replace("natural_stone", "moss"), "[defaults]: floor: unknown floor 'moss'; choices"),
        (made.RIG.replace('"natural_stone"', "4"), "floor: unknown floor 4"),
        (made.RIG.replace("3.9593", "0"), "[defaults]: mass: found 0; must be above 0"),
        (made.RIG.replace("3.9593", "-1"), "mass: found -1"),
        (made.RIG.replace("3.9593", "nan"), "mass: found nan"),
        (made.RIG.replace("3.9593", "true"), "mass: found True; a number is needed"),
        (made.RIG.replace("3.9593", '"4 kg"'), "mass: found '4 kg'; a number is needed"),
        (made.RIG + '"mass:wheel" = 3.0\n', "unknown key 'mass:wheel'"),
        (made.RIG.replace("mass = 3.9593", ""), "run 'a': 'mass' is missing; state it under [defaults] or"),
        (made.RIG.replace('floor = "natural_stone"', ""), "run 'a': 'floor' is missing"),
        ('runs = 3\nplant = "quarter_rig"', "[runs]: found 3; a table is needed"),
        (made.RIG + "[runs]\na = 3\n", "[runs.a]: found 3; a table is needed"),
        (made.RIG + '[runs.a]\nrepeat_of = ""\n', "[runs.a]: repeat_of: found ''; a string is needed"),
        (made.RIG + "[runs.a]\nrepeat_of = 3\n", "repeat_of: found 3"),
        (made.RIG + '[runs.a]\nfloors = "pvc"\n', "[runs.a]: unknown key 'floors'; did you mean 'floor'?"),
        (made.RIG + "[runs.b]\n", "[runs.b]: there is no b.csv or b.parquet; the folder has a"),
        (made.RIG + '[runs."a\\nb"]\n', "there is no 'a\\nb'.csv"),
        (made.RIG + '[runs."a\\nb"]\nx = 3\n', "[runs.'a\\nb']: unknown key 'x'"),
        (made.RIG + "[runs.A]\n", "[runs.A]: there is no A.csv"),
        (made.RIG + "[columns]\nv = 3\n", "columns.'v': found 3; write { name ="),
        (made.RIG + "[columns]\nv = { scale = 3 }\n", "columns.'v': 'name' is missing"),
        (made.RIG + '[columns]\nv = { name = "speed" }\n', "unknown column of quarter_rig 'speed'"),
        (made.RIG + '[columns]\nv = { name = "current", gain = 3 }\n', "unknown key 'gain'"),
        (made.RIG + '[columns]\nv = { name = "current", scale = 0 }\n', ".scale: found 0; must not be 0"),
        (made.RIG + '[columns]\nv = { name = "current", scale = inf }\n', ".scale: found inf"),
        (made.RIG + '[columns]\nv = { name = "current", offset = "1" }\n', ".offset: found '1'"),
        (made.RIG + '[columns]\nv = { name = "current" }\n', "unknown column of any run 'v'"),
        (
            made.RIG + '[columns]\nwheel_speed = { name = "current" }\n',
            "column 'current' occurs twice, as 'current' and as 'wheel_speed'",
        ),
        (
            made.RIG + '[columns]\ncurrent = { name = "current", scale = 1e308 }\n'
            "[runs.a]\n"
            'description = "1e308 × 100"\n',
            "column 'current': overflows",
        ),
        ("[" * 100_000, "is not valid TOML"),
        (made.RIG + "x = 99999999999999999999", "more than 64 bits"),
    ],
)
def test_a_wrong_dataset_toml_is_refused_with_its_place(tmp_path, toml, expected):
    columns = made.rig_columns()
    columns["current"] = 100.0 * columns["current"]
    assert expected in refused(made.write_rig(tmp_path, toml, a=columns))


def test_repeats_of_one_condition_have_one_floor_and_one_mass(tmp_path):
    toml = made.RIG + '[runs.a]\nrepeat_of = "x"\n[runs.b]\nrepeat_of = "x"\nmass = 2.0\n'
    message = refused(made.write_rig(tmp_path, toml, a=GOOD, b=GOOD))
    assert mentions(message, "run 'b'", "mass", "2.0", "3.9593", "'a'", "'x'")


def test_an_axis_needs_force_or_current(tmp_path):
    columns = made.axis_columns()
    del columns["force"]
    message = refused(made.write_rig(tmp_path, AXIS, a=columns))
    assert mentions(message, "force or current", "linear_axis needs time, position")


def test_a_folder_without_a_dataset_is_refused_as_such(tmp_path):
    assert "no such folder" in refused(tmp_path / "nothing")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file"):
        read_dataset(tmp_path / "file")
    assert "has no dataset.toml" in refused(tmp_path)
    (tmp_path / "dataset.toml").write_text(made.RIG)
    assert mentions(refused(tmp_path), "no runs", "NAME.csv", "NAME.parquet")


def test_two_files_of_one_run_are_refused(tmp_path):
    folder = made.write_rig(tmp_path, a=GOOD)
    made.write_parquet(folder / "a.parquet", made.rig_columns())
    assert "run 'a' occurs twice, a.csv and a.parquet" in refused(folder)


def test_a_dataset_toml_that_is_no_text_is_refused(tmp_path):
    folder = made.write_rig(tmp_path)
    (folder / "dataset.toml").write_bytes(b"plant = \xff\xfe")
    assert "is not valid TOML" in refused(folder)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root reads everything")
def test_a_file_without_read_permission_is_refused_by_name(tmp_path):
    folder = made.write_rig(tmp_path, a=GOOD)
    (folder / "a.csv").chmod(0)
    assert "cannot be read" in refused(folder)


# -- hostile files -------------------------------------------------------------------------------------------


def outcome(folder: Path) -> None:
    """A dataset is read, or refused in one line; nothing else."""
    try:
        read_dataset(folder)
    except InputError as error:
        assert "\n" not in str(error)


@given(cut=st.integers(0, 2**31))
def test_a_truncated_parquet_file_is_refused(tmp_path_factory, cut):
    folder = made.write_rig(tmp_path_factory.mktemp("cut"))
    made.write_parquet(folder / "b.parquet", made.rig_columns())
    content = (folder / "b.parquet").read_bytes()
    (folder / "b.parquet").write_bytes(content[: cut % len(content)])
    assert "b.parquet: is not a whole Parquet file" in refused(folder)


@pytest.mark.slow
@given(position=st.integers(0, 2**31), flip=st.integers(1, 255))
def test_a_parquet_file_with_a_flipped_byte_is_read_or_refused(tmp_path_factory, position, flip):
    folder = made.write_rig(tmp_path_factory.mktemp("flip"))
    made.write_parquet(folder / "b.parquet", made.rig_columns())
    content = bytearray((folder / "b.parquet").read_bytes())
    content[position % len(content)] ^= flip
    (folder / "b.parquet").write_bytes(bytes(content))
    outcome(folder)


@given(st.binary(max_size=400), st.sampled_from(["b.parquet", "b.csv", "dataset.toml"]))
def test_any_bytes_are_read_or_refused(tmp_path_factory, content, name):
    folder = made.write_rig(tmp_path_factory.mktemp("bytes"))
    (folder / name).write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_dataset(folder)
    assert "\n" not in str(caught.value)


@given(cut=st.integers(0, len(GOOD)), position=st.integers(0, len(GOOD) - 1), byte=st.integers(0, 255))
def test_a_damaged_csv_file_is_read_or_refused(tmp_path_factory, cut, position, byte):
    folder = made.write_rig(tmp_path_factory.mktemp("csv"))
    damaged = bytearray(GOOD.encode())
    damaged[position] = byte
    (folder / "b.csv").write_bytes(bytes(damaged))
    outcome(folder)
    (folder / "b.csv").write_bytes(GOOD.encode()[:cut])
    outcome(folder)


TOML = made.RIG + '[runs.a]\nrepeat_of = "x"\n[columns]\ntime = { name = "time", scale = 1.0 }\n'


@given(position=st.integers(0, len(TOML) - 1), text=st.text(max_size=3))
def test_a_damaged_dataset_toml_is_read_or_refused(tmp_path_factory, position, text):
    folder = made.write_rig(tmp_path_factory.mktemp("toml"), a=GOOD)
    damaged = (TOML[:position] + text + TOML[position + 1 :]).encode("utf-8", "surrogatepass")
    (folder / "dataset.toml").write_bytes(damaged)
    outcome(folder)


def test_a_parquet_file_that_claims_any_number_of_rows_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("omnimj.recording.run_table.MAX_NUMBERS", 300)
    folder = made.write_rig(tmp_path)
    made.write_parquet(folder / "b.parquet", made.rig_columns())
    assert "claims 60 rows" in refused(folder)


def test_an_unknown_name_is_also_a_lookup_error(tmp_path):
    with pytest.raises(UnknownNameError):
        read_dataset(made.write_rig(tmp_path, 'plant = "rig"'))
