"""Compiled kernels on disk: read back by the next process, compiled anew where a file is damaged."""

from __future__ import annotations

import gc
import importlib.util
import subprocess
import sys

import numpy as np
import pytest

from omnimj.physics import native

SOURCE = """
from numba import cfunc, float64
from omnimj.physics.native import cached, kernel

@kernel
def double(x):
    return 2.0 * x

@kernel
def quadruple(x):
    return 2.0 * double(x)

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


def test_a_kernel_that_only_another_one_called_can_be_called_from_python(load):
    first = load()
    assert first.quadruple(2.0) == 8.0  # here `double` is compiled, without an entry from Python
    again = load()
    for found in (again, first):
        assert found.double(3.0) == 6.0 and found.quadruple(3.0) == 12.0
    assert sum(again.double.stats.cache_hits.values()) == 0
    last = load()
    assert last.double(1.5) == 3.0 and last.quadruple(1.5) == 6.0
    assert sum(last.double.stats.cache_hits.values()) == 1


def test_garbage_is_collected_after_a_compilation_as_often_as_before(load):
    before = gc.get_threshold()
    assert load().double(2.0) == 4.0
    assert gc.get_threshold() == before


@pytest.mark.slow
def test_processes_that_compile_at_the_same_time_leave_a_sound_cache(load, tmp_path):
    words = "import importlib, sys; from omnimj.physics import native; from pathlib import Path; "
    words += f"native.cache_folder = lambda package: Path({str(tmp_path / 'cache')!r}); "
    words += f"sys.path.insert(0, {str(tmp_path)!r}); import two_kernels as m; print(m.double(2.5))"
    running = [subprocess.Popen([sys.executable, "-c", words], stdout=subprocess.PIPE) for _ in range(3)]
    assert [process.communicate()[0] for process in running] == [b"5.0\n"] * 3
    found = load()
    assert found.double(5.0) == 10.0 and found.triple.ctypes(5.0) == 15.0
    assert sum(found.double.stats.cache_hits.values()) == 1


def test_compiled_functions_are_counted_until_nobody_listens(load):
    counts: list[int] = []
    native.on_compilation(counts.append)
    try:
        assert load().double(2.0) == 4.0
    finally:
        native.on_compilation(None)
    heard = len(counts)
    assert heard >= 1 and np.all(np.diff(counts) == 1)
    assert load().double(2) == 4  # another type: compiled anew
    assert len(counts) == heard


@pytest.mark.parametrize("what", ["processor", "place"])
def test_another_environment_has_not_compiled_what_this_one_has(monkeypatch, tmp_path, what):
    monkeypatch.setattr(native, "cache_folder", lambda package: tmp_path)
    native.mark_compiled("twin-uto_robot")
    assert native.is_compiled("twin-uto_robot")
    if what == "processor":
        monkeypatch.setattr("llvmlite.binding.get_host_cpu_name", lambda: "another")
    else:
        monkeypatch.setattr(native, "_PACKAGE", tmp_path)
        monkeypatch.setattr(native, "fingerprint", lambda package: "alike")
    assert not native.is_compiled("twin-uto_robot")
