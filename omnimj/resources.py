"""Folders: shipped models and scenarios, in the package or in the checkout, and the user's cache."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def _folder(name: str) -> Path:
    inside = _PACKAGE / name
    # `omnimj/scenario` is a package, `scenarios` and `models` are data: the names never meet
    return inside if inside.is_dir() else _PACKAGE.parent / name


def models_folder() -> Path:
    """Folder of the shipped models (`uto_robot`, `quarter_rig`, `floors.toml`, …)."""
    return _folder("models")


def scenarios_folder() -> Path:
    """Folder of the shipped scenarios, one TOML file each."""
    return _folder("scenarios")


def model_display_name(file: Path) -> str:
    """Name of a machine for people: of a shipped one its folder's, of any other the model file's."""
    return file.parent.name if models_folder() in file.parents else file.name


def cache_root() -> Path | None:
    """Folder for caches: OMNIMJ_CACHE, or `omnimj` in the user's cache folder; None without a home."""
    chosen, caches = os.environ.get("OMNIMJ_CACHE"), os.environ.get("XDG_CACHE_HOME")
    if chosen:
        return Path(chosen)
    if caches:
        return Path(caches) / "omnimj"
    with contextlib.suppress(RuntimeError):
        return Path.home() / ".cache" / "omnimj"
    return None
