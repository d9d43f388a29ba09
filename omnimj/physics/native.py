"""Compiles kernels once and keeps them on disk, keyed to every source they are made from.

numba's own cache looks only at the file of the outermost function; here the folder's name carries a
fingerprint of all kernel sources and of the libraries, so that an edit anywhere makes a fresh folder.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

_PACKAGE = Path(__file__).resolve().parent.parent
_ROOMS = ("physics", "plant", "twin", "control")
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
    return digest.hexdigest()[:16]


def _home() -> Path:
    chosen = os.environ.get("OMNIMJ_CACHE")
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "omnimj"


@functools.cache
def cache_folder() -> Path:
    """Folder of this version's compiled kernels; in the temporary folder where home is read-only."""
    for root in (_home(), Path(tempfile.gettempdir()) / "omnimj"):
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
    """`numba.njit` with the disk cache; division by zero gives infinity as in IEEE 754."""
    return cached(numba.njit, error_model="numpy")(function)


def is_compiled() -> bool:
    """Whether a complete set of this version's kernels is on disk."""
    return (cache_folder() / "complete").exists()


def mark_compiled() -> None:
    """Notes that every kernel has been compiled once."""
    (cache_folder() / "complete").touch()
