"""Comparison of traces, bit for bit."""

from __future__ import annotations

import numpy as np


def assert_same(first, second):
    assert list(first.columns) == list(second.columns)
    for name in first.columns:
        assert np.array_equal(first[name], second[name], equal_nan=True), name
    about = ({k: v for k, v in trace.about.items() if k != "realtime_factor"} for trace in (first, second))
    assert next(about) == next(about)
