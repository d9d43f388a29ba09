"""Assessment of a run's diagnoses against the true faults: one rule for metrics and evaluation.

A fault is active from its onset until `GRACE` after its end. Only kinds that a diagnosis can name count
(`KINDS_OF_DIAGNOSIS`); payload, slope, misaligned axles, a different wheel radius and lost demands are not
diagnosable, so that any diagnosis of them is a false alarm.

A diagnosis is *correct* when it names a fault that is active at its time, by kind and wheel:

- `free`, and `motor` with a loss of at least `FREE_EQUIVALENT_LOSS`, are equivalent; a motor fault by braking
  torque is a `motor`.
- While all wheels slip, `slip` of any wheel is correct; while each of them has a slip fault of its own,
  `all_wheel_slip` is correct.
- `sensor` faults are distinguished by their channel.
- A diagnosis of several wheels is correct when each of them has that fault.
- A diagnosis with `ambiguous_with` is correct when any of its alternatives is, but it isolates nothing.

Everything else is a false alarm: before any onset, of a fault that never occurred, or of one long over.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from omnimj.plant.ground import Patch
from omnimj.signals import KINDS_OF_DIAGNOSIS, Array, Trace, equal_stretches

GRACE = 0.5
"""Time after the end of a fault in which it may still be named, and total time for which wrong diagnoses
are tolerated [s]."""
FREE_EQUIVALENT_LOSS = 0.95
"""Relative loss of torque constant above which a motor is indistinguishable from a free wheel."""

Record = Mapping[str, Any]
"""A fault or a diagnosis as `metrics.json` holds it."""

_Label = tuple[str, int | str | None]  # kind, and wheel or channel


@dataclass(frozen=True, slots=True)
class DiagnosisScore:
    """Score of a run's diagnoses."""

    detection_delay: float | None
    """Time from the first fault's onset to the first alarm of any kind while a fault is active [s]; None
    without one."""
    isolated: bool | None
    """True if every fault was named individually and nothing else was, from the first onset on; wrong
    diagnoses are tolerated for a total time of `GRACE`. None without a fault."""
    false_alarms: int
    """Number of diagnoses that are not correct."""
    named: tuple[bool, ...] = ()
    """For each diagnosable fault, in the order given, whether it was named individually."""


def judge_diagnoses(faults: Iterable[Record], diagnoses: Sequence[Record], wheels: int = 4) -> DiagnosisScore:
    """Score diagnoses against the true faults.

    Args:
      faults: Records of `metrics.json`: kind, wheel, onset, end and the kind's own keys; one whose onset is
        None never occurred.
      diagnoses: Records of `metrics.json`: time, kind, wheels, ambiguous_with, cleared, and channel for
        `sensor`.
      wheels: Number of wheels of the plant.
    """
    true = [fault for fault in faults if _is_diagnosable(fault)]
    correct = [_is_correct(diagnosis, true, wheels) for diagnosis in diagnoses]
    false_alarms = correct.count(False)
    if not true:
        return DiagnosisScore(None, None, false_alarms)
    onset = min(fault["onset"] for fault in true)
    times = [diagnosis["time"] for diagnosis in diagnoses]
    alarms = [time for time in times if any(_is_active(fault, time) for fault in true)]
    named = tuple(
        any(
            ok and _isolates(diagnosis, fault, wheels)
            for diagnosis, ok in zip(diagnoses, correct, strict=True)
        )
        for fault in true
    )
    wrong = [
        _end_of(diagnosis) - diagnosis["time"]
        for diagnosis, ok in zip(diagnoses, correct, strict=True)
        if not ok and diagnosis["time"] >= onset
    ]
    delay = float(min(alarms) - onset) if alarms else None
    return DiagnosisScore(delay, all(named) and sum(wrong) <= GRACE, false_alarms, named)


def _is_diagnosable(fault: Record) -> bool:
    return fault["kind"] in KINDS_OF_DIAGNOSIS and fault["onset"] is not None


def _end_of(record: Record, key: str = "cleared") -> float:
    end = record.get(key)
    return inf if end is None else end


def _is_active(fault: Record, time: float) -> bool:
    return fault["onset"] <= time <= _end_of(fault, "end") + GRACE


def _active_labels(faults: Sequence[Record], time: float, wheels: int) -> set[_Label]:
    """All labels that are correct at a time."""
    names: set[_Label] = set()
    for fault in faults:
        if _is_active(fault, time):
            names |= _fault_labels(fault, wheels)
    if all(("slip", wheel) in names for wheel in range(1, wheels + 1)):
        names.add(("all_wheel_slip", None))
    return names


