"""Thresholds of the robust detector, and `thresholds.toml` as `omnimj calibrate` writes it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import positive, read_table, read_toml


class Thresholds(NamedTuple):
    """Values from which a suspicion becomes a decision.

    Those that `omnimj calibrate` sets are its results, rounded up, for 0.1 false alarms per hour in 2 h of
    healthy missions on natural stone, half of them on the twin, with payload and errors of all constants:
      omnimj evaluate --faults none --floor natural_stone --plant planar,twin --seed 11 --trials 120 --record
        --out out/stone
      omnimj calibrate out/stone/recordings --false-alarms-per-hour 0.1 --out thresholds.toml
    The others count blocks and times, and were set by hand on training seeds.
    """

    motor: float = 23.5
    """Λ of a loss of torque constant: ln(ARL · blocks per second · tests), and a margin for coloured noise
    [nats]."""
    drag: float = 23.5
    """Λ of an added friction or a held wheel [nats]."""
    accelerometer: float = 34.5
    """Λ of a jump of the accelerometer's bias [nats]."""
    worn: float = 0.03
    """Learnt loss of torque constant that no healthy motor has."""
    margin: float = 6.0
    """Lead of the best hypothesis over the next one on another wheel that makes it unambiguous [nats]."""
    slip: float = 0.00051
    """Way slipped beyond the allowed creep [m]."""
    settling: float = 0.06
    """Time that isolation may take after detection [s]."""
    bodily: float = 0.3
    """Time for which the accelerometer must be the best answer: a wheel that starts is not judged [s]."""
    current: int = 3
    """Blocks for which an amplifier gives another current than commanded."""
    stuck: int = 6
    """Blocks for which a wheel stands while the floor passes, or its motor should turn it."""
    released: int = 30
    """Blocks for which a wheel turns after it was diagnosed as standing."""
    odd: int = 30
    """Blocks for which no slip explains a wheel's speed."""
    turning: float = 0.02
    """Angle by which gyro and converter differ in a second [rad]."""
    other: float = 2.5
    """Factor on slip, learnt losses and accelerometer while another fault is active and makes them less
    certain."""
    healthy: float = 5.0
    """Λ of regained grip that withdraws a slip [nats]."""
    bias: float = 0.0
    """Jump of the accelerometer's bias up to which another floor explains it [m/s²]: the drag of a stated
    floor on the whole robot over its mass, since wheels may leave it."""


@dataclass(frozen=True)
class CalibratedThresholds:
    """Thresholds that recordings can calibrate; all others are as shipped."""

    motor: float = positive("nats")
    """Λ of a loss of torque constant."""
    drag: float = positive("nats")
    """Λ of an added friction."""
    accelerometer: float = positive("nats")
    """Λ of a jump of the accelerometer's bias."""
    slip: float = positive("m")
    """Way slipped beyond the allowed creep."""
    worn: float = positive("1", 1.0)
    """Learnt loss of torque constant."""


THRESHOLD_TABLES = ("thresholds", "calibration")
"""Tables of the file: values and their provenance."""
THRESHOLD_UNITS = {field.name: field.metadata["unit"] for field in dataclasses.fields(CalibratedThresholds)}
"""Calibrated thresholds and their units."""


def read_thresholds(path: Path) -> Thresholds:
    """Read a `thresholds.toml`; thresholds that are not in it are as shipped.

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
        if name not in THRESHOLD_TABLES:
            raise UnknownNameError(path, "key", name, THRESHOLD_TABLES)
    if "thresholds" not in tree:
        raise InputError(path, "[thresholds] is missing", "omnimj calibrate writes such a file")
    found = read_table(CalibratedThresholds, tree["thresholds"], lambda _: path, {}, "thresholds")
    return Thresholds()._replace(**dataclasses.asdict(found))
