"""Just-in-time compilation of kernels with a cache on disk, keyed by every source they are compiled from.

numba's own cache checks only the file of the outermost function. Here the name of the cache folder carries a
fingerprint of the libraries and of all sources that the kernels of a package may call, so that an edit leads
to a fresh folder for its own package and for those above it. A damaged cache file costs a compilation only.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import hashlib
import importlib.metadata
import itertools
import logging
import os
import pickle
import shutil
import struct
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba
import numba.core.event
import numba.extending
from numba.core import cgutils, types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.errors import RequireLiteralValue
from numba.core.sigutils import normalize_signature

from omnimj.physics.compilation import quick_compilation
from omnimj.physics.machine_code import deferred_translation
from omnimj.resources import cache_root

_intrinsic: Any = numba.extending.intrinsic  # hides the signatures from type checkers


@_intrinsic
def first_numbers(typingctx, row, count):
    """`first_numbers(row, n)`: the first n numbers of a row as a tuple, inside kernels; n is a constant.

    numba's own `to_fixed_tuple` takes 200 ns for 26 numbers, this as long as they take to load.
    """
    _require_constant(count)

    def codegen(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, value=arguments[0])
        (along,) = cgutils.unpack_tuple(builder, array.strides, 1)
        return _numbers_at(context, builder, signature, array.data, along)

    return types.UniTuple(row.dtype, count.literal_value)(row, count), codegen


@_intrinsic
def row_numbers(typingctx, rows, i, count):
    """`row_numbers(rows, i, n)`: the first n numbers of row i as a tuple, inside kernels; n is a constant.

    Unlike `first_numbers(rows[i], n)` it makes no view of the row, which would have to be counted.
    """
    _require_constant(count)

    def codegen(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, value=arguments[0])
        down, along = cgutils.unpack_tuple(builder, array.strides, 2)
        place = context.cast(builder, arguments[1], signature.args[1], types.intp)
        first = cgutils.pointer_add(builder, array.data, builder.mul(place, down))
        return _numbers_at(context, builder, signature, first, along)

    return types.UniTuple(rows.dtype, count.literal_value)(rows, i, count), codegen


def _require_constant(count: Any) -> None:
    if not isinstance(count, types.IntegerLiteral):
        raise RequireLiteralValue("the number of numbers must be a constant")


def _numbers_at(context, builder, signature, first, stride):
    """Code that loads a tuple of numbers, the first one at an address, the others `stride` bytes apart."""
    values = [
        builder.load(cgutils.pointer_add(builder, first, builder.mul(stride.type(k), stride)))
        for k in range(signature.return_type.count)
    ]
    return context.make_tuple(builder, signature.return_type, values)


_PACKAGE = Path(__file__).resolve().parent.parent
_EQUATIONS = ("parameters/floor.py", "physics")  # every kernel may call these
# package → packages and files whose kernels and constants its kernels may use, as the import order allows
_CALLED_PACKAGES = {
    "physics": _EQUATIONS,
    "plant": (*_EQUATIONS, "plant"),
    "control": (*_EQUATIONS, "control"),
    "simulate": (*_EQUATIONS, "plant", "control", "simulate"),
    "estimate": (*_EQUATIONS, "plant", "control", "estimate"),
    "learning": (*_EQUATIONS, "plant", "control", "simulate", "learning"),
}
# of these packages only files with kernels count; the others change often
_GUEST_PACKAGES = ("simulate", "estimate", "learning")
_DEFAULT_PACKAGE = "estimate"  # of kernels elsewhere, as in tests, which may call any of them
KERNEL_PACKAGES = tuple(_CALLED_PACKAGES)
_DAMAGED = (
    *(EOFError, pickle.UnpicklingError, ValueError, KeyError, IndexError, AttributeError, RuntimeError),
    *(TypeError, OverflowError, MemoryError, ImportError, AssertionError, struct.error),
)
"""Raised by cache files that were cut off or overwritten, or whose content is something else."""
_LOGGER = logging.getLogger("omnimj.native")
# no kernel is passed to another as a value, which is what the C wrapper would be for
_OPTIONS = {"error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
_OPTIMIZATION = 1  # level of LLVM's passes; the user's own kernels keep theirs
_COLLECTION = (100_000, 50, 100)  # of Python's garbage collection during compilation
_NO_ENTRY = "no_cpython_wrapper"  # numba's name of the option to leave out what Python calls
_DECORATION = threading.RLock()  # the cache's folder is a global of numba
_KEEP = 30 * 86400.0  # [s] folders of older versions go after a month


def _version(library: str) -> str:
    try:
        return importlib.metadata.version(library)
    except importlib.metadata.PackageNotFoundError:
        return "none"


@functools.cache
def fingerprint(package: str) -> str:
    """Return 16 hexadecimal digits of a hash over the kernel sources of a package and the library versions.

    Args:
      package: One of `KERNEL_PACKAGES`.
    """
    digest = hashlib.sha256()
    for library in ("numba", "llvmlite", "mujoco"):
        digest.update(f"{library}={_version(library)};".encode())
    for below in _CALLED_PACKAGES[package]:
        path = _PACKAGE / below
        for source in [path] if path.is_file() else sorted(path.rglob("*.py")):
            content = source.read_bytes()
            if below not in _GUEST_PACKAGES or b"@kernel" in content:
                digest.update(source.relative_to(_PACKAGE).as_posix().encode() + content)
    return digest.hexdigest()[:16]


def _temporary_roots() -> Iterator[Path]:
    """Folder below the shared temporary one that only this user can write, since loading a kernel runs it."""
    user = os.getuid() if hasattr(os, "getuid") else None
    root = Path(tempfile.gettempdir()) / ("omnimj" if user is None else f"omnimj-{user}")
    with contextlib.suppress(OSError):
        root.mkdir(mode=0o700, exist_ok=True)
        if user is None or root.stat().st_uid == user:
            yield root


@functools.cache
def cache_folder(package: str) -> Path:
    """Folder of a package's compiled kernels; below the temporary folder where home is read-only."""
    own = cache_root()
    for root in itertools.chain(() if own is None else (own,), _temporary_roots()):
        folder = root / f"native-{package}-{fingerprint(package)}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            _remove_old_caches(root)
            return folder
    return Path(tempfile.mkdtemp(prefix="omnimj-native-"))


