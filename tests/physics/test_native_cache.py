"""Compiled kernels on disk: read back by the next process, compiled anew where a file is damaged."""

from __future__ import annotations

import importlib.util
import sys

import pytest

from omnimj.physics import native

SOURCE = """
from numba import cfunc, float64
from omnimj.physics.native import cached, kernel

@kernel
def double(x):
    return 2.0 * x

@cached(cfunc, float64(float64))
def triple(x):
    return 3.0 * x
"""


@pytest.fixture
def load(monkeypatch, tmp_path):
    """Imports a fresh module with one kernel and one C callback, cached in `tmp_path / "cache"`."""
    (tmp_path / "cache").mkdir()
    (tmp_path / "two_kernels.py").write_text(SOURCE)
    monkeypatch.setattr(native, "cache_folder", lambda package: tmp_path / "cache")

    def fresh():
        spec = importlib.util.spec_from_file_location("two_kernels", tmp_path / "two_kernels.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "two_kernels", module)
        spec.loader.exec_module(module)
        return module

    return fresh


def test_a_kernel_is_compiled_once(load):
    assert load().double(2.0) == 4.0
    again = load()
    assert again.double(3.0) == 6.0
    assert sum(again.double.stats.cache_hits.values()) == 1


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("left", [0, 20])
def test_a_cut_off_cache_file_costs_a_compilation_and_no_run(load, tmp_path, kind, left):
    first = load()
    assert first.double(2.0) == 4.0
    damaged = list((tmp_path / "cache").rglob(f"*.{kind}"))
    assert len(damaged) == 2
    for file in damaged:
        file.write_bytes(file.read_bytes()[:left])
    for _ in range(2):  # the second time from the repaired cache
        found = load()
        assert found.double(5.0) == 10.0
        assert found.triple.ctypes(5.0) == 15.0
    assert sum(found.double.stats.cache_hits.values()) == 1
