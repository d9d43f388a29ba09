"""Truth beside diagnosis: which fault each diagnosis of a run names, and what nobody asked for.

The rule is that of `judging`; here it is asked diagnosis by diagnosis.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from omnimj.scenario.judging import judge_diagnoses
from omnimj.signals import KINDS_OF_DIAGNOSIS

Record = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Naming:
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
class Pair:
    """One fault and what was said about it."""

    fault: Record
    """Of `metrics.json`."""
    can_be_named: bool
    """Whether a diagnosis has a name for its kind, and it happened."""
    namings: tuple[Naming, ...]
    """By name, in the order of time; empty when it was not found."""


@dataclass(frozen=True, slots=True)
class Pairing:
    """All of a run."""

    pairs: tuple[Pair, ...]
    """Of each fault, in the order given."""
    false_alarms: tuple[Naming, ...]
    """By name, in the order of time."""


def pair(faults: Iterable[Record], diagnoses: Sequence[Record], wheels: int = 4) -> Pairing:
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
        own = [said for said in true if known and _is_of(said, fault, wheels)]
        pairs.append(Pair(fault, known, _by_name(own, fault["onset"])))
    wrong = [said for said, ok in zip(diagnoses, right, strict=True) if not ok]
    return Pairing(tuple(pairs), _by_name(wrong, None))


def _is_of(said: Record, fault: Record, wheels: int) -> bool:
    cleared = said.get("cleared")
    if cleared is None or cleared >= fault["onset"]:
        # one that was made before and still stands names a fault of the same name that comes back
        said = {**said, "time": max(said["time"], fault["onset"])}
    return any(judge_diagnoses([fault], [part], wheels).false_alarms == 0 for part in _parts(said, wheels))


def _parts(said: Record, wheels: int) -> Iterator[Record]:
    """What it says, and each wheel of it for itself."""
    yield said
    if said["kind"] == "all_wheel_slip":
        yield from ({**said, "kind": "slip", "wheels": (i,)} for i in range(1, wheels + 1))
    elif len(said["wheels"]) > 1:
        yield from ({**said, "wheels": (wheel,)} for wheel in said["wheels"])


def _by_name(diagnoses: Sequence[Record], onset: float | None) -> tuple[Naming, ...]:
    found: dict[tuple[Any, ...], list[Record]] = {}
    for said in diagnoses:
        name = said["kind"], tuple(said["wheels"]), said.get("channel", ""), bool(said.get("ambiguous_with"))
        found.setdefault(name, []).append(said)
    return tuple(Naming(tuple(alike), onset) for alike in found.values())
