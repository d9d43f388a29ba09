"""What one case says of a method."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from omnimj.plant.faults import Fault
from omnimj.simulate.judging import GRACE, judge_diagnoses
from omnimj.studies.evaluation.cases import Case, fault_label
from omnimj.studies.random_truth import ALL_CLASSES, NONE, TWO

AMBIGUOUS, SEVERAL = "ambiguous", "several"
HEADING_FLOOR = 0.0015
"""One step of the heading converter: smaller excursions are taken as this large in ratios [rad]."""
PATH_FLOOR = 0.005
"""Smaller excursions of the path are taken as this large in ratios [m]."""


@dataclass(frozen=True)
class FaultScore:
    """One fault of a case."""

    label: str
    """`motor 3`."""
    in_use: float | None
    """Since when its part was in use [s]; None: it never was."""
    named: bool
    """Whether it was named for itself."""
    named_delay: float
    """From onset to its name [s]; ∞: never."""
    named_delay_in_use: float | None
    """From first use to its name [s], 0 where that came before; None: never in use."""
    estimate_error: float | None
    """Estimated − true effectiveness of a weak motor after 5 s in use."""


@dataclass(frozen=True)
class CaseScore:
    """One case."""

    name: str
    plant: str
    floor: str
    payload: float
    speed: str
    hours: float
    fault: str
    """Class of the truth."""
    severity: float | None
    """Loss or grip of a single motor or slip fault."""
    truth: str
    """Row of the confusion matrix: `none`, `motor 3`, `two`."""
    diagnosed: str
    """Its column: the truth's label where the fault was isolated; else a name, `none`, `ambiguous`,
    `several`."""
    isolated: bool | None
    """By the rule of `scenario.judging`; None without a fault."""
    false_alarms: int
    early_alarms: int
    """Of these, those before the first onset."""
    healthy_hours: float
    """Time without a fault: until the first onset, or all of it [h]."""
    delay: float
    """From the first onset to the first alarm [s]; ∞: none, or no fault."""
    delay_in_use: float | None
    """From the first use of a faulty part to the first alarm [s], 0 where that came before; None: no faulty
    part was ever in use."""
    faults: tuple[FaultScore, ...]
    heading: float | None
    """Excursion with the method [rad]."""
    heading_off: float | None
    path: float | None
    """[m]."""
    path_off: float | None
    clearing: float | None
    """From a slip's end to the end of its diagnosis [s]; ∞: never; None: nothing to clear."""
    switches: int | None
    """How often a slip that is the only fault was diagnosed; None: no such slip, or it was never named."""

    @property
    def heading_ratio(self) -> float | None:
        """With over without recovery; both at least `HEADING_FLOOR`."""
        return _ratio(self.heading, self.heading_off, HEADING_FLOOR)

    @property
    def path_ratio(self) -> float | None:
        """With over without recovery; both at least `PATH_FLOOR`."""
        return _ratio(self.path, self.path_off, PATH_FLOOR)

    @property
    def was_in_use(self) -> bool:
        """Whether every faulty part was asked to work."""
        return bool(self.faults) and all(fault.in_use is not None for fault in self.faults)


def score_case(case: Case, result: Mapping[str, Any]) -> CaseScore:
    """Scores what `drive_case` found."""
    said: Sequence[Mapping[str, Any]] = result["method"]["diagnoses"]
    truth = case.fault_records()
    verdict = judge_diagnoses(truth, said)
    onset = min((fault.onset for fault in case.faults), default=inf)
    used = [use["first"] for use in result["use"] if use["first"] is not None]
    delay = inf if verdict.detection_delay is None else verdict.detection_delay
    off = result["off"] or {"heading": None, "path": None}
    early = [one for one in said if one["time"] < onset]
    return CaseScore(
        name=case.name,
        plant=case.plant,
        floor=case.floor,
        payload=case.errors.payload,
        speed=case.speed,
        hours=case.duration / 3600.0,
        fault=case.fault,
        severity=_severity(case),
        truth=truth_label(case),
        diagnosed=diagnosed_label(case, said),
        isolated=verdict.isolated,
        false_alarms=verdict.false_alarms,
        early_alarms=len(early) if case.faults else 0,
        healthy_hours=min(onset, case.duration) / 3600.0,
        delay=delay,
        delay_in_use=max(onset + delay - min(used), 0.0) if used else None,
        faults=tuple(
            _score_fault(case, k, result["use"][k], said, verdict.named[k]) for k in range(len(case.faults))
        ),
        heading=result["method"]["heading"],
        heading_off=off["heading"],
        path=result["method"]["path"],
        path_off=off["path"],
        clearing=_clearing(case, said),
        switches=_switches(case, said),
    )


