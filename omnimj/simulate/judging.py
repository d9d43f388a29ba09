"""What a run's diagnoses are worth against the truth: one rule for metrics and evaluation.

A fault stands from its onset until `GRACE` after its end. Only kinds that a diagnosis can name count
(`KINDS_OF_DIAGNOSIS`); payload, slope, misaligned axles, another wheel radius and lost demands are no faults
to be diagnosed: whatever is said about them is a false alarm.

A diagnosis is *right* when it names a fault that stands at its time, by kind and wheel:

- `motor` with a loss of at least `FREE_EQUIVALENT_LOSS` and `free` count as alike, either way; a motor
fault by
  braking torque is a `motor`.
- While all wheels slip, `slip` of any wheel is right; while each of them has a slip fault of its own,
  `all_wheel_slip` is.
- `sensor` faults are told apart by their channel.
- One that names several wheels is right when each of them has that fault.
- One with `ambiguous_with` is right when any of its answers is, but it isolates nothing.

Everything else is a false alarm: before any onset, of what has never happened, of what is long over.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from omnimj.plant.ground import Patch
from omnimj.signals import KINDS_OF_DIAGNOSIS, Array, Trace

GRACE = 0.5
"""How long after its end a fault may still be named, and how long wrong names may stand in all [s]."""
FREE_EQUIVALENT_LOSS = 0.95
"""Loss of torque constant from which a motor cannot be told from a free wheel."""

_Label = tuple[str, int | str | None]  # kind and the wheel or channel it sits on


@dataclass(frozen=True, slots=True)
class DiagnosisScore:
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
) -> DiagnosisScore:
    """Judges what was diagnosed against what was true.

    Args:
      faults: Records of `metrics.json`: kind, wheel, onset, end and the kind's own keys. One whose onset is
        None never happened.
      diagnoses: Records of `metrics.json`: time, kind, wheels, ambiguous_with, cleared, and channel for
        `sensor`.
      wheels: Number of wheels of the plant.
    """
    true = [fault for fault in faults if fault["kind"] in KINDS_OF_DIAGNOSIS and fault["onset"] is not None]
    right = [_is_correct(diagnosis, true, wheels) for diagnosis in diagnoses]
    false_alarms = right.count(False)
    if not true:
        return DiagnosisScore(None, None, false_alarms)
    onset = min(fault["onset"] for fault in true)
    alarms = [said["time"] for said in diagnoses if any(_is_active(fault, said["time"]) for fault in true)]
    named = tuple(
        any(ok and _isolates(said, fault, wheels) for said, ok in zip(diagnoses, right, strict=True))
        for fault in true
    )
    wrong = [
        _end_of(said) - said["time"]
        for said, ok in zip(diagnoses, right, strict=True)
        if not ok and said["time"] >= onset
    ]
    delay = float(min(alarms) - onset) if alarms else None
    return DiagnosisScore(delay, all(named) and sum(wrong) <= GRACE, false_alarms, named)


def _end_of(record: Mapping[str, Any], key: str = "cleared") -> float:
    end = record.get(key)
    return inf if end is None else end


def _is_active(fault: Mapping[str, Any], time: float) -> bool:
    return fault["onset"] <= time <= _end_of(fault, "end") + GRACE


def _active_labels(faults: Sequence[Mapping[str, Any]], time: float, wheels: int) -> set[_Label]:
    """Every name that is right at that time."""
    names: set[_Label] = set()
    for fault in faults:
        if _is_active(fault, time):
            names |= _fault_labels(fault, wheels)
    if all(("slip", wheel) in names for wheel in range(1, wheels + 1)):
        names.add(("all_wheel_slip", None))
    return names


def _fault_labels(fault: Mapping[str, Any], wheels: int) -> set[_Label]:
    """The names that are right for a fault."""
    kind, wheel = fault["kind"], fault["wheel"]
    if kind == "sensor":
        return {(kind, fault.get("channel"))}
    if kind == "all_wheel_slip":
        return {(kind, None), *(("slip", i) for i in range(1, wheels + 1))}
    if kind == "free" or (kind == "motor" and fault.get("loss", 0.0) >= FREE_EQUIVALENT_LOSS):
        return {("free", wheel), ("motor", wheel)}
    return {(kind, wheel)}


def _diagnosis_labels(diagnosis: Mapping[str, Any]) -> set[_Label]:
    """The names that a diagnosis gives all at once."""
    kind = diagnosis["kind"]
    if kind == "sensor":
        return {(kind, diagnosis.get("channel"))}
    if kind == "all_wheel_slip":
        return {(kind, None)}
    return {(kind, wheel) for wheel in diagnosis["wheels"]}


def _alternative_label(answer: str) -> _Label:
    """`motor 3` or `sensor yaw_rate` as a name; an answer without a place is the kind alone."""
    kind, _, place = answer.partition(" ")
    if not place:
        return kind, None
    return kind, int(place) if place.isdecimal() else place


def _is_correct(diagnosis: Mapping[str, Any], faults: Sequence[Mapping[str, Any]], wheels: int) -> bool:
    true = _active_labels(faults, diagnosis["time"], wheels)
    said = _diagnosis_labels(diagnosis)
    if said and said <= true:
        return True
    return any(_alternative_label(answer) in true for answer in diagnosis.get("ambiguous_with", ()))


def _isolates(diagnosis: Mapping[str, Any], fault: Mapping[str, Any], wheels: int) -> bool:
    """Whether a right diagnosis names this fault, and no other answer, while it stands.

    One that was made before and still stands names a fault of the same name that comes back.
    """
    if diagnosis.get("ambiguous_with"):
        return False
    if diagnosis["time"] > _end_of(fault, "end") + GRACE or _end_of(diagnosis) < fault["onset"]:
        return False
    said, own = _diagnosis_labels(diagnosis), _fault_labels(fault, wheels)
    if fault["kind"] == "all_wheel_slip":
        return ("all_wheel_slip", None) in said or len(said) == wheels
    if ("all_wheel_slip", None) in said:
        return fault["kind"] == "slip"
    return bool(said & own)


# Truth beside diagnosis: which fault each diagnosis of a run names, and what nobody asked for.

Record = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class DiagnosisGroup:
    """All diagnoses of one name that say the same about the truth."""

    diagnoses: tuple[Record, ...]
    """In the order in which they were made, at least one."""
    onset: float | None
    """Of the fault that they name [s]; None for a false alarm."""

    @property
    def first(self) -> Record:
        """The earliest."""
        return self.diagnoses[0]

    @property
    def delay(self) -> float | None:
        """From the fault's onset to the first diagnosis, never negative [s]; None for a false alarm."""
        return None if self.onset is None else max(float(self.first["time"]) - self.onset, 0.0)

    @property
    def cleared(self) -> float | None:
        """When the last of them was taken back [s]; None: it stands."""
        ends = [inf if d.get("cleared") is None else float(d["cleared"]) for d in self.diagnoses]
        return None if max(ends) == inf else max(ends)

    @property
    def last(self) -> Record:
        """The latest, which knows best."""
        return self.diagnoses[-1]


