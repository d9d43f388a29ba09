"""Diagnosis for missions: a force balance without a friction law, and slip against an inertial velocity."""

from omnimj.control.robust.gains import ObserverGains
from omnimj.control.robust.method import Robust, RobustState

__all__ = ["ObserverGains", "Robust", "RobustState"]
