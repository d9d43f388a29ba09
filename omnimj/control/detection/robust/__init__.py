"""Diagnosis for missions: a force balance without a friction law, and slip against an inertial velocity."""

from omnimj.control.detection.robust.detector import RobustDetector, RobustState
from omnimj.control.gains import ObserverGains

__all__ = ["ObserverGains", "RobustDetector", "RobustState"]