def _remove_old_caches(root: Path) -> None:
    current = {f"native-{package}-{fingerprint(package)}" for package in KERNEL_PACKAGES}
    for folder in root.glob("native-*"):
        with contextlib.suppress(OSError):  # another process may have been quicker
            if folder.name not in current and time.time() - folder.stat().st_mtime > _KEEP:
                shutil.rmtree(folder, ignore_errors=True)


def cached(decorator: Callable[..., Any], *arguments: Any, **options: Any) -> Callable[[Callable], Any]:
    """Apply a numba decorator with its disk cache in the folder of the function's package.

    Args:
      decorator: `numba.njit` or `numba.cfunc`.
      arguments: Positional arguments of the decorator.
      options: Keyword arguments of the decorator.
    """

    def wrap(function: Callable) -> Any:
        folder = cache_folder(_package_of(function))
        with _DECORATION:
            before = numba.config.CACHE_DIR
            numba.config.CACHE_DIR = str(folder)
            try:
                with deferred_translation():
                    compiled = decorator(*arguments, cache=True, **options)(function)
            except _DAMAGED:  # a C callback is loaded right here, a kernel at its first call
                _report_damage(function.__qualname__)
                _remove_files(folder, function)
                with deferred_translation():
                    compiled = decorator(*arguments, cache=True, **options)(function)
            except OSError as error:
                _report_no_cache(folder, error)
                compiled = decorator(*arguments, **options)(function)
            finally:
                numba.config.CACHE_DIR = before
        _survive_cache(compiled, folder)
        _optimize_lightly(compiled)
        _enter_on_demand(compiled)
        return compiled

    return wrap


def _report_damage(name: str) -> None:
    _LOGGER.warning("compiling %s again: its file in the cache is damaged", name)


def _remove_files(folder: Path, function: Callable) -> None:
    for file in folder.rglob(f"{Path(function.__code__.co_filename).stem}.{function.__qualname__}-*.nb?"):
        file.unlink(missing_ok=True)


def _survive_cache(compiled: Any, folder: Path) -> None:
    """Recompile a kernel whose cache files are damaged, and go on where the disk takes none."""
    cache = compiled._cache
    if not hasattr(cache, "load_overload"):  # compilation is switched off
        return
    load, save = cache.load_overload, cache.save_overload

    def load_or_forget(*arguments: Any) -> Any:
        try:
            return load(*arguments)
        except _DAMAGED:
            _report_damage(compiled.py_func.__qualname__)
            cache.flush()
            return None

    def save_if_possible(*arguments: Any) -> None:
        try:
            save(*arguments)
        except OSError as error:
            _report_no_cache(folder, error)

    cache.load_overload, cache.save_overload = load_or_forget, save_if_possible


@functools.cache
def _warn(message: str) -> None:
    """Log a message once."""
    _LOGGER.warning(message)


def _report_no_cache(folder: Path, error: OSError) -> None:
    _warn(f"compiled code cannot be kept in {folder}: {error.strerror or error}")


def _optimize_lightly(compiled: Any) -> None:
    """Compile with a low level of optimization: a fifth less compilation, and these kernels run as fast."""
    compiler = getattr(compiled, "_compiler", None)
    if compiler is None:  # a C callback, or compilation is switched off
        return
    compile_types = compiler.compile

    def compile_lightly(*arguments: Any) -> Any:
        before = numba.config.OPT
        numba.config.OPT = type(before)(min(before, _OPTIMIZATION))
        try:
            with _collecting_rarely(), quick_compilation(), deferred_translation():
                return compile_types(*arguments)
        finally:
            numba.config.OPT = before

    compiler.compile = compile_lightly


