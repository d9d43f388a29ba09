"""Compiles kernels once and keeps them on disk, keyed to every source they are made from.

numba's own cache looks only at the file of the outermost function; here the folder's name carries a
fingerprint of all kernel sources and of the libraries, so that an edit anywhere makes a fresh folder.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import itertools
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba

_PACKAGE = Path(__file__).resolve().parent.parent
_ROOMS = ("physics", "plant", "twin", "control")
_GUEST_ROOMS = ("gap", "identification")  # only their files with kernels count; the rest changes often
_KEEP = 30 * 86400.0  # [s] folders of older versions go after a month


def _version(library: str) -> str:
    try:
        return importlib.metadata.version(library)
    except importlib.metadata.PackageNotFoundError:
        return "none"


@functools.cache
def fingerprint() -> str:
    """Sixteen hex digits over kernel sources and the versions of numba, llvmlite and MuJoCo."""
    digest = hashlib.sha256()
    for library in ("numba", "llvmlite", "mujoco"):
        digest.update(f"{library}={_version(library)};".encode())
    for room in _ROOMS:
        for source in sorted((_PACKAGE / room).glob("*.py")):
            digest.update(source.name.encode() + source.read_bytes())
    for room in _GUEST_ROOMS:
        for source in sorted((_PACKAGE / room).glob("*.py")):
            content = source.read_bytes()
            if b"@kernel" in content:
                digest.update(source.name.encode() + content)
    return digest.hexdigest()[:16]


def _own_roots() -> Iterator[Path]:
    """Where the user keeps caches."""
    chosen, caches = os.environ.get("OMNIMJ_CACHE"), os.environ.get("XDG_CACHE_HOME")
    if chosen:
        yield Path(chosen)
    elif caches:
        yield Path(caches) / "omnimj"
    else:
        with contextlib.suppress(RuntimeError):  # an account without a home
            yield Path.home() / ".cache" / "omnimj"


def _temporary_roots() -> Iterator[Path]:
    """A folder of the user's own, where everybody may write: to load a kernel is to run it."""
    user = os.getuid() if hasattr(os, "getuid") else None
    root = Path(tempfile.gettempdir()) / ("omnimj" if user is None else f"omnimj-{user}")
    with contextlib.suppress(OSError):
        root.mkdir(mode=0o700, exist_ok=True)
        if user is None or root.stat().st_uid == user:
            yield root


@functools.cache
def cache_folder() -> Path:
    """Folder of this version's compiled kernels; in the temporary folder where home is read-only."""
    for root in itertools.chain(_own_roots(), _temporary_roots()):
        folder = root / f"native-{fingerprint()}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            _forget_old(root, folder)
            return folder
    return Path(tempfile.mkdtemp(prefix="omnimj-native-"))


def _forget_old(root: Path, current: Path) -> None:
    for folder in root.glob("native-*"):
        with contextlib.suppress(OSError):  # another process may have been quicker
            if folder != current and time.time() - folder.stat().st_mtime > _KEEP:
                shutil.rmtree(folder, ignore_errors=True)


def cached(decorator: Callable[..., Any], *arguments: Any, **options: Any) -> Callable[[Callable], Any]:
    """Applies a numba decorator with its disk cache in `cache_folder()`."""

    def wrap(function: Callable) -> Any:
        before = numba.config.CACHE_DIR
        numba.config.CACHE_DIR = str(cache_folder())
        try:
            return decorator(*arguments, cache=True, **options)(function)
        finally:
            numba.config.CACHE_DIR = before

    return wrap


def kernel(function: Callable) -> Any:
    """`numba.njit` with the disk cache, without the GIL; division by zero gives infinity as in IEEE 754."""
    return cached(numba.njit, error_model="numpy", nogil=True)(function)


def is_compiled(plant: str) -> bool:
    """Whether every kernel that a run on this kind of plant calls is on disk, made by this version."""
    return (cache_folder() / f"complete-{plant}").exists()


def mark_compiled(plant: str) -> None:
    """Notes that a run on this kind of plant has compiled every kernel it calls."""
    with contextlib.suppress(OSError):  # a full disk: next time it is said again that code is compiled
        (cache_folder() / f"complete-{plant}").touch()
