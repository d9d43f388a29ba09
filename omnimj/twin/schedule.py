"""What holds at which time in a twin: faults over effects, written into the compiled model."""

from __future__ import annotations

import math
from collections.abc import Sequence

from omnimj.effects import Applied
from omnimj.plant.conditions import Fault, conditions, event_times
from omnimj.plant.effects import lay_over
from omnimj.twin.conditions_in_model import Healthy


def floors_of(faults: Sequence[Fault]) -> tuple[str, ...]:
    """Names of the floors that faults may put under a wheel."""
    return tuple(str(f.numbers["floor"]) for f in faults if "floor" in f.numbers)


class Schedule:
    """Conditions by time: the next change is one comparison away from every step."""

    def __init__(self, faults: Sequence[Fault], effects: Applied, measured_current: bool, healthy: Healthy):
        self._faults, self._effects, self._measured = faults, effects, measured_current
        self._healthy, self._times = healthy, event_times(faults)
        self.next_change = math.inf

    def start(self) -> None:
        """Applies what holds at time 0."""
        self.apply(0.0)

    def apply(self, time: float) -> None:
        """Applies what holds at a time and notes when that changes."""
        effects = self._effects
        now = conditions(self._faults, time, effects.machine.motor, len(effects.terms))
        self._healthy.apply(lay_over(now, effects, self._measured))
        later = [t for t in self._times if t > time + 1e-9]
        self.next_change = min(later, default=math.inf)
