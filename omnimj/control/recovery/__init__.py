"""Recovery: keeps the robot on its job after a fault.

- `recovery`: `Recovery`, from target and fault estimate to a target and a reconfiguration of the cascade
- `step`: one step of it as a kernel
- `modes`: what the remaining wheels can still do
- `demand`: position correction, turning about a wheel, slip cap, time scaling
- `force_allocation`: shares of the wheels in the wrench of the demanded motion
- `tracking`: position error and tracking error
- `dither`: excitation that reveals weak motors
"""

from omnimj.control.recovery.recovery import Recovery, RecoveryState

__all__ = ["Recovery", "RecoveryState"]
