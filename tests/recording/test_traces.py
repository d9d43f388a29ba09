"""`trace.parquet` keeps every bit, and neither half-written nor hostile files pass."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.errors import InputError
from omnimj.recording.folder import RUN_FILES, atomic_file, check_folder, make_folder
from omnimj.recording.traces import read_trace, write_trace
from omnimj.signals import Array, Trace


def example(rows: int = 300) -> Trace:
    noise: Array = np.random.default_rng(1).normal(size=(2, rows))
    time: Array = np.array(range(rows), np.float64)
    columns = {"time": time, "x": noise[0], "slip_velocity_1": noise[1]}
    return Trace(
        columns, {"scenario": "nylon_patch", "seed": 3, "realtime_factor": 12.5, "interrupted": False}
    )


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("written") / "trace.parquet"
    write_trace(path, example())
    return path.read_bytes()


@given(st.lists(st.integers(0, 2**64 - 1), max_size=50))
def test_a_trace_comes_back_bit_for_bit(tmp_path_factory, bits):
    # every float there is: ±0, ±∞, all kinds of NaN
    values: Array = np.array(bits, dtype=np.uint64).view(np.float64)
    time: Array = np.zeros(len(bits))
    path = tmp_path_factory.mktemp("bits") / "trace.parquet"
    write_trace(path, Trace({"time": time, "x": values}))
    assert read_trace(path)["x"].view(np.uint64).tolist() == bits


def test_columns_keep_their_order_and_the_run_its_description(tmp_path):
    write_trace(tmp_path / "trace.parquet", example())
    back = read_trace(tmp_path / "trace.parquet")
    assert list(back.columns) == ["time", "x", "slip_velocity_1"]
    assert back.about == example().about
    assert back.wheels("slip_velocity").shape == (300, 1)


def test_any_parquet_reader_can_read_a_trace(tmp_path):
    write_trace(tmp_path / "trace.parquet", example())
    assert pq.read_table(tmp_path / "trace.parquet").to_pydict()["x"] == example()["x"].tolist()


@given(cut=st.integers(0, 2**31))
def test_a_truncated_file_is_refused(tmp_path_factory, written, cut):
    path = tmp_path_factory.mktemp("cut") / "trace.parquet"
    path.write_bytes(written[: cut % len(written)])
    with pytest.raises(InputError, match=r"trace\.parquet.*is not a whole Parquet file"):
        read_trace(path)


@given(st.binary(max_size=300))
def test_bytes_that_are_no_parquet_are_refused(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("bytes") / "trace.parquet"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_trace(path)
    assert "\n" not in str(caught.value)


@given(position=st.integers(0, 2**31), flip=st.integers(1, 255))
def test_a_damaged_file_is_refused_or_holds_the_same_numbers(tmp_path_factory, written, position, flip):
    damaged = bytearray(written)
    damaged[position % len(written)] ^= flip
    path = tmp_path_factory.mktemp("damaged") / "trace.parquet"
    path.write_bytes(bytes(damaged))
    try:
        back = read_trace(path)
    except InputError:
        return
    # the damage hit a name or a description: pages have checksums, so that no number can have changed
    stored = [values.tolist() for values in example().columns.values()]
    assert [values.tolist() for values in back.columns.values()] == stored


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        (pa.table({"x": [1.0]}), "has no column 'time'"),
        (pa.table([[1.0], [1.0], [2.0]], names=["time", "x", "x"]), "has column 'x' twice"),
        (pa.table({"time": [1.0], "x": ["a"]}), "column 'x' holds string"),
        (pa.table({"time": [1.0], "x": [True]}), "column 'x' holds bool"),
        (pa.table({"time": [1.0], "x": [[1.0]]}), "column 'x' holds list"),
        (pa.table({"time": [1.0, 2.0], "x": [1.0, None]}), "column 'x' has 1 empty rows"),
        (pa.table({"time": [1.0]}).replace_schema_metadata({"omnimj": "{"}), "is not JSON"),
        (pa.table({"time": [1.0]}).replace_schema_metadata({"omnimj": "[" * 100_000}), "is not JSON"),
        (pa.table({"time": [1.0]}).replace_schema_metadata({"omnimj": "5"}), "is not a JSON object"),
    ],
)
def test_a_table_that_is_no_trace_is_refused(tmp_path, table, expected):
    pq.write_table(table, tmp_path / "trace.parquet")
    with pytest.raises(InputError) as caught:
        read_trace(tmp_path / "trace.parquet")
    assert expected in str(caught.value) and "trace.parquet" in str(caught.value)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_trace(tmp_path / "trace.parquet")
    with pytest.raises(InputError, match="no such file"):
        read_trace(tmp_path)


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("error", [RuntimeError("full"), KeyboardInterrupt()])
def test_a_writer_that_fails_leaves_the_old_file_and_nothing_else(tmp_path, error):
    path = tmp_path / "report.html"
    path.write_text("old")
    with pytest.raises(type(error)), atomic_file(path) as temporary:
        temporary.write_text("ne")
        raise error
    assert path.read_text() == "old" and names_in(tmp_path) == ["report.html"]


def test_a_file_appears_when_it_is_whole(tmp_path):
    with atomic_file(tmp_path / "run.rrd") as temporary:
        temporary.write_text("new")
        assert temporary.suffix == ".rrd" and not (tmp_path / "run.rrd").exists()
    assert names_in(tmp_path) == ["run.rrd"]


def test_a_folder_with_something_in_it_is_refused_without_force(tmp_path):
    (tmp_path / "mine.txt").write_text("precious")
    with pytest.raises(InputError, match=r"is not empty; .*--force"):
        check_folder(tmp_path, force=False)
    with pytest.raises(InputError, match="is not empty"):
        make_folder(tmp_path, force=False)
    with pytest.raises(InputError, match="is a file"):
        check_folder(tmp_path / "mine.txt", force=True)


def test_force_takes_away_an_earlier_run_and_nothing_else(tmp_path):
    for name in (*RUN_FILES, "mine.txt"):
        (tmp_path / name).write_text("old")
    make_folder(tmp_path, force=True)
    assert names_in(tmp_path) == ["mine.txt"]


def test_a_folder_is_made_where_there_is_none(tmp_path):
    make_folder(tmp_path / "a" / "b", force=False)
    assert (tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be"):
        make_folder(tmp_path / "file" / "b", force=False)
