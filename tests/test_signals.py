"""Traces as NumPy, Arrow, pandas and polars: the same numbers."""

from __future__ import annotations

import json
import sys

import numpy as np
import pyarrow
import pytest

from omnimj.signals import Trace

TRACE = Trace({"time": np.arange(3.0), "x": np.array([0.1, np.nan, -0.0])}, {"seed": 3, "floor": "pvc"})


def test_an_arrow_table_has_the_columns_bit_for_bit_and_without_a_copy():
    table = TRACE.to_arrow()
    assert table.column_names == ["time", "x"] and json.loads(table.schema.metadata[b"omnimj"]) == TRACE.about
    for name in table.column_names:
        found = table.column(name).chunk(0)
        assert found.to_numpy(zero_copy_only=True).tobytes() == TRACE[name].tobytes()
        assert found.buffers()[1].address == TRACE[name].ctypes.data


def test_libraries_that_read_arrow_take_a_trace_as_it_is():
    trace = Trace({"time": np.arange(3.0), "x": np.ones(3)})
    assert pyarrow.table(trace).equals(trace.to_arrow())
    polars = pytest.importorskip("polars")
    assert polars.DataFrame(trace).equals(trace.to_polars())
    assert trace.to_polars()["time"].to_list() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_a_missing_library_is_named_with_its_extra(library, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ImportError, match=rf"pip install 'omnimj\[{library}\]'"):
        getattr(TRACE, f"to_{library}")()
