"""What a run's diagnoses are worth against the truth: one rule for metrics and evaluation.

A fault stands from its onset until `GRACE` after its end. Only kinds that a diagnosis can name count
(`KINDS_OF_DIAGNOSIS`); payload, slope, misaligned axles, another wheel radius and lost demands are no faults
to be diagnosed: whatever is said about them is a false alarm.

A diagnosis is *right* when it names a fault that stands at its time, by kind and wheel:

- `motor` with a loss of at least `AS_GOOD_AS_FREE` and `free` count as alike, either way; a motor fault by
  braking torque is a `motor`.
- While all wheels slip, `slip` of any wheel is right; while each of them has a slip fault of its own,
  `all_wheel_slip` is.
- `sensor` faults are told apart by their channel.
- One that names several wheels is right when each of them has that fault.
- One with `ambiguous_with` is right when any of its answers is, but it isolates nothing.

Everything else is a false alarm: before any onset, of what has never happened, of what is long over.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from omnimj.signals import KINDS_OF_DIAGNOSIS

GRACE = 0.5
"""How long after its end a fault may still be named, and how long wrong names may stand in all [s]."""
AS_GOOD_AS_FREE = 0.95
"""Loss of torque constant from which a motor cannot be told from a free wheel."""

_Name = tuple[str, int | str | None]  # kind and the wheel or channel it sits on


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a run's diagnoses are worth."""

    detection_delay: float | None
    """From the first fault's onset to the first alarm, of whatever name, that is raised while a fault stands
    [s]; None without one."""
    isolated: bool | None
    """Whether every fault was named for itself and nothing else was, from the first onset on; wrong names
    that were taken back and stood for no longer than `GRACE`, all together, do not spoil it. None without a
    fault."""
    false_alarms: int
    """Diagnoses that are not right."""
    named: tuple[bool, ...] = ()
    """Of each fault that can be diagnosed, in the order given: whether it was named for itself."""


def judge_diagnoses(
    faults: Iterable[Mapping[str, Any]], diagnoses: Sequence[Mapping[str, Any]], wheels: int = 4
) -> Verdict:
    """Judges what was diagnosed against what was true.

    Args:
      faults: Records of `metrics.json`: kind, wheel, onset, end and the kind's own keys. One whose onset is
        None never happened.
      diagnoses: Records of `metrics.json`: time, kind, wheels, ambiguous_with, cleared, and channel for
        `sensor`.
      wheels: Number of wheels of the plant.
    """
    true = [fault for fault in faults if fault["kind"] in KINDS_OF_DIAGNOSIS and fault["onset"] is not None]
    right = [_is_right(diagnosis, true, wheels) for diagnosis in diagnoses]
    false_alarms = right.count(False)
    if not true:
        return Verdict(None, None, false_alarms)
    onset = min(fault["onset"] for fault in true)
    alarms = [said["time"] for said in diagnoses if any(_stands(fault, said["time"]) for fault in true)]
    named = tuple(
        any(ok and _names(said, fault, wheels) for said, ok in zip(diagnoses, right, strict=True))
        for fault in true
    )
    wrong = [
        _until(said) - said["time"]
        for said, ok in zip(diagnoses, right, strict=True)
        if not ok and said["time"] >= onset
    ]
    delay = float(min(alarms) - onset) if alarms else None
    return Verdict(delay, all(named) and sum(wrong) <= GRACE, false_alarms, named)


def _until(record: Mapping[str, Any], key: str = "cleared") -> float:
    end = record.get(key)
    return inf if end is None else end


def _stands(fault: Mapping[str, Any], time: float) -> bool:
    return fault["onset"] <= time <= _until(fault, "end") + GRACE


def _truth_at(faults: Sequence[Mapping[str, Any]], time: float, wheels: int) -> set[_Name]:
    """Every name that is right at that time."""
    names: set[_Name] = set()
    for fault in faults:
        if _stands(fault, time):
            names |= _names_of(fault, wheels)
    if all(("slip", wheel) in names for wheel in range(1, wheels + 1)):
        names.add(("all_wheel_slip", None))
    return names


def _names_of(fault: Mapping[str, Any], wheels: int) -> set[_Name]:
    """The names that are right for a fault."""
    kind, wheel = fault["kind"], fault["wheel"]
    if kind == "sensor":
        return {(kind, fault.get("channel"))}
    if kind == "all_wheel_slip":
        return {(kind, None), *(("slip", i) for i in range(1, wheels + 1))}
    if kind == "free" or (kind == "motor" and fault.get("loss", 0.0) >= AS_GOOD_AS_FREE):
        return {("free", wheel), ("motor", wheel)}
    return {(kind, wheel)}


def _said(diagnosis: Mapping[str, Any]) -> set[_Name]:
    """The names that a diagnosis gives all at once."""
    kind = diagnosis["kind"]
    if kind == "sensor":
        return {(kind, diagnosis.get("channel"))}
    if kind == "all_wheel_slip":
        return {(kind, None)}
    return {(kind, wheel) for wheel in diagnosis["wheels"]}


def _also(answer: str) -> _Name:
    """`motor 3` or `sensor yaw_rate` as a name; an answer without a place is the kind alone."""
    kind, _, place = answer.partition(" ")
    if not place:
        return kind, None
    return kind, int(place) if place.isdecimal() else place


def _is_right(diagnosis: Mapping[str, Any], faults: Sequence[Mapping[str, Any]], wheels: int) -> bool:
    true = _truth_at(faults, diagnosis["time"], wheels)
    said = _said(diagnosis)
    if said and said <= true:
        return True
    return any(_also(answer) in true for answer in diagnosis.get("ambiguous_with", ()))


def _names(diagnosis: Mapping[str, Any], fault: Mapping[str, Any], wheels: int) -> bool:
    """Whether a right diagnosis names this fault, and no other answer, while it stands.

    One that was made before and still stands names a fault of the same name that comes back.
    """
    if diagnosis.get("ambiguous_with"):
        return False
    if diagnosis["time"] > _until(fault, "end") + GRACE or _until(diagnosis) < fault["onset"]:
        return False
    said, own = _said(diagnosis), _names_of(fault, wheels)
    if fault["kind"] == "all_wheel_slip":
        return ("all_wheel_slip", None) in said or len(said) == wheels
    if ("all_wheel_slip", None) in said:
        return fault["kind"] == "slip"
    return bool(said & own)
