"""When a suspicion becomes a decision, and what is decided: thresholds and verdict."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import positive, read_table, read_toml
from omnimj.signals import KINDS_OF_DIAGNOSIS, Diagnosis


@dataclass(frozen=True)
class Thresholds:
    """When a suspicion becomes a decision.

    Those that `omnimj calibrate` sets are what it found, rounded up, for 0.1 false alarms per hour in 2 h of
    healthy missions on natural stone, half of them on the twin, with payload and errors of all constants:
      omnimj evaluate --faults none --floor natural_stone --plant planar,twin --seed 11 --trials 120 --record
        --out out/stone
      omnimj calibrate out/stone/recordings --false-alarms-per-hour 0.1 --out thresholds.toml
    The others count blocks and times, and were set by hand on training seeds.
    """

    motor: float = 23.5
    """Λ of a loss of torque constant: ln(ARL · blocks per second · tests), and what is not white [nats]."""
    drag: float = 23.5
    """Λ of an added friction or a wheel that is held [nats]."""
    accelerometer: float = 34.5
    """Λ of a jump of the accelerometer's bias [nats]."""
    worn: float = 0.03
    """Learnt loss of torque constant that no healthy motor has."""
    margin: float = 6.0
    """By how much the best hypothesis must lead the next on another wheel to be alone [nats]."""
    slip: float = 0.00051
    """Way slipped beyond what is allowed [m]."""
    settling: float = 0.06
    """Time that isolation may take after detection [s]."""
    bodily: float = 0.3
    """Time for which the accelerometer must be the best answer: a wheel that starts is not judged [s]."""
    current: int = 3
    """Blocks for which an amplifier gives another current than asked for."""
    stuck: int = 6
    """Blocks for which a wheel stands while the floor passes, or its motor should turn it."""
    released: int = 30
    """Blocks for which a wheel turns that was said to stand."""
    odd: int = 30
    """Blocks for which a wheel's speed is one that no slip explains."""
    turning: float = 0.02
    """Angle by which gyro and converter part in a second [rad]."""
    other: float = 2.5
    """Factor on slip, learnt losses and accelerometer while another fault stands: less is sure of the robot
    then."""
    healthy: float = 5.0
    """Λ of grip that is back, which takes a slip back [nats]."""


@dataclass(frozen=True)
class Verdict:
    """What stands, and what is under suspicion."""

    diagnoses: tuple[Diagnosis, ...] = ()
    """Everything decided so far."""
    suspected: float = math.nan
    """Since when the force channel asks for an answer [s]; NaN: it does not."""
    renewed: int = 0
    """Wheel whose motor, known to be weak, was found to be another one in this block; 0: none."""

    def has_active(self) -> bool:
        """Whether anything is wrong."""
        return any(d.cleared is None for d in self.diagnoses)

    def standing(self, wheel: int, kinds: Collection[str] = KINDS_OF_DIAGNOSIS) -> Diagnosis | None:
        """The newest diagnosis of these kinds that stands on a wheel 1…n."""
        for diagnosis in reversed(self.diagnoses):
            if diagnosis.cleared is None and wheel in diagnosis.wheels and diagnosis.kind in kinds:
                return diagnosis
        return None

    def has_sensor_fault(self, channel: str) -> bool:
        """Whether a sensor channel is diagnosed."""
        return any(d.channel == channel and d.cleared is None for d in self.diagnoses)


def is_stalled(diagnosis: Diagnosis) -> bool:
    """Whether it says that a wheel stands, held or for want of a motor."""
    return diagnosis.kind == "motor" and diagnosis.ambiguous_with == (f"locked {diagnosis.wheels[0]}",)


def is_degraded(diagnosis: Diagnosis) -> bool:
    """Whether it says that a motor has lost some of its torque, and no more: its wheel may slip as well."""
    return diagnosis.kind == "motor" and not is_stalled(diagnosis)


def _can_coexist(one: Diagnosis, other: Diagnosis) -> bool:
    """Whether the first goes on to stand beside the other on the same wheel."""
    two_sensors = one.kind == other.kind == "sensor" and one.channel != other.channel
    return two_sensors or (is_degraded(one) and other.kind == "slip")


def with_diagnosis(verdict: Verdict, diagnosis: Diagnosis) -> Verdict:
    """One more; it takes the place of a lesser one on the same wheel, but a weak motor's wheel may slip."""
    known = verdict.standing(diagnosis.wheels[0], ("motor",)) if diagnosis.wheels else None
    if known is not None and diagnosis.kind == "motor" and not known.ambiguous_with:
        same = replace(known, effectiveness=diagnosis.effectiveness)
        told = tuple(same if d is known else d for d in verdict.diagnoses)
        return Verdict(told, math.nan, diagnosis.wheels[0])
    kept = [
        replace(d, cleared=diagnosis.time)
        if d.cleared is None and d.wheels == diagnosis.wheels != () and not _can_coexist(d, diagnosis)
        else d
        for d in verdict.diagnoses
    ]
    return replace(verdict, diagnoses=(*kept, diagnosis), suspected=math.nan)


# `thresholds.toml`: what `omnimj calibrate` found, as thresholds of the robust method.

THRESHOLD_TABLES = ("thresholds", "calibration")
"""What is used, and where it comes from."""


@dataclass(frozen=True)
class CalibratedThresholds:
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


THRESHOLD_UNITS = {field.name: field.metadata["unit"] for field in dataclasses.fields(CalibratedThresholds)}
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
        if name not in THRESHOLD_TABLES:
            raise UnknownNameError(path, "key", name, THRESHOLD_TABLES)
    if "thresholds" not in tree:
        raise InputError(path, "[thresholds] is missing", "omnimj calibrate writes such a file")
    found = read_table(CalibratedThresholds, tree["thresholds"], lambda _: path, {}, "thresholds")
    return dataclasses.replace(Thresholds(), **dataclasses.asdict(found))
