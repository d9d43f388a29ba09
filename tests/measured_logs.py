"""Measured logs of real machines, unpacked from `tests/data`."""

from __future__ import annotations

import tarfile
from pathlib import Path

DATA = Path(__file__).parent / "data"


def unpack(name: str, folder: Path) -> Path:
    """Unpack an archive of `tests/data`; return its folder."""
    with tarfile.open(DATA / f"{name}.tar.xz") as archive:
        # Python 3.11 has filters since 3.11.4, later versions warn without one
        archive.extractall(folder, **({"filter": "data"} if hasattr(tarfile, "data_filter") else {}))
    return folder / name