def _fault_labels(fault: Record, wheels: int) -> set[_Label]:
    """Labels that are correct for a fault."""
    kind, wheel = fault["kind"], fault["wheel"]
    if kind == "sensor":
        return {(kind, fault.get("channel"))}
    if kind == "all_wheel_slip":
        return {(kind, None), *(("slip", i) for i in range(1, wheels + 1))}
    if kind == "free" or (kind == "motor" and fault.get("loss", 0.0) >= FREE_EQUIVALENT_LOSS):
        return {("free", wheel), ("motor", wheel)}
    return {(kind, wheel)}


def _diagnosis_labels(diagnosis: Record) -> set[_Label]:
    """Labels that a diagnosis claims jointly."""
    kind = diagnosis["kind"]
    if kind == "sensor":
        return {(kind, diagnosis.get("channel"))}
    if kind == "all_wheel_slip":
        return {(kind, None)}
    return {(kind, wheel) for wheel in diagnosis["wheels"]}


def _alternative_label(answer: str) -> _Label:
    """Label of an alternative such as `motor 3`, `sensor yaw_rate` or `all_wheel_slip`."""
    kind, _, place = answer.partition(" ")
    if not place:
        return kind, None
    return kind, int(place) if place.isdecimal() else place


def _is_correct(diagnosis: Record, faults: Sequence[Record], wheels: int) -> bool:
    true = _active_labels(faults, diagnosis["time"], wheels)
    claimed = _diagnosis_labels(diagnosis)
    if claimed and claimed <= true:
        return True
    return any(_alternative_label(answer) in true for answer in diagnosis.get("ambiguous_with", ()))


def _isolates(diagnosis: Record, fault: Record, wheels: int) -> bool:
    """True if a correct diagnosis names this fault, without alternatives, while the fault is active.

    A diagnosis that has not been cleared also names a fault of the same kind and wheel that recurs.
    """
    if diagnosis.get("ambiguous_with"):
        return False
    if diagnosis["time"] > _end_of(fault, "end") + GRACE or _end_of(diagnosis) < fault["onset"]:
        return False
    claimed, own = _diagnosis_labels(diagnosis), _fault_labels(fault, wheels)
    if fault["kind"] == "all_wheel_slip":
        return ("all_wheel_slip", None) in claimed or len(claimed) == wheels
    if ("all_wheel_slip", None) in claimed:
        return fault["kind"] == "slip"
    return bool(claimed & own)


@dataclass(frozen=True, slots=True)
class DiagnosisGroup:
    """Diagnoses of one kind, wheel and channel that match the same fault, or none."""

    diagnoses: tuple[Record, ...]
    """Diagnoses in the order in which they were made; at least one."""
    onset: float | None
    """Onset of the fault that they name [s]; None for a false alarm."""

    @property
    def first(self) -> Record:
        """Earliest diagnosis."""
        return self.diagnoses[0]

    @property
    def delay(self) -> float | None:
        """Time from the fault's onset to the first diagnosis, not negative [s]; None for a false alarm."""
        return None if self.onset is None else max(float(self.first["time"]) - self.onset, 0.0)

    @property
    def cleared(self) -> float | None:
        """Time at which the last of them was cleared [s]; None if one was never cleared."""
        ends = [inf if d.get("cleared") is None else float(d["cleared"]) for d in self.diagnoses]
        return None if max(ends) == inf else max(ends)

    @property
    def last(self) -> Record:
        """Latest diagnosis, which has the most data."""
        return self.diagnoses[-1]


@dataclass(frozen=True, slots=True)
class FaultMatch:
    """A fault and the diagnoses that name it."""

    fault: Record
    """Record of `metrics.json`."""
    is_diagnosable: bool
    """True if the fault occurred and is of a kind that a diagnosis can name."""
    groups: tuple[DiagnosisGroup, ...]
    """Groups in the order of time; empty if the fault was missed."""


@dataclass(frozen=True, slots=True)
class DiagnosisMatching:
    """Faults and diagnoses of a run, matched."""

    pairs: tuple[FaultMatch, ...]
    """One entry per fault, in the order given."""
    false_alarms: tuple[DiagnosisGroup, ...]
    """Groups that match no fault, in the order of time."""


