"""How many frames a device answers: as many as its message rate allows, a burst at once."""

from __future__ import annotations

from omnimj.hardware.device_limits import credit_after, most_credit
from omnimj.hardware.messages import Limits


class Budget:
    """Credit of one sender, in frames."""

    def __init__(self, limits: Limits, now: float):
        """Full at first; `now` is the device's clock [s]."""
        self._limits, self._at = limits, now
        self.credit = most_credit(limits)

    def spend(self, now: float) -> bool:
        """Whether one more frame may be answered now; if so, it is paid for."""
        self.credit = credit_after(self._limits, self.credit, now - self._at)
        self._at = max(self._at, now)
        if self.credit < 1.0:
            return False
        self.credit -= 1.0
        return True
