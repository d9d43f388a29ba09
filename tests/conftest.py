"""Shared by all tests; its place also puts this folder on the import path (for `rig_reference`).

Tests of laws report what they measured; the table is printed at the end of the run.
"""

from __future__ import annotations

import gc
import os

import pytest
from hypothesis import settings
from undrawn_pages import without_embedding

# as the command line does: small matrices, and several workers share the cores; numpy reads it when imported
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# a kernel compiles on its first call, which says nothing about the example at hand; where CI is set every
# run meets the same examples, elsewhere each run meets new ones
settings.register_profile("kernels", deadline=None, derandomize="CI" in os.environ)
settings.register_profile("few", settings.get_profile("kernels"), max_examples=40)  # for .ci/run
settings.load_profile("kernels")


@pytest.hookimpl(wrapper=True)
def pytest_collection(session):
    """Keeps what importing and collecting makes, which stays, out of every later garbage collection.

    The hosts and devices of a link would put it back when they close.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()
        gc.unfreeze = lambda: None


@pytest.fixture
def measured(record_property):
    """Notes a figure beside its limit: `measured(name, value, limit)`; the worst value of a name is shown."""

    def note(name, value, limit):
        record_property("measured", (name, float(value), float(limit)))

    return note


@pytest.fixture
def undrawn():
    """Plots of reports are made and not embedded: that takes time, and others test what is in them."""
    with without_embedding():
        yield


def pytest_terminal_summary(terminalreporter):
    """Prints the worst figure of every name beside its limit."""
    worst = {}
    for reports in terminalreporter.stats.values():
        for report in reports:
            for key, noted in getattr(report, "user_properties", ()):
                if key == "measured":
                    name, value, limit = noted
                    worst[name] = max(value, worst.get(name, (value,))[0]), limit
    if worst:
        terminalreporter.write_sep("-", "measured: worst value, limit")
    for name, (value, limit) in sorted(worst.items()):
        terminalreporter.write_line(f"{value:10.3g}  ≤ {limit:<8.3g} {name}")