@contextlib.contextmanager
def _collecting_rarely() -> Iterator[None]:
    """Look for garbage seldom: compilation makes millions of objects, and most of them stay until it ends."""
    before = gc.get_threshold()
    gc.set_threshold(*(max(own, least) for own, least in zip(before, _COLLECTION, strict=True)))
    try:
        yield
    finally:
        gc.set_threshold(*before)


def _enter_on_demand(compiled: Any) -> None:
    """Compile the entry for calls from Python only where there are any: other kernels call without it.

    Unpacking its arguments is a fifth of a kernel's code, and most kernels are called by kernels only.
    """
    if not hasattr(compiled, "get_call_template"):  # a C callback, or compilation is switched off
        return
    options = compiled.targetoptions
    call_template, compile_types, add = compiled.get_call_template, compiled.compile, compiled.add_overload
    load = compiled._cache.load_overload

    def has_entry(result: Any) -> bool:
        return result.library.get_pointer_to_function(result.fndesc.llvm_cpython_wrapper_name) != 0

    def template_for_kernels(*arguments: Any) -> Any:
        with global_compiler_lock:
            before = options.get(_NO_ENTRY, False)
            options[_NO_ENTRY] = True
            try:
                return call_template(*arguments)
            finally:
                options[_NO_ENTRY] = before

    def compile_for_caller(signature: Any) -> Any:
        with global_compiler_lock:
            types_of_arguments, _ = normalize_signature(signature)
            found = compiled.overloads.get(tuple(types_of_arguments))
            if found is not None and not options.get(_NO_ENTRY, False) and not has_entry(found):
                del compiled.overloads[tuple(types_of_arguments)]
            return compile_types(signature)

    def load_for_caller(*arguments: Any) -> Any:
        with deferred_translation():
            found = load(*arguments)
        usable = found is None or options.get(_NO_ENTRY, False) or has_entry(found)
        return found if usable else None

    def add_with_entry(result: Any) -> None:
        if has_entry(result):
            add(result)
        else:
            compiled.overloads[tuple(result.signature.args)] = result

    compiled.get_call_template, compiled.compile = template_for_kernels, compile_for_caller
    compiled.add_overload, compiled._cache.load_overload = add_with_entry, load_for_caller


def _package_of(function: Callable) -> str:
    root, _, path = function.__module__.partition(".")
    package = path.partition(".")[0]
    return package if root == "omnimj" and package in _CALLED_PACKAGES else _DEFAULT_PACKAGE


def kernel(function: Callable) -> Any:
    """`numba.njit` with the disk cache, without the GIL; division by zero gives infinity as in IEEE 754."""
    return cached(numba.njit, **_OPTIONS)(function)


def inlined(function: Callable) -> Any:
    """As `kernel`, but inlined into its callers, so that large records are not passed by value."""
    return cached(numba.njit, **_OPTIONS, inline="always")(function)


class _CompilationCounter(numba.core.event.Listener):
    """Counts the functions that numba compiles."""

    def __init__(self) -> None:
        self.count, self.report = 0, None

    def on_start(self, event: Any) -> None:
        """Report one more function."""
        self.count += 1
        if self.report is not None:
            self.report(self.count)

    def on_end(self, event: Any) -> None:
        """Do nothing: a function counts when it begins."""


_COUNTER = _CompilationCounter()


def on_compilation(report: Callable[[int], None] | None) -> None:
    """Call a function with the number of compiled functions whenever there is one more; None ends it."""
    if report is not None and _COUNTER.report is None:
        numba.core.event.register("numba:compile", _COUNTER)
    elif report is None and _COUNTER.report is not None:
        numba.core.event.unregister("numba:compile", _COUNTER)
    _COUNTER.report = report


def _completion_marker(plant: str) -> Path:
    """File that marks every kernel of a plant as compiled, by this installation on this kind of processor.

    Its name holds what numba's cache depends on: sources with their places and times, Python, processor.
    """
    everything = [fingerprint(package) for package in KERNEL_PACKAGES]
    everything += [str(_PACKAGE), str(Path(__file__).stat().st_mtime_ns), sys.implementation.cache_tag]
    everything += [llvmlite.binding.get_host_cpu_name()]
    name = hashlib.sha256("|".join(everything).encode()).hexdigest()[:16]
    return cache_folder(_DEFAULT_PACKAGE) / f"complete-{plant}-{name}"


def is_compiled(plant: str) -> bool:
    """Return whether this version has every kernel on disk that a run on this kind of plant calls."""
    return _completion_marker(plant).exists()


def mark_compiled(plant: str) -> None:
    """Record that a run on this kind of plant has compiled every kernel it calls."""
    with contextlib.suppress(OSError):  # a full disk: the next run announces a compilation once more
        _completion_marker(plant).touch()
