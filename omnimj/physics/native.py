"""Compiles kernels once and keeps them on disk, keyed to every source they are made from.

numba's own cache looks only at the file of the outermost function; here the folder's name carries a
fingerprint of the libraries and of all sources that a room's kernels may call, so that an edit makes a fresh
folder for its own room and for those above it.
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
# room → rooms whose kernels and constants its kernels may use, as the import order has it
_CALLED_ROOMS = {
    "physics": ("physics",),
    "plant": ("physics", "plant"),
    "control": ("physics", "control"),
    "link": ("physics", "link"),
    "estimate": ("physics", "plant", "control", "estimate"),
}
# of these only files with kernels count; the rest changes often
_GUEST_ROOMS = ("estimate", "link")
_DEFAULT_ROOM = "estimate"  # a kernel from outside the rooms, such as one of a test, may call any
ROOMS = tuple(_CALLED_ROOMS)
_KEEP = 30 * 86400.0  # [s] folders of older versions go after a month


def _version(library: str) -> str:
    try:
        return importlib.metadata.version(library)
    except importlib.metadata.PackageNotFoundError:
        return "none"


@functools.cache
def fingerprint(room: str) -> str:
    """Sixteen hex digits over what a room's kernels are made from, and the versions of the libraries."""
    digest = hashlib.sha256()
    for library in ("numba", "llvmlite", "mujoco"):
        digest.update(f"{library}={_version(library)};".encode())
    for below in _CALLED_ROOMS[room]:
        for source in sorted((_PACKAGE / below).rglob("*.py")):
            content = source.read_bytes()
            if below not in _GUEST_ROOMS or b"@kernel" in content:
                digest.update(source.relative_to(_PACKAGE).as_posix().encode() + content)
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
def cache_folder(room: str) -> Path:
    """Folder of a room's compiled kernels; in the temporary folder where home is read-only."""
    for root in itertools.chain(_own_roots(), _temporary_roots()):
        folder = root / f"native-{room}-{fingerprint(room)}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            _remove_old_caches(root)
            return folder
    return Path(tempfile.mkdtemp(prefix="omnimj-native-"))


def _remove_old_caches(root: Path) -> None:
    current = {f"native-{room}-{fingerprint(room)}" for room in ROOMS}
    for folder in root.glob("native-*"):
        with contextlib.suppress(OSError):  # another process may have been quicker
            if folder.name not in current and time.time() - folder.stat().st_mtime > _KEEP:
                shutil.rmtree(folder, ignore_errors=True)


def cached(decorator: Callable[..., Any], *arguments: Any, **options: Any) -> Callable[[Callable], Any]:
    """Applies a numba decorator with its disk cache in the folder of the function's room."""

    def wrap(function: Callable) -> Any:
        before = numba.config.CACHE_DIR
        numba.config.CACHE_DIR = str(cache_folder(_room(function)))
        try:
            return decorator(*arguments, cache=True, **options)(function)
        finally:
            numba.config.CACHE_DIR = before

    return wrap


def _room(function: Callable) -> str:
    parts = function.__module__.split(".")
    return (
        parts[1] if parts[0] == "omnimj" and len(parts) > 1 and parts[1] in _CALLED_ROOMS else _DEFAULT_ROOM
    )


def kernel(function: Callable) -> Any:
    """`numba.njit` with the disk cache, without the GIL; division by zero gives infinity as in IEEE 754."""
    return cached(numba.njit, error_model="numpy", nogil=True)(function)


def _completion_marker(plant: str) -> Path:
    """Where it is noted that everything for a plant is compiled: any edit makes it another file."""
    everything = "".join(fingerprint(room) for room in ROOMS)
    return (
        cache_folder(_DEFAULT_ROOM)
        / f"complete-{plant}-{hashlib.sha256(everything.encode()).hexdigest()[:16]}"
    )


def is_compiled(plant: str) -> bool:
    """Whether every kernel that a run on this kind of plant calls is on disk, made by this version."""
    return _completion_marker(plant).exists()


def mark_compiled(plant: str) -> None:
    """Notes that a run on this kind of plant has compiled every kernel it calls."""
    with contextlib.suppress(OSError):  # a full disk: next time it is said again that code is compiled
        _completion_marker(plant).touch()
