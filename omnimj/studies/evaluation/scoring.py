"""Scores of single cases."""

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
"""Lower limit of a heading excursion in ratios, one step of the heading converter [rad]."""
SLIPPING = 0.05
"""Slip velocity, held for `part_use.HOLD_TIME`, from which a wheel counts as slipping [m/s]."""
PATH_FLOOR = 0.005
"""Lower limit of a path excursion in ratios [m]."""


@dataclass(frozen=True)
class FaultScore:
    """Score of one fault of a case."""

    label: str
    """Label such as `motor 3`."""
    in_use: float | None
    """Time at which its part was first in use [s]; None: never."""
    named: bool
    """True if this fault was diagnosed."""
    named_delay: float
    """Time from onset to its diagnosis [s]; ∞: never."""
    named_delay_in_use: float | None
    """Time from first use to its diagnosis [s], 0 if diagnosed before; None: never in use."""
    estimate_error: float | None
    """Estimated − true effectiveness of a weak motor after 5 s of use."""


@dataclass(frozen=True)
class CaseScore:
    """Score of one case."""

    name: str
    plant: str
    floor: str
    payload: float
    speed: str
    hours: float
    fault: str
    """Fault class of the truth."""
    severity: float | None
    """Loss or grip of a single motor or slip fault."""
    truth: str
    """Row of the confusion matrix: `none`, `motor 3`, `two`."""
    diagnosed: str
    """Column of the confusion matrix: the true label if the fault was isolated; else the diagnosed one,
    `none`, `ambiguous` or `several`."""
    isolated: bool | None
    """True if exactly the true faults were diagnosed, see `simulate.judging`; None without a fault."""
    false_alarms: int
    slipping_alarms: int
    """Those of them, in a case without a fault, that diagnose the slip of a wheel that held `SLIPPING`."""
    early_alarms: int
    """Number of false alarms before the first onset."""
    healthy_hours: float
    """Time until the first onset; the whole run without a fault [h]."""
    delay: float
    """Time from the first onset to the first alarm [s]; ∞: no alarm, or no fault."""
    delay_in_use: float | None
    """Time from the first use of a faulty part to the first alarm [s], 0 if the alarm came before; None: no
    faulty part was in use."""
    faults: tuple[FaultScore, ...]
    heading: float | None
    """Heading excursion with the method [rad]."""
    heading_off: float | None
    """Heading excursion without any method [rad]."""
    path: float | None
    """Path excursion with the method [m]."""
    path_off: float | None
    """Path excursion without any method [m]."""
    heading_change: float | None
    """Largest change of the heading by the faults, without any method [rad]."""
    path_change: float | None
    """Largest change of the position by the faults, without any method [m]."""
    gave_up_heading: bool
    """True if the recovery gave the heading up by design, for faults that were isolated."""
    slip: float | None
    """Slip velocity that is held without any method, of a slip that is the only fault [m/s]."""
    clearing: float | None
    """Time from the end of a slip to the end of its diagnosis [s]; ∞: never; None: nothing to clear."""
    switches: int | None
    """Number of times that a slip, the only fault, was diagnosed; None: no such slip, or never diagnosed."""

    @property
    def heading_ratio(self) -> float | None:
        """Heading excursion with recovery over that without, both at least `HEADING_FLOOR`."""
        return _ratio(self.heading, self.heading_off, HEADING_FLOOR)

    @property
    def path_ratio(self) -> float | None:
        """Path excursion with recovery over that without, both at least `PATH_FLOOR`."""
        return _ratio(self.path, self.path_off, PATH_FLOOR)

    @property
    def was_in_use(self) -> bool:
        """True if every faulty part was in use."""
        return bool(self.faults) and all(fault.in_use is not None for fault in self.faults)


@dataclass(frozen=True)
class CaseEvents:
    """True faults and diagnoses of a case, as in `metrics.json`."""

    faults: Sequence[Mapping[str, Any]]
    diagnoses: Sequence[Mapping[str, Any]]
    duration: float
    """Duration of the run [s]."""


def score_case(case: Case, result: Mapping[str, Any]) -> CaseScore:
    """Score a case by the result of `trial.drive_case`."""
    diagnoses: Sequence[Mapping[str, Any]] = result["method"]["diagnoses"]
    truth = case.fault_records()
    verdict = judge_diagnoses(truth, diagnoses)
    onset = min((fault.onset for fault in case.faults), default=inf)
    used = [use["first"] for use in result["use"] if use["first"] is not None]
    delay = inf if verdict.detection_delay is None else verdict.detection_delay
    off = result["off"] or {"heading": None, "path": None}
    change = result.get("change") or {"heading": None, "path": None}
    early = [one for one in diagnoses if one["time"] < onset]
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
        diagnosed=diagnosed_label(case, diagnoses),
        isolated=verdict.isolated,
        false_alarms=verdict.false_alarms,
        slipping_alarms=sum((slip or 0.0) >= SLIPPING for slip in result["method"].get("slips", ())),
        early_alarms=len(early) if case.faults else 0,
        healthy_hours=min(onset, case.duration) / 3600.0,
        delay=delay,
        delay_in_use=max(onset + delay - min(used), 0.0) if used else None,
        faults=tuple(
            _score_fault(case, k, result["use"][k], diagnoses, verdict.named[k])
            for k in range(len(case.faults))
        ),
        heading=result["method"]["heading"],
        heading_off=off["heading"],
        path=result["method"]["path"],
        path_off=off["path"],
        heading_change=change["heading"],
        path_change=change["path"],
        gave_up_heading=bool(verdict.isolated and result["method"].get("gave_up_heading")),
        slip=result["use"][0].get("slip") if case.fault == "slip" else None,
        clearing=_clearing(case, diagnoses),
        switches=_switches(case, diagnoses),
    )


