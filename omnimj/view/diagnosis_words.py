"""Diagnoses in words: what, when, and how sure."""

from __future__ import annotations

from collections.abc import Sequence

from omnimj.diagnosis.replay import Replayed
from omnimj.signals import Diagnosis

NOTHING = "nothing found"


def what(diagnosis: Diagnosis) -> str:
    """`motor 2 has 43 % of its torque left`."""
    d, wheels = diagnosis, ", ".join(str(wheel) for wheel in diagnosis.wheels)
    if d.kind == "motor":
        left = d.effectiveness
        return f"motor {wheels} is weak" + ("" if left is None else f": {100.0 * left:.0f} % left")
    if d.kind == "sensor":
        return f"sensor {d.channel or wheels} is wrong"
    said = {
        "slip": f"wheel {wheels} slips",
        "locked": f"wheel {wheels} is locked",
        "free": f"motor {wheels} gives nothing",
        "hard_over": f"motor {wheels} runs away",
        "all_wheel_slip": "all wheels slip",
    }
    return said.get(d.kind, f"{d.kind.replace('_', ' ')} {wheels}".strip())


def when(diagnosis: Diagnosis) -> str:
    """`from 3.210 s`, or until when it stood."""
    if diagnosis.cleared is None:
        return f"from {diagnosis.time:.3f} s"
    return f"{diagnosis.time:.3f} … {diagnosis.cleared:.3f} s"


def how_sure(diagnosis: Diagnosis) -> str:
    """`99 %`, and what else it could be."""
    others = f", or {', '.join(diagnosis.ambiguous_with)}" if diagnosis.ambiguous_with else ""
    return f"{100.0 * diagnosis.confidence:.0f} %{others}"


def nothing(run: Replayed) -> str:
    """What there is to say of a run without a diagnosis."""
    return NOTHING if run.judged > 0.0 else "no usable samples"


def blind(run: Replayed) -> str:
    """How long the method could not judge; empty where it always could."""
    if run.cannot_judge <= 0.0:
        return ""
    return f"cannot judge {run.cannot_judge:.1f} of {run.judged:.1f} s"


def verdict(runs: Sequence[Replayed]) -> str:
    """One sentence over all runs."""
    said = sum(len(run.diagnoses) for run in runs)
    many = f"{len(runs)} run{'s' if len(runs) != 1 else ''}"
    if not said:
        return f"{NOTHING} in {many}"
    where = sum(bool(run.diagnoses) for run in runs)
    return f"{said} diagnos{'es' if said != 1 else 'is'} in {where} of {many}"