@dataclass(frozen=True, slots=True)
class FaultMatch:
    """One fault and what was said about it."""

    fault: Record
    """Of `metrics.json`."""
    is_diagnosable: bool
    """Whether a diagnosis has a name for its kind, and it happened."""
    groups: tuple[DiagnosisGroup, ...]
    """By name, in the order of time; empty when it was not found."""


@dataclass(frozen=True, slots=True)
class DiagnosisMatching:
    """All of a run."""

    pairs: tuple[FaultMatch, ...]
    """Of each fault, in the order given."""
    false_alarms: tuple[DiagnosisGroup, ...]
    """By name, in the order of time."""


def match_diagnoses(
    faults: Iterable[Record], diagnoses: Sequence[Record], wheels: int = 4
) -> DiagnosisMatching:
    """Puts each diagnosis beside the fault that it names.

    A diagnosis of several wheels, or of all of them, stands beside each fault that it names.

    Args:
      faults: As for `judge_diagnoses`.
      diagnoses: As for `judge_diagnoses`.
      wheels: Number of wheels of the plant.
    """
    faults = list(faults)
    right = [judge_diagnoses(faults, [said], wheels).false_alarms == 0 for said in diagnoses]
    true = [said for said, ok in zip(diagnoses, right, strict=True) if ok]
    pairs = []
    for fault in faults:
        known = fault["kind"] in KINDS_OF_DIAGNOSIS and fault["onset"] is not None
        own = [said for said in true if known and _matches(said, fault, wheels)]
        pairs.append(FaultMatch(fault, known, _grouped(own, fault["onset"])))
    wrong = [said for said, ok in zip(diagnoses, right, strict=True) if not ok]
    return DiagnosisMatching(tuple(pairs), _grouped(wrong, None))


