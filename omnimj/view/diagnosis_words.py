"""Diagnoses in words: what was found, which test decided, how bad it is, and in how many runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from omnimj.diagnosis.driving_regimes import describe_misfit
from omnimj.signals import Diagnosis

if TYPE_CHECKING:
    from omnimj.diagnosis.replay import RunDiagnosis

NOTHING_FOUND = "nothing found"
UNFIT = "the model does not fit"
FULL = 0.97
"""Effectiveness from which no torque of a motor is said to be missing: the tolerance of healthy ones."""


def describe_diagnosis(diagnosis: Diagnosis) -> str:
    """Describe a diagnosis: `motor 2 is weak: 43 % left`."""
    d, wheels = diagnosis, ", ".join(str(wheel) for wheel in diagnosis.wheels)
    if d.kind == "motor":
        return _describe_motor(d, wheels)
    if d.kind == "sensor":
        return f"sensor {d.channel or wheels} is wrong"
    words = {
        "slip": f"wheel {wheels} slips",
        "locked": f"wheel {wheels} is locked",
        "free": f"motor {wheels} gives nothing",
        "hard_over": f"motor {wheels} runs away",
        "all_wheel_slip": "all wheels slip",
    }
    return words.get(d.kind, f"{d.kind.replace('_', ' ')} {wheels}".strip())


def _describe_motor(diagnosis: Diagnosis, wheels: str) -> str:
    left = diagnosis.effectiveness
    if diagnosis.ambiguous_with == (f"locked {wheels}",):
        return f"wheel {wheels} stands while its motor pushes"
    if diagnosis.test == "friction":
        return f"wheel {wheels} is braked"
    if left is not None and left >= FULL:
        return f"motor {wheels} seemed weak; no loss is left"
    return f"motor {wheels} is weak" + ("" if left is None else f": {100.0 * left:.0f} % left")


_STATISTICS: Mapping[str, tuple[str, str, float]] = {
    "loss": ("missing force", "nats", 1.0),
    "friction": ("added friction", "nats", 1.0),
    "learnt loss": ("loss learnt while driving", "%", 100.0),
    "accelerometer": ("jump of its bias", "nats", 1.0),
    "slip": ("slip distance", "mm", 1000.0),
    "current": ("set current not followed", "blocks", 1.0),
    "standing": ("standing against floor or motor", "blocks", 1.0),
    "readings": ("frozen or noisy readings", "", 1.0),
    "yaw rates": ("converter and gyro apart", "rad", 1.0),
    "wheel speed": ("speed that no slip explains", "blocks", 1.0),
}
"""Statistic of each test of the robust method, its unit, and the factor to it."""


def describe_evidence(diagnosis: Diagnosis) -> str:
    """Describe what decided: `missing force, 31 nats ≥ 23.5`; a dash where a method names no test."""
    if not diagnosis.test:
        return "–"
    words, unit, factor = _STATISTICS.get(diagnosis.test, (diagnosis.test, "", 1.0))
    if diagnosis.statistic is None or diagnosis.threshold is None:
        return words
    statistic, threshold = (f"{factor * x:.3g}" for x in (diagnosis.statistic, diagnosis.threshold))
    if statistic == threshold:
        statistic, threshold = (f"{factor * x:.4g}" for x in (diagnosis.statistic, diagnosis.threshold))
    return f"{words}, {statistic} {unit} ≥ {threshold}".replace("  ", " ")


def describe_time(diagnosis: Diagnosis) -> str:
    """Describe the interval of a diagnosis: `from 3.210 s`, or `3.210 … 4.000 s`."""
    if diagnosis.cleared is None:
        return f"from {diagnosis.time:.3f} s"
    return f"{diagnosis.time:.3f} … {diagnosis.cleared:.3f} s"


def describe_confidence(diagnosis: Diagnosis) -> str:
    """Describe the confidence in a diagnosis: `99 %`, with the alternatives."""
    others = f", or {', '.join(diagnosis.ambiguous_with)}" if diagnosis.ambiguous_with else ""
    return f"{100.0 * diagnosis.confidence:.0f} %{others}"


def describe(diagnosis: Diagnosis) -> tuple[str, str, str, str]:
    """Describe a diagnosis in a row: what, when, with which confidence, and what decided."""
    d = diagnosis
    return describe_diagnosis(d), describe_time(d), describe_confidence(d), describe_evidence(d)


def describe_kind(diagnosis: Diagnosis) -> str:
    """Describe a diagnosis without its numbers, alike for several runs: `motor 2 is weak`."""
    return describe_diagnosis(diagnosis).partition(":")[0]


def severity(diagnosis: Diagnosis) -> float:
    """Rank a diagnosis, the worst first: what no longer drives, what drives less, sensors."""
    ranks = ("locked", "hard_over", "free", "motor", "all_wheel_slip", "slip", "sensor")
    rank = ranks.index(diagnosis.kind) if diagnosis.kind in ranks else len(ranks)
    left = diagnosis.effectiveness if diagnosis.kind == "motor" else 0.0
    left = None if diagnosis.test == "friction" else left  # says nothing of the friction
    return rank + min(max(0.5 if left is None else left, 0.0), 1.0) * 0.9


def describe_undiagnosed(run: RunDiagnosis) -> str:
    """Describe a run without a diagnosis."""
    if run.does_not_fit is not None:
        return describe_misfit(run.does_not_fit, run.withheld)
    return NOTHING_FOUND if run.judged > 0.0 else "no usable samples"


def describe_unjudged(run: RunDiagnosis) -> str:
    """Describe the total time without a possible diagnosis; empty if there was none."""
    if run.cannot_judge <= 0.0:
        return ""
    return f"cannot judge {run.cannot_judge:.1f} of {run.judged:.1f} s"


def summarize_runs(runs: Sequence[RunDiagnosis]) -> str:
    """Summarise the diagnoses of all runs in one sentence."""
    count = sum(len(run.diagnoses) for run in runs)
    many = f"{len(runs)} run{'s' if len(runs) != 1 else ''}"
    unfit = sum(run.does_not_fit is not None for run in runs)
    also = f"; the model does not fit {unfit} of them" if unfit else ""
    if not count:
        return f"{NOTHING_FOUND} in {many}{also}"
    concerned = sum(bool(run.diagnoses) for run in runs)
    return f"{count} diagnos{'es' if count != 1 else 'is'} in {concerned} of {many}{also}"
