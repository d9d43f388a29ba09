"""Machine code is made for what is called from outside, and does what it would do if it were made for all."""

from __future__ import annotations

import subprocess
import sys

import numba
import numpy as np
import pytest
from numba.core.codegen import JITCodeLibrary
from numba.core.runtime import _nrt_python

from omnimj.physics import machine_code

SOURCE = """
from typing import Any, NamedTuple
import numba
import numpy as np
from numba import types
from omnimj.physics.native import cached, kernel

class Pair(NamedTuple):
    left: Any
    right: Any
    number: float

@kernel
def root(x):
    if x < 0.0:
        raise ValueError("found", x)
    return x**0.5

@kernel
def pair_of(x, n):
    return Pair(np.full(n, root(x)), np.arange(n) * x, x)

@kernel
def product(pair):
    return np.dot(pair.left, pair.right) / pair.number

@cached(numba.cfunc, types.float64(types.float64))
def half_root(x):
    return root(x) / 2.0

@kernel
def total(x, n):
    found = 0.0
    for k in range(3):
        found += product(pair_of(x, n)) + root(x + k)
    return found
"""
START = """
import sys
from pathlib import Path
from omnimj.physics import machine_code, native
native.cache_folder = lambda package: Path(sys.argv[1]) / "cache"
sys.path.insert(0, sys.argv[1])
"""
CALLS = """
import numbers_of_pairs as m
print(repr(m.total(2.0, 4)), repr(m.product(m.pair_of(2.0, 4))))
try:
    m.total(-3.0, 4)
except ValueError as error:
    print(error.args)
"""

TRANSLATIONS = """
translate = machine_code.DeferredLibrary._translate
machine_code.DeferredLibrary._translate = lambda *found: (print("translated"), translate(*found))
import numbers_of_pairs as m
print(m.half_root.ctypes(9.0))
"""


def run(words, folder):
    """Output of another process that imports the kernels of a folder."""
    command = [sys.executable, "-c", START + words, str(folder)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def expected(x, n):
    """`total` of the module without compilation."""
    pair = np.full(n, x**0.5) @ (np.arange(n) * x) / x
    return sum(pair + (x + k) ** 0.5 for k in range(3))


def translated(kernel):
    """Whether each compiled form of a kernel is machine code."""
    return [not found.library._deferred for found in kernel.overloads.values()]


@pytest.fixture
def load(monkeypatch, tmp_path):
    """Imports the module of the kernels anew, cached in `tmp_path / "cache"`."""
    (tmp_path / "cache").mkdir()
    (tmp_path / "numbers_of_pairs.py").write_text(SOURCE)
    monkeypatch.setattr("omnimj.physics.native.cache_folder", lambda package: tmp_path / "cache")
    monkeypatch.syspath_prepend(str(tmp_path))

    def fresh():
        sys.modules.pop("numbers_of_pairs", None)
        return __import__("numbers_of_pairs")

    yield fresh
    sys.modules.pop("numbers_of_pairs", None)


@pytest.mark.slow
def test_only_what_python_calls_is_machine_code(load):
    module = load()
    assert module.total(2.0, 4) == pytest.approx(expected(2.0, 4), rel=1e-14)
    assert translated(module.total) == [True]
    for inner in (module.root, module.pair_of, module.product):
        assert translated(inner) == [False]
    assert module.root(9.0) == 3.0
    assert translated(module.root) == [True] and translated(module.product) == [False]


@pytest.mark.slow
def test_a_kernel_read_from_the_cache_is_linked_into_the_next_one_that_calls_it(load):
    load().total(2.0, 4)
    again = load()

    @numba.njit
    def twice(x, n):
        return 2.0 * again.total(x, n) + again.root(x)

    assert twice(2.0, 4) == pytest.approx(2.0 * expected(2.0, 4) + 2.0**0.5, rel=1e-14)
    pair = again.pair_of(2.0, 4)
    assert pair.right.tolist() == [0.0, 2.0, 4.0, 6.0] and again.product(pair) == pytest.approx(
        6.0 * 2.0**0.5
    )


@pytest.mark.slow
def test_an_error_below_the_called_kernel_arrives_with_its_arguments_also_from_the_cache(load):
    for _ in range(2):
        with pytest.raises(ValueError) as caught:
            load().total(-3.0, 4)
        assert caught.value.args == ("found", -3.0)


@pytest.fixture
def allocations():
    """Numbers of arrays that kernels have made and freed until now."""
    _nrt_python.memsys_enable_stats()
    yield lambda: (_nrt_python.memsys_get_stats_mi_alloc(), _nrt_python.memsys_get_stats_mi_free())
    _nrt_python.memsys_disable_stats()


@pytest.mark.slow
def test_arrays_inside_of_records_are_freed(load, allocations):
    module = load()
    module.total(2.0, 1000)
    module.pair_of(2.0, 1000)
    made, freed = allocations()
    for _ in range(5):
        module.total(2.0, 1000)
        kept = module.pair_of(2.0, 1000)
    del kept
    assert allocations()[0] - made >= 5 * 4 * 2
    assert allocations()[0] - made == allocations()[1] - freed


@pytest.mark.slow
def test_another_process_finds_the_same_numbers_and_errors_in_the_cache(load, tmp_path):
    here = load()
    numbers = f"{here.total(2.0, 4)!r} {here.product(here.pair_of(2.0, 4))!r}"
    assert run(CALLS, tmp_path).splitlines() == [numbers, "('found', -3.0)"]


@pytest.mark.slow
def test_a_callback_of_c_is_translated_once_and_then_read_from_the_cache(load, tmp_path):
    said = [run(TRANSLATIONS, tmp_path) for _ in range(2)]
    assert said == ["translated\n1.5\n", "1.5\n"]


def test_a_numba_that_lacks_a_part_is_left_alone(monkeypatch):
    assert machine_code._is_known()
    monkeypatch.delattr(JITCodeLibrary, "get_pointer_to_function")
    assert not machine_code._is_known()


def test_kernels_of_others_are_translated_as_ever(load):
    load().total(2.0, 4)

    @numba.njit
    def theirs(x):
        return x + 1.0

    assert theirs(2.0) == 3.0
    (found,) = theirs.overloads.values()
    assert not hasattr(found.library, "_deferred")