def _ratio(with_recovery: float | None, without: float | None, floor: float) -> float | None:
    if with_recovery is None or without is None:
        return None
    return max(with_recovery, floor) / max(without, floor)


def _severity(case: Case) -> float | None:
    """Return loss or grip of a single fault of the classes motor (by torque constant) and slip."""
    if case.fault not in ("motor", "slip"):
        return None
    numbers = case.faults[0].numbers
    found = numbers.get("loss", numbers.get("grip"))
    return None if found is None else float(found)


def truth_label(case: Case) -> str:
    """Return the true label of a case: `none`, that of its fault, or `two`."""
    if case.fault in (NONE, TWO):
        return case.fault
    return fault_label(case.fault_records()[0])


def diagnosed_label(case: Case, diagnoses: Sequence[Mapping[str, Any]]) -> str:
    """Return the diagnosed label of a case, from diagnoses after the onset that last longer than `GRACE`."""
    truth = case.fault_records()
    onset = min((fault.onset for fault in case.faults), default=0.0)
    lasting = [
        one
        for one in diagnoses
        if one["time"] >= onset and (one.get("cleared") is None or one["cleared"] - one["time"] > GRACE)
    ]
    if truth and judge_diagnoses(truth, diagnoses).isolated:
        return truth_label(case)
    if not truth and diagnoses and not lasting:
        lasting = list(diagnoses)  # without a fault every alarm counts
    if not lasting:
        return NONE
    names = {fault_label(one) for one in lasting if not one.get("ambiguous_with")}
    if not names:
        return AMBIGUOUS
    return names.pop() if len(names) == 1 else SEVERAL


def _score_fault(
    case: Case, k: int, use: Mapping[str, Any], diagnoses: Sequence[Mapping[str, Any]], named: bool
) -> FaultScore:
    fault, truth = case.faults[k], case.fault_records()
    times = [one["time"] for one in diagnoses if judge_diagnoses(truth, [one]).named[k]]
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
    """Return estimated − true effectiveness, the latter (1 − loss) × true/nominal torque constant."""
    if estimate is None or fault.wheel is None or "loss" not in fault.numbers:
        return None
    left = (1.0 - float(fault.numbers["loss"])) * case.errors.torque_constants[fault.wheel - 1]
    return estimate - left


def _slip_diagnoses(case: Case, diagnoses: Sequence[Mapping[str, Any]]) -> Sequence[Mapping[str, Any]]:
    """Return the diagnoses of a slip that is the only fault; none if the truth is another."""
    if len(case.faults) != 1 or case.faults[0].kind != "slip":
        return ()
    truth = case.fault_records()
    return [one for one in diagnoses if judge_diagnoses(truth, [one]).named[0]]


def _clearing(case: Case, diagnoses: Sequence[Mapping[str, Any]]) -> float | None:
    """Return the time from the end of a slip to that of its last diagnosis."""
    naming = _slip_diagnoses(case, diagnoses)
    end = case.faults[0].end if naming else None
    if end is None or end >= case.duration:
        return None
    ends = [inf if one.get("cleared") is None else float(one["cleared"]) for one in naming]
    return max(max(ends) - end, 0.0)


def _switches(case: Case, diagnoses: Sequence[Mapping[str, Any]]) -> int | None:
    """Return the number of diagnoses of a slip; each one after the first was cleared counts."""
    return len(_slip_diagnoses(case, diagnoses)) or None


def confusion(scores: Sequence[CaseScore]) -> dict[str, dict[str, int]]:
    """Return truth → diagnosed → number of cases; every row sums to the cases of its truth."""
    counts: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
    for score in scores:
        counts[score.truth][score.diagnosed] += 1
    return {row: dict(sorted(counts[row].items())) for row in sorted(counts, key=label_sort_key)}


_KINDS = (*ALL_CLASSES, AMBIGUOUS, SEVERAL)


def label_sort_key(label: str) -> tuple[int, str]:
    """Return the sort key of a label: by class, then by wheel or channel."""
    kind, _, place = label.partition(" ")
    return (_KINDS.index(kind) if kind in _KINDS else len(_KINDS), place)
