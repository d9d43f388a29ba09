"""Measured logs of real machines, unpacked from `tests/data`."""

from __future__ import annotations

import tarfile
from pathlib import Path

DATA = Path(__file__).parent / "data"


def unpack(name: str, folder: Path) -> Path:
    """Unpack an archive of `tests/data`; return its folder."""
    with tarfile.open(DATA / f"{name}.tar.xz") as archive:
        archive.extractall(folder, filter="data")
    return folder / name
