"""CSV files of any dialect give the same columns; what is no table is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.errors import InputError
from omnimj.recording.importing.dialect import Dialect, find_dialect
from omnimj.recording.importing.source import READERS, read_source
from omnimj.recording.importing.units import find_unit, known_units, split_unit, target_unit

TABLES = sorted(set(READERS) - {".mcap", ".db3"})
ROWS = 30
NAMES = ("t", "v_car", "i_motor")
UNITS = ("ms", "mm/s", "mA")
VALUES = np.stack([31.25 * np.arange(ROWS), 250.5 * np.sin(np.arange(ROWS)), 1e3 + np.arange(ROWS)], axis=1)


def text_of(separator: str, decimal: str, head: list[str], end: str = "\n") -> str:
    cells = [[repr(float(x)).replace(".", decimal) for x in row] for row in VALUES]
    return end.join([*head, *(separator.join(row) for row in cells)]) + end


def head_of(style: str, separator: str) -> list[str]:
    names, units = separator.join(NAMES), separator.join(UNITS)
    brackets = separator.join(f"{name} [{unit}]" for name, unit in zip(NAMES, UNITS, strict=True))
    words = separator.join(["Time", "Speed of the car", "Current"])
    return {
        "brackets": [brackets],
        "two lines": [names, units],
        "three lines": [words, units, names],
        "preamble": ["Recorded by a logger", "", brackets],
        "comment": [f"# {brackets}"],
    }[style]


@pytest.mark.parametrize("style", ["brackets", "two lines", "three lines", "preamble", "comment"])
@pytest.mark.parametrize(
    ("separator", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), ("|", ".")]
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_every_dialect_gives_the_same_numbers_names_and_units(tmp_path, style, separator, decimal, encoding):
    path = tmp_path / "log.csv"
    text = text_of(separator, decimal, head_of(style, separator), "\r\n" if style == "preamble" else "\n")
    path.write_bytes(text.encode(encoding))
    table = read_source(path)
    assert tuple(table.columns) == NAMES
    assert tuple(column.unit for column in table.columns.values()) == UNITS
    for k, column in enumerate(table.columns.values()):
        assert np.array_equal(column.values, VALUES[:, k])


def test_columns_aligned_by_spaces_are_read(tmp_path):
    lines = [" ".join(NAMES), *("   ".join(f"{x:>12.6f}" for x in row) for row in VALUES)]
    (tmp_path / "log.txt").write_text("\n".join(lines))
    table = read_source(tmp_path / "log.txt")
    assert tuple(table.columns) == NAMES
    assert table.columns["v_car"].values == pytest.approx(VALUES[:, 1], abs=1e-6)


def test_a_file_without_a_header_has_numbered_columns(tmp_path):
    (tmp_path / "log.csv").write_text(text_of(",", ".", []))
    assert tuple(read_source(tmp_path / "log.csv").columns) == ("column_1", "column_2", "column_3")


def test_what_is_given_of_a_dialect_is_kept():
    lines = text_of(";", ",", head_of("three lines", ";")).splitlines()
    found = find_dialect("log", lines, Dialect(names_line=1, units_line=0))
    assert (found.names_line, found.units_line, found.separator, found.decimal) == (1, 0, ";", ",")
    with pytest.raises(InputError, match=r"log: csv\.first_line: found 99; the file has 33 lines"):
        find_dialect("log", lines, Dialect(first_line=99))


def test_texts_truths_and_dates_are_told_apart(tmp_path):
    lines = ["when,on,label,value"]
    lines += [f"2026-01-15T10:28:{k:02d}.5,{k % 2 == 0},run {k},{k}" for k in range(20)]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    table = read_source(tmp_path / "log.csv")
    assert table.columns["when"].values.tolist() == list(range(20)) and table.columns["when"].unit == "s"
    assert table.columns["on"].values.tolist() == [1.0, 0.0] * 10
    assert table.others == {"label": "text, 'run 0' in row 2"}


def test_a_last_row_that_is_cut_off_is_left_out_and_one_in_the_middle_is_refused_by_its_row(tmp_path):
    lines = text_of(",", ".", [",".join(NAMES)]).splitlines()
    path = tmp_path / "log.csv"
    path.write_text("\n".join([*lines[:-1], lines[-1].split(",")[0]]))
    table = read_source(path)
    assert len(table.columns["t"].values) == ROWS - 1 and "row 31, the last one, is cut off" in table.notes[0]
    path.write_text("\n".join([*lines[:9], "1.0,2.0", *lines[10:]]))
    with pytest.raises(InputError, match=r"log\.csv: row 10: has 2 cells; the rows above have 3"):
        read_source(path)


@given(st.data())
@pytest.mark.parametrize("suffix", TABLES)
def test_truncated_flipped_and_random_files_are_read_or_refused_in_one_line(tmp_path_factory, suffix, data):
    folder = tmp_path_factory.mktemp("hostile")
    whole = made(folder / f"whole{suffix}").read_bytes()
    kind = data.draw(st.sampled_from(["cut", "flipped", "random"]))
    if kind == "cut":
        content = whole[: data.draw(st.integers(0, len(whole) - 1))]
    elif kind == "flipped":
        content = bytearray(whole)
        for _ in range(data.draw(st.integers(1, 8))):
            content[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
        content = bytes(content)
    else:
        content = data.draw(st.binary(max_size=300))
    path = folder / f"log{suffix}"
    path.write_bytes(content)
    try:
        table = read_source(path)
    except InputError as error:
        assert "\n" not in str(error) and str(path) in str(error)
    else:
        assert len({len(column.values) for column in table.columns.values()}) == 1


def made(path: Path) -> Path:
    """A small log in the format of a suffix."""
    columns = dict(zip(NAMES, VALUES.T, strict=True))
    if path.suffix == ".mat":
        from scipy.io import savemat

        savemat(path, {"log": columns, "gear": 16.0}, do_compression=True)
    elif path.suffix == ".parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.table(columns), path)
    elif path.suffix.startswith(".json") or path.suffix == ".ndjson":
        records = [dict(zip(NAMES, row.tolist(), strict=True)) for row in VALUES]
        text = json.dumps({"entries": records, "kp": 3}) if path.suffix == ".json" else ""
        path.write_text(text or "\n".join(map(json.dumps, records)))
    else:
        path.write_text(text_of(";", ".", head_of("three lines", ";")))
    return path


@pytest.mark.parametrize("suffix", TABLES)
def test_every_format_gives_the_same_numbers(tmp_path, suffix):
    table = read_source(made(tmp_path / f"log{suffix}"))
    assert set(table.columns) == set(NAMES)
    for k, name in enumerate(NAMES):
        assert np.array_equal(table.columns[name].values, VALUES[:, k])


def test_nested_lists_become_numbered_columns_and_single_values_are_kept(tmp_path):
    records = [{"t": k, "motor": {"current": [k, 2 * k, 3 * k]}} for k in range(9)]
    (tmp_path / "log.json").write_text(json.dumps({"kp": 800, "name": "test", "data": {"rows": records}}))
    table = read_source(tmp_path / "log.json")
    assert table.columns["motor.current_3"].values.tolist() == [3.0 * k for k in range(9)]
    assert table.scalars == {"kp": "800", "name": "test"}


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("log.mat", b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + b" " * 86 + b"\x00\x02IM", "version 7.3"),
        ("log.mat", b"nothing", "is not a whole MATLAB file"),
        ("log.json", b"[" * 100_000, "nested too deeply|is not valid JSON"),
        ("log.json", b'{"a": 1}', "holds no table"),
        ("log.json", b"{'a': 1}", "is not valid JSON"),
        ("log.jsonl", b'{"a": 1}\n{"a"', "line 2: is not valid JSON"),
        ("log.csv", b"", "is empty"),
        ("log.csv", b"\x00\x01", "is not a text file"),
        ("log.csv", b"a,b\nc,d\n", "has no rows of numbers"),
        ("log.xls", b"x", r"the format is not known; choices: \.csv"),
    ],
)
def test_what_is_no_log_is_refused_in_one_line(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        read_source(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InputError, match="no such file"):
        read_source(tmp_path / "none.csv")
    with pytest.raises(InputError, match="is a folder"):
        read_source(tmp_path / "folder.csv")


@pytest.mark.parametrize(
    ("written", "si", "factor"),
    [
        ("mm/s", "m/s", 1e-3),
        ("deg", "rad", np.pi / 180),
        ("RPM", "rad/s", np.pi / 30),
        ("mA", "A", 1e-3),
        ("m/s²", "m/s2", 1.0),
        ("m/s^2", "m/s2", 1.0),
        ("g", "m/s2", 9.80665),
        ("µs", "s", 1e-6),
        ("°/s", "rad/s", np.pi / 180),
    ],
)
def test_units_are_converted_to_si(written, si, factor):
    unit = find_unit(written)
    assert unit is not None and unit.si == si and unit.factor == pytest.approx(factor)


def test_every_known_unit_is_found_and_others_are_not():
    assert all(find_unit(name) is not None for name in known_units())
    assert find_unit("furlong") is None and find_unit("") is None


@pytest.mark.parametrize(
    ("full", "parts"),
    [
        ("v_car [mm/s]", ("v_car", "mm/s")),
        ("speed (rpm)", ("speed", "rpm")),
        ("t / ms", ("t", "ms")),
        ("time_ms", ("time", "ms")),
        ("wheel_speed_1", ("wheel_speed_1", "")),
        ("position", ("position", "")),
    ],
)
def test_a_unit_is_split_from_its_name(full, parts):
    assert split_unit(full) == parts


def test_columns_of_omnimj_have_si_units():
    assert target_unit("wheel_speed_3") == "rad/s" and target_unit("yaw_rate") == "rad/s"
    assert target_unit("x") == "m" and target_unit("position:joint") == ""
