"""Methods for tests: one that knows the truth, one that always raises an alarm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnimj.signals import Array, Diagnosis, Measurement
from omnimj.studies.evaluation.cases import Case

DELAY = 0.05
"""After which the perfect method speaks [s]."""
WOLF = Diagnosis(0.2, "motor", (1,), 0.5)


@dataclass(frozen=True)
class Said:
    """State of a made-up method."""

    diagnoses: tuple[Diagnosis, ...]
    log: Array
    reconfiguration: None = None
    fault_estimate: None = None


class MadeUp:
    """Says what it was given when the time has come; takes back what has ended."""

    def __init__(self, known: list[Diagnosis], effectiveness: Array):
        self._known, self._effectiveness = known, effectiveness
        self.log_names = tuple(f"effectiveness_{i}" for i in range(1, 5))

    def start(self, measurement: Any) -> Said:
        return Said((), self._effectiveness)

    def step(self, state: Said, measurement: Measurement, command: Any = None, bias: float = 0.0) -> Said:
        due = tuple(d for d in self._known if d.time <= measurement.time)
        return state if due == state.diagnoses else Said(due, self._effectiveness)


def perfect(case: Case) -> MadeUp:
    """Names every fault `DELAY` after its onset; knows what is left of every torque constant."""
    known, left = [], np.ones(4)
    for fault in case.faults:
        wheels = () if fault.wheel is None else (fault.wheel,)
        channel = str(fault.numbers.get("channel", ""))
        end = None if fault.end is None else fault.end + 0.1
        time = fault.onset + DELAY
        known.append(Diagnosis(time, fault.kind, wheels, 1.0, channel=channel, cleared=end))
        if fault.wheel is not None and "loss" in fault.numbers:
            left[fault.wheel - 1] -= float(fault.numbers["loss"])
    return MadeUp(known, left * case.errors.torque_constants)


def crying_wolf(case: Case) -> MadeUp:
    """Accuses motor 1 in every run."""
    return MadeUp([WOLF], np.ones(4))
