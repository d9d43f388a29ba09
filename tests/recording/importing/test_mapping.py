"""Mapping files: what they state, how it is applied, and how each mistake is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.errors import InputError, UnknownNameError
from omnimj.recording.importing.apply import apply_mapping
from omnimj.recording.importing.mapping import ColumnSource, LogMapping, StaleRule, mapping_text, read_mapping
from omnimj.recording.importing.propose import Proposal, propose
from omnimj.recording.importing.tables import SourceColumn, SourceTable

TIME = 0.03 * np.arange(80)
TEXT = """plant = "uto_robot"
empty = "drop"
[defaults]
floor = "pvc"
pose_measured = true
[csv]
separator = ";"
first_line = 4
[columns]
time = { from = "t", unit = "ms" }
wheel_speed_1 = { from = "ticks", difference = true, wrap = 65536, scale = 0.001 }
current_1 = { from = "cur", sign_of = "vel" }
[pose]
rotation = 0.5
[stale]
unchanged = ["ticks"]
moving = ["vel"]
[runs.a]
floor = "natural_stone"
"""


def table(**columns: object) -> SourceTable:
    """A log; a column is its values, or (values, unit)."""
    found = {}
    for name, entry in {"t": (TIME, "s"), **columns}.items():
        values, unit = entry if isinstance(entry, tuple) else (entry, "")
        found[name] = SourceColumn(name, np.asarray(values, float), unit)
    return SourceTable(Path("log.csv"), found, "made")


def mapped(source: SourceTable, **columns: ColumnSource):
    mapping = LogMapping("uto_robot", {"time": ColumnSource("t"), **columns})
    return apply_mapping(source, mapping, "a").run.columns


def written(folder: Path, text: str) -> LogMapping:
    (folder / "mapping.toml").write_text(text, encoding="utf-8")
    return read_mapping(folder / "mapping.toml")


def test_a_mapping_file_states_everything_that_a_conversion_needs(tmp_path):
    found = written(tmp_path, TEXT)
    assert found.columns["wheel_speed_1"] == ColumnSource("ticks", scale=0.001, difference=True, wrap=65536.0)
    assert found.columns["current_1"].sign_of == "vel" and found.columns["time"].unit == "ms"
    assert found.stale == StaleRule(("ticks",), ("vel",)) and found.rotation == 0.5 and found.empty == "drop"
    assert found.defaults == {"floor": "pvc", "pose_measured": True}
    assert found.runs == {"a": {"floor": "natural_stone"}}
    assert (found.dialect.separator, found.dialect.first_line, found.dialect.decimal) == (";", 4, None)


def test_a_mapping_that_is_written_comes_back(tmp_path):
    found = written(tmp_path, TEXT)
    assert written(tmp_path, mapping_text(Proposal(found))) == found


names = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12).filter(str.strip)


@given(names, st.floats(-1e6, 1e6).filter(bool), st.floats(-1e6, 1e6), st.booleans())
def test_any_source_comes_back_from_its_text(tmp_path_factory, name, scale, offset, difference):
    rule = ColumnSource(name, "mm/s", scale, offset, difference, 360.0, 16, name)
    mapping = LogMapping("mjcf", {"time": ColumnSource(name), f"position:{name}": rule}, {"floor": name})
    folder = tmp_path_factory.mktemp("mapping")
    assert written(folder, mapping_text(Proposal(mapping))) == mapping


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ('"uto_robot"', '"tractor"', UnknownNameError, "mapping.toml: plant: unknown plant 'tractor'"),
        ('plant = "uto_robot"', "", UnknownNameError, "plant: unknown plant None"),
        ("[defaults]", "[default]", UnknownNameError, "unknown key 'default'; did you mean 'defaults'"),
        ('unit = "ms"', 'unit = "furlong"', UnknownNameError, "columns.time.unit: unknown unit 'furlong'"),
        ('from = "cur"', 'form = "cur"', UnknownNameError, "columns.current_1: unknown key 'form'"),
        ("scale = 0.001", "scale = 0", InputError, "wheel_speed_1.scale: found 0; must not be 0"),
        ("scale = 0.001", 'scale = "x"', InputError, "wheel_speed_1.scale: found 'x'; a number is needed"),
        ("wrap = 65536", "wrap = -1", InputError, "wheel_speed_1.wrap: found -1"),
        ("difference = true", "difference = 1", InputError, "difference: found 1; must be true or false"),
        ("time =", "clock =", InputError, "'time' is missing"),
        ('{ from = "t", unit = "ms" }', '"t"', InputError, "columns.time: found 't'; write"),
        ('empty = "drop"', 'empty = "guess"', UnknownNameError, "choices: drop, hold, refuse"),
        ('separator = ";"', 'separator = "x"', UnknownNameError, "csv.separator"),
        ("first_line = 4", "first_line = 0", InputError, "lines are counted from 1"),
        ('["ticks"]', '"ticks"', InputError, "a list of columns of the log is needed"),
        ("rotation = 0.5", "rotation = inf", InputError, "rotation: found inf"),
        ("pose_measured = true", 'pose_measured = "yes"', InputError, "must be true or false"),
    ],
)
def test_a_mistake_in_a_mapping_is_refused_with_its_place(tmp_path, old, new, error, words):
    with pytest.raises(error) as caught:
        written(tmp_path, TEXT.replace(old, new))
    assert (
        words in str(caught.value) and "mapping.toml" in str(caught.value) and "\n" not in str(caught.value)
    )


def test_a_known_unit_is_converted_and_a_stated_one_takes_precedence():
    source = table(v=(np.full(80, 300.0), "deg/s"))
    assert mapped(source, yaw_rate=ColumnSource("v"))["yaw_rate"][0] == pytest.approx(np.deg2rad(300.0))
    assert mapped(source, yaw_rate=ColumnSource("v", "rpm"))["yaw_rate"][0] == pytest.approx(10 * np.pi)


def test_a_unit_of_another_kind_needs_a_scale():
    source = table(v=(np.ones(80), "m/s"))
    with pytest.raises(
        InputError, match=r"columns\.wheel_speed_1: column 'v' is in m/s; give a scale to rad/s"
    ):
        mapped(source, wheel_speed_1=ColumnSource("v"))
    assert mapped(source, wheel_speed_1=ColumnSource("v", scale=25.0))["wheel_speed_1"][0] == 25.0


def test_the_change_of_a_counter_that_starts_over_is_its_speed():
    turned = 3000.0 * TIME
    columns = mapped(table(n=turned % 256.0), wheel_speed_1=ColumnSource("n", None, 0.01, 0.0, True, 256.0))
    assert columns["wheel_speed_1"] == pytest.approx(np.full(79, 30.0)) and len(columns["time"]) == 79


def test_an_angle_is_unwrapped_and_a_magnitude_gets_its_sign():
    source = table(a=((350.0 + 10.0 * np.arange(80)) % 360.0, "deg"), i=np.ones(80), v=np.cos(TIME * 5.0))
    columns = mapped(source, heading=ColumnSource("a", wrap=360.0), current_1=ColumnSource("i", sign_of="v"))
    assert np.diff(columns["heading"]) == pytest.approx(np.deg2rad(10.0))
    assert np.array_equal(columns["current_1"], np.sign(np.cos(TIME * 5.0)))


def test_numbers_without_their_sign_bit_become_negative():
    columns = mapped(table(n=np.arange(80.0) * 0 + 65535.0), current_1=ColumnSource("n", signed=16))
    assert set(columns["current_1"]) == {-1.0}


def test_stale_rows_hold_the_speed_and_the_row_after_has_the_mean():
    ticks = 100.0 * np.arange(80)
    ticks[40:45] = ticks[39]
    mapping = LogMapping(
        "uto_robot",
        {"time": ColumnSource("t"), "wheel_speed_1": ColumnSource("n", scale=0.03, difference=True)},
        stale=StaleRule(("n",), ("v",)),
    )
    done = apply_mapping(table(n=ticks, v=np.ones(80)), mapping, "a")
    assert done.run.columns["wheel_speed_1"] == pytest.approx(np.full(79, 100.0))
    assert done.notes == ("5 stale rows, for up to 0.15 s, in which speeds are held",)


def test_the_pose_is_turned_about_its_origin():
    pose = {name: ColumnSource(name) for name in ("x", "y", "heading")}
    mapping = LogMapping("uto_robot", {"time": ColumnSource("t"), **pose}, rotation=np.pi / 2)
    source = table(x=np.ones(80), y=np.zeros(80), heading=np.zeros(80))
    columns = apply_mapping(source, mapping, "a").run.columns
    assert (columns["x"][0], columns["y"][0], columns["heading"][0]) == pytest.approx((0.0, 1.0, np.pi / 2))


@pytest.mark.parametrize(("rule", "rows"), [("drop", 79), ("hold", 80)])
def test_rows_with_empty_cells_are_dropped_or_filled_where_the_mapping_says_so(rule, rows):
    values = np.arange(80.0)
    values[10] = np.nan
    mapping = LogMapping("uto_robot", {"time": ColumnSource("t"), "x": ColumnSource("x")}, empty=rule)
    columns = apply_mapping(table(x=values), mapping, "a").run.columns
    assert len(columns["x"]) == rows and columns["x"][10] == (11.0 if rule == "drop" else 9.0)


def test_what_does_not_fit_a_log_is_refused_with_file_row_and_column():
    values = np.arange(80.0)
    values[10] = np.nan
    late = TIME.copy()
    late[20] = 0.0
    with pytest.raises(InputError, match=r"log\.csv: sample 11, column 'x': is empty"):
        mapped(table(x=values), x=ColumnSource("x"))
    with pytest.raises(InputError, match=r"sample 21, time: found 0 s after 0\.57 s; must increase"):
        mapped(table(t=late))
    with pytest.raises(UnknownNameError, match=r"columns\.x of the mapping\): unknown column 'z'"):
        mapped(table(), x=ColumnSource("z"))
    with pytest.raises(InputError, match="has 3 samples; at least 50"):
        mapped(table(t=TIME[:3]))
    with pytest.raises(InputError, match="is inf in SI units"):
        mapped(table(x=np.full(80, 1e300)), x=ColumnSource("x", scale=1e300))


def test_rows_with_the_time_of_the_row_before_are_left_out():
    twice = TIME.copy()
    twice[30] = twice[29]
    done = apply_mapping(table(t=twice), LogMapping("uto_robot", {"time": ColumnSource("t")}), "a")
    assert len(done.run.time) == 79 and done.notes == ("1 row with the time of the row before left out",)


def test_columns_under_the_names_of_omnimj_are_a_complete_proposal():
    names = [f"{kind}_{k}" for kind in ("current", "wheel_speed") for k in range(1, 6)]
    source = table(**{n: np.sin(TIME + k) for k, n in enumerate([*names, "x", "y", "heading"])})
    found = propose([source], floor="pvc")
    assert found.is_complete and found.mapping.plant == "uto_robot"
    assert found.mapping.defaults == {"floor": "pvc", "pose_measured": True}
    assert "time" in found.mapping.columns and "wheel_speed_5" in found.mapping.columns


def test_wheels_counted_from_0_are_counted_from_1():
    names = [f"motor{k}.{kind}" for kind in ("velocity", "current") for k in range(4)]
    found = propose([table(**{n: np.sin(TIME + k) for k, n in enumerate(names)})])
    assert found.mapping.columns["wheel_speed_1"].source == "motor0.velocity"
    assert found.mapping.columns["current_4"].source == "motor3.current"
    assert "acceleration_x" in found.missing and "[defaults] floor" in found.missing


@pytest.mark.parametrize(("step", "unit"), [(0.01, "s"), (10.0, "ms"), (1e4, "us"), (1e7, "ns")])
def test_the_unit_of_time_follows_from_its_step_where_none_is_written(step, unit):
    source = SourceTable(Path("a.csv"), {"t": SourceColumn("t", step * np.arange(99.0))}, "made")
    assert propose([source]).mapping.columns["time"].unit == unit
