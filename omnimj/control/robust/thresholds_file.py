"""`thresholds.toml`: what `omnimj calibrate` found, as thresholds of the robust method."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from omnimj.control.robust.verdict import Thresholds
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import positive, read_table
from omnimj.parameters.toml_file import read_toml

TABLES = ("thresholds", "calibration")
"""What is used, and where it comes from."""


@dataclass(frozen=True)
class Calibrated:
    """The thresholds that recordings can tell; all others are as shipped."""

    motor: float = positive("nats")
    """Λ of a loss of torque constant."""
    drag: float = positive("nats")
    """Λ of an added friction."""
    accelerometer: float = positive("nats")
    """Λ of a jump of the accelerometer's bias."""
    slip: float = positive("m")
    """Way slipped beyond what is allowed."""
    worn: float = positive("1", 1.0)
    """Learnt loss of torque constant."""


UNITS = {field.name: field.metadata["unit"] for field in dataclasses.fields(Calibrated)}
"""Calibrated thresholds and their units."""


def read_thresholds(path: Path) -> Thresholds:
    """Reads a `thresholds.toml`; what is not in it is as shipped.

    Raises:
      InputError: The file cannot be read, a threshold is missing or breaks its rule.
      UnknownNameError: A table or key that does not exist.
    """
    tree = read_toml(path)
    if "printed" in tree or "repaired" in tree:
        raise InputError(
            path, "holds thresholds of the published method", "those of the robust one are needed"
        )
    for name in tree:
        if name not in TABLES:
            raise UnknownNameError(path, "key", name, TABLES)
    if "thresholds" not in tree:
        raise InputError(path, "[thresholds] is missing", "omnimj calibrate writes such a file")
    found = read_table(Calibrated, tree["thresholds"], lambda _: path, {}, "thresholds")
    return dataclasses.replace(Thresholds(), **dataclasses.asdict(found))