def match_diagnoses(
    faults: Iterable[Record], diagnoses: Sequence[Record], wheels: int = 4
) -> DiagnosisMatching:
    """Match each diagnosis to the faults that it names; one of several wheels may name several faults.

    Args:
      faults: As for `judge_diagnoses`.
      diagnoses: As for `judge_diagnoses`.
      wheels: Number of wheels of the plant.
    """
    faults = list(faults)
    is_correct = [judge_diagnoses(faults, [diagnosis], wheels).false_alarms == 0 for diagnosis in diagnoses]
    correct = [diagnosis for diagnosis, ok in zip(diagnoses, is_correct, strict=True) if ok]
    pairs = []
    for fault in faults:
        known = _is_diagnosable(fault)
        own = [diagnosis for diagnosis in correct if known and _matches(diagnosis, fault, wheels)]
        pairs.append(FaultMatch(fault, known, _grouped(own, fault["onset"])))
    wrong = [diagnosis for diagnosis, ok in zip(diagnoses, is_correct, strict=True) if not ok]
    return DiagnosisMatching(tuple(pairs), _grouped(wrong, None))


def _matches(diagnosis: Record, fault: Record, wheels: int) -> bool:
    if _end_of(diagnosis, "cleared") >= fault["onset"]:
        # a diagnosis that has not been cleared also names a fault of the same kind and wheel that recurs
        diagnosis = {**diagnosis, "time": max(diagnosis["time"], fault["onset"])}
    parts = _single_wheel_parts(diagnosis, wheels)
    return any(judge_diagnoses([fault], [part], wheels).false_alarms == 0 for part in parts)


def _single_wheel_parts(diagnosis: Record, wheels: int) -> Iterator[Record]:
    """The diagnosis itself, and one for each of its wheels."""
    yield diagnosis
    if diagnosis["kind"] == "all_wheel_slip":
        yield from ({**diagnosis, "kind": "slip", "wheels": (i,)} for i in range(1, wheels + 1))
    elif len(diagnosis["wheels"]) > 1:
        yield from ({**diagnosis, "wheels": (wheel,)} for wheel in diagnosis["wheels"])


def _grouped(diagnoses: Sequence[Record], onset: float | None) -> tuple[DiagnosisGroup, ...]:
    found: dict[tuple[Any, ...], list[Record]] = {}
    for one in diagnoses:
        key = one["kind"], tuple(one["wheels"]), one.get("channel", ""), bool(one.get("ambiguous_with"))
        found.setdefault(key, []).append(one)
    return tuple(DiagnosisGroup(tuple(group), onset) for group in found.values())


def patch_records(
    trace: Trace, patches: Sequence[Patch], floor: str, wheel_positions: Array
) -> list[dict[str, Any]]:
    """Record the intervals in which a wheel stood on a patch of another floor, as slip faults.

    The contact of wheel i lies at (x, y) + R(heading) p_i. Where patches overlap, the last one counts.

    Args:
      trace: Trace with the true `x`, `y`, `heading`; without these columns there are no records.
      patches: Patches of the scenario.
      floor: Floor outside the patches; a patch of the same floor is no fault.
      wheel_positions: p_i, shape (n, 2) [m].

    Returns:
      `{kind: "slip", wheel, onset, end, floor}` per interval on a patch, by onset; `end` is None when the
      run ends on it.
    """
    time = trace["time"]
    if not patches or not len(time) or not {"x", "y", "heading"} <= set(trace.columns):
        return []
    cos, sin = np.cos(trace["heading"]), np.sin(trace["heading"])
    names = [floor, *(patch.floor for patch in patches)]
    records = []
    for wheel, (p_x, p_y) in enumerate(wheel_positions, start=1):
        contact = np.column_stack(
            [trace["x"] + cos * p_x - sin * p_y, trace["y"] + sin * p_x + cos * p_y],
        )
        under = np.zeros(len(time), int)
        for patch in patches:
            under[patch.covers(contact)] = names.index(patch.floor) if patch.floor != floor else 0
        starts = equal_stretches(under).tolist()
        for first, after in zip(starts, [*starts[1:], len(time)], strict=True):
            if under[first]:
                end = float(time[after]) if after < len(time) else None
                onset, on = float(time[first]), names[under[first]]
                records.append({"kind": "slip", "wheel": wheel, "onset": onset, "end": end, "floor": on})
    return sorted(records, key=lambda record: (record["onset"], record["wheel"]))