def _matches(said: Record, fault: Record, wheels: int) -> bool:
    cleared = said.get("cleared")
    if cleared is None or cleared >= fault["onset"]:
        # one that was made before and still stands names a fault of the same name that comes back
        said = {**said, "time": max(said["time"], fault["onset"])}
    return any(
        judge_diagnoses([fault], [part], wheels).false_alarms == 0
        for part in _single_wheel_parts(said, wheels)
    )


def _single_wheel_parts(said: Record, wheels: int) -> Iterator[Record]:
    """What it says, and each wheel of it for itself."""
    yield said
    if said["kind"] == "all_wheel_slip":
        yield from ({**said, "kind": "slip", "wheels": (i,)} for i in range(1, wheels + 1))
    elif len(said["wheels"]) > 1:
        yield from ({**said, "wheels": (wheel,)} for wheel in said["wheels"])


def _grouped(diagnoses: Sequence[Record], onset: float | None) -> tuple[DiagnosisGroup, ...]:
    found: dict[tuple[Any, ...], list[Record]] = {}
    for said in diagnoses:
        name = said["kind"], tuple(said["wheels"]), said.get("channel", ""), bool(said.get("ambiguous_with"))
        found.setdefault(name, []).append(said)
    return tuple(DiagnosisGroup(tuple(alike), onset) for alike in found.values())


# The truth about faults for `metrics.json`: those by time from the scenario, those by place from the run.


def patch_records(
    trace: Trace, patches: Sequence[Patch], floor: str, wheel_positions: Array
) -> list[dict[str, Any]]:
    """When each wheel's contact was on another floor than the scenario's, as slip faults.

    The contact of wheel i lies at (x, y) + R(heading) p_i. Where patches overlap, the last one counts.

    Args:
      trace: With the truth columns `x`, `y`, `heading`; without them there is no telling, and no record.
      patches: As in the scenario.
      floor: The scenario's own floor; a patch of the same floor is no fault.
      wheel_positions: p_i, shape (n, 2) [m].

    Returns:
      `{kind: "slip", wheel, onset, end, floor}` per stay on a patch, by onset; `end` is None when the run
      ends on it.
    """
    if not patches or not {"x", "y", "heading"} <= set(trace.columns):
        return []
    time = trace["time"]
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
        for value, first, last in _constant_stretches(under):
            if value:
                end = float(time[last + 1]) if last + 1 < len(time) else None
                onset = float(time[first])
                records.append(
                    {"kind": "slip", "wheel": wheel, "onset": onset, "end": end, "floor": names[value]}
                )
    return sorted(records, key=lambda record: (record["onset"], record["wheel"]))


def _constant_stretches(values: Array) -> list[tuple[int, int, int]]:
    """Runs of equal values as (value, first row, last row)."""
    if not len(values):
        return []
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    ends = np.concatenate([starts[1:], [len(values)]]) - 1
    return [(int(values[a]), int(a), int(b)) for a, b in zip(starts, ends, strict=True)]
