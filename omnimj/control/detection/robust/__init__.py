"""Robust fault detection for missions: force balance without a friction law, slip against inertial velocity.

Samples are averaged over blocks of 10 ms; each block updates two channels and then the decisions.

- `detector`: `RobustDetector`, from measurement to diagnoses
- `blocks`: alignment of the channels, block means, frozen and noisy sensors
- `force_balance` → `parameter_filter` → `glr`: the force channel, for motors and accelerometer
- `slip` → `wheel_monitors`: the slip channel, for slipping, locked and disobeying wheels
- `evidence`: memory of both channels and its update by one block
- `decision`, `thresholds`, `verdict`: from evidence to diagnoses
- `accommodation`: how the observers live with a diagnosed fault, and the fault estimate for recovery
"""

from omnimj.control.detection.robust.detector import RobustDetector, RobustState
from omnimj.control.gains import ObserverGains

__all__ = ["ObserverGains", "RobustDetector", "RobustState"]
