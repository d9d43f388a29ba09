"""What recovery held in a run and what it gave up, in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnimj.control.recovery.modes import GIVES_UP, NAMES, PIVOTING, indispensable
from omnimj.control.robust.constants import geometry
from omnimj.parameters import Rig, Robot
from omnimj.signals import Trace
from omnimj.view.wording import Span, recovery_spans

_COUNTS = {3: "three", 4: "four", 5: "five", 6: "six"}


@dataclass(frozen=True)
class Recovered:
    """One way in which recovery drove, over all stretches of the run in which it did."""

    name: str
    """`turning about wheel 2`."""
    spans: tuple[Span, ...]
    """When, in order."""
    gives_up: str
    """What cannot be held then."""

    @property
    def lasted(self) -> float:
        """In all [s]."""
        return sum(span.end - span.start for span in self.spans)

    @property
    def when(self) -> str:
        """`0.85 – 4.5 s`, or how often and how long in all."""
        first, last = self.spans[0].start, self.spans[-1].end
        words = f"{first:.3g} – {last:.3g} s"
        if len(self.spans) == 1:
            return words
        return f"{words}, {len(self.spans)} times, {self.lasted:.3g} s in all"


def recovered(trace: Trace, metrics: Mapping[str, Any]) -> list[Recovered]:
    """The ways in which recovery drove, in the order in which it first did; none for a run as planned.

    Args:
      trace: What was recorded.
      metrics: Content of `metrics.json`; its diagnoses say which wheels are believed broken.
    """
    found: dict[tuple[str, str], list[Span]] = {}
    sentences: dict[str, str] = dict(zip(NAMES, GIVES_UP, strict=True))
    for span in recovery_spans(trace):
        name, gives_up = span.state, sentences.get(span.state, "")
        if span.state == NAMES[PIVOTING]:
            wheel = _pivot(trace, metrics, span)
            name = span.state if wheel is None else f"turning about wheel {wheel}"
        found.setdefault((name, gives_up), []).append(span)
    return [Recovered(name, tuple(spans), gives_up) for (name, gives_up), spans in found.items()]


def _pivot(trace: Trace, metrics: Mapping[str, Any], span: Span) -> int | None:
    """The wheel that the robot turns about: of those believed broken then, the one that turns the least."""
    rows = (trace["time"] >= span.start) & (trace["time"] <= span.end)
    broken = {
        int(wheel)
        for diagnosis in metrics.get("diagnoses") or ()
        if float(diagnosis["time"]) <= span.end
        for wheel in diagnosis.get("wheels") or ()
        if f"wheel_speed_{wheel}" in trace
    }
    if not broken or not rows.any():
        return None
    return min(broken, key=lambda wheel: float(np.abs(trace[f"wheel_speed_{wheel}"][rows]).mean()))


def layout_words(constants: Robot | Rig) -> str:
    """What a robot of this layout cannot lose; empty where any one wheel can be lost.

    Without wheel i the columns of B that are left must have rank 3 for any force and moment.
    """
    if isinstance(constants, Rig):
        return ""
    n, needed = len(constants.wheels), indispensable(geometry(constants).forces)
    if not needed:
        return ""
    if len(needed) == n:
        return f"{_COUNTS.get(n, str(n))} wheels cannot lose one and be steered and turned at will"
    which = f"wheel{'s' if len(needed) > 1 else ''} {', '.join(map(str, needed))}"
    return f"it cannot lose {which} and be steered and turned at will"
