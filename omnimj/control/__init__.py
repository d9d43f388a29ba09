"""Control of a robot from its measurements.

- `cascade/`: heading → inverse kinematics → wheel-speed PI → limits
- `detection/`: fault detectors beside the cascade, the published one and the robust one
- `recovery/`: target and reconfiguration of the cascade after a fault
- `fault_tolerant`: cascade, any detector and recovery together, used like the cascade alone
- `compiled`: the same with the robust detector, as one compiled step
- `records`: structured arrays that carry parameters and states into kernels
- `gains`: all gains as one set and as a TOML file
- `robot_constants`: constants that detection and recovery share

numpy, scipy and numba are enough to run all of it, on a robot's small computer too.
"""

from omnimj.control.cascade.controller import Controller, ControlState
from omnimj.control.cascade.limits import Reason
from omnimj.signals import Target, target_at

__all__ = ["ControlState", "Controller", "Reason", "Target", "target_at"]