def _ratio(with_recovery: float | None, without: float | None, floor: float) -> float | None:
    if with_recovery is None or without is None:
        return None
    return max(with_recovery, floor) / max(without, floor)


def _severity(case: Case) -> float | None:
    """Of a single fault of the classes motor (by torque constant) and slip."""
    if case.fault not in ("motor", "slip"):
        return None
    numbers = case.faults[0].numbers
    found = numbers.get("loss", numbers.get("grip"))
    return None if found is None else float(found)


def truth_label(case: Case) -> str:
    """`none`, the fault's label, or `two`."""
    if case.fault in (NONE, TWO):
        return case.fault
    return fault_label(case.fault_records()[0])


def diagnosed_label(case: Case, said: Sequence[Mapping[str, Any]]) -> str:
    """What a case was taken for: by what was said since the first onset and not taken back within `GRACE`."""
    truth = case.fault_records()
    onset = min((fault.onset for fault in case.faults), default=0.0)
    lasting = [
        one
        for one in said
        if one["time"] >= onset and (one.get("cleared") is None or one["cleared"] - one["time"] > GRACE)
    ]
    if truth and judge_diagnoses(truth, said).isolated:
        return truth_label(case)
    if not truth and said and not lasting:
        lasting = list(said)  # without a fault every alarm is one too many
    if not lasting:
        return NONE
    names = {fault_label(one) for one in lasting if not one.get("ambiguous_with")}
    if not names:
        return AMBIGUOUS
    return names.pop() if len(names) == 1 else SEVERAL


def _score_fault(
    case: Case, k: int, use: Mapping[str, Any], said: Sequence[Mapping[str, Any]], named: bool
) -> FaultScore:
    fault, truth = case.faults[k], case.fault_records()
    times = [one["time"] for one in said if judge_diagnoses(truth, [one]).named[k]]
    at = max(min(times), fault.onset) if named and times else inf
    return FaultScore(
        label=fault_label(truth[k]),
        in_use=use["first"],
        named=named,
        named_delay=at - fault.onset,
        named_delay_in_use=None if use["first"] is None else max(at - use["first"], 0.0),
        estimate_error=_estimate_error(case, fault, use["effectiveness"]),
    )


def _estimate_error(case: Case, fault: Fault, estimate: float | None) -> float | None:
    """Against (1 − loss) × true over nominal torque constant: what is left of the one it believes in."""
    if estimate is None or fault.wheel is None or "loss" not in fault.numbers:
        return None
    left = (1.0 - float(fault.numbers["loss"])) * case.errors.torque_constants[fault.wheel - 1]
    return estimate - left


def _slip_diagnoses(case: Case, said: Sequence[Mapping[str, Any]]) -> Sequence[Mapping[str, Any]]:
    """The diagnoses that name a slip which is the only fault; none where another fault, or more, is true."""
    if len(case.faults) != 1 or case.faults[0].kind != "slip":
        return ()
    truth = case.fault_records()
    return [one for one in said if judge_diagnoses(truth, [one]).named[0]]


def _clearing(case: Case, said: Sequence[Mapping[str, Any]]) -> float | None:
    """Of the last diagnosis that named a slip which ended."""
    naming = _slip_diagnoses(case, said)
    end = case.faults[0].end if naming else None
    if end is None or end >= case.duration:
        return None
    ends = [inf if one.get("cleared") is None else float(one["cleared"]) for one in naming]
    return max(max(ends) - end, 0.0)


def _switches(case: Case, said: Sequence[Mapping[str, Any]]) -> int | None:
    """Every one that comes after the first was taken back is one more."""
    return len(_slip_diagnoses(case, said)) or None


def confusion(scores: Sequence[CaseScore]) -> dict[str, dict[str, int]]:
    """Truth → diagnosed → cases; every row sums to the cases of its truth."""
    counts: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
    for score in scores:
        counts[score.truth][score.diagnosed] += 1
    return {row: dict(sorted(counts[row].items())) for row in sorted(counts, key=label_sort_key)}


_KINDS = (*ALL_CLASSES, AMBIGUOUS, SEVERAL)


def label_sort_key(label: str) -> tuple[int, str]:
    """Sorts labels as the classes are listed, then by wheel or channel."""
    kind, _, place = label.partition(" ")
    return (_KINDS.index(kind) if kind in _KINDS else len(_KINDS), place)
