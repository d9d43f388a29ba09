"""Measured logs of real machines, unpacked from `tests/data`."""

from __future__ import annotations

import tarfile
from pathlib import Path

DATA = Path(__file__).parent / "data"


def unpack(name: str, folder: Path) -> Path:
    """Unpack an archive of `tests/data`; return its folder."""
    with tarfile.open(DATA / f"{name}.tar.xz") as archive:
        if hasattr(tarfile, "data_filter"):  # missing in Python before 3.11.4
            archive.extractall(folder, filter="data")
        else:
            archive.extractall(folder)
    return folder / name
