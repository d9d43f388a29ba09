"""What to do about what is believed: the robot is kept on its job with what is left of it."""

from omnimj.control.recovery.gains import RecoveryGains
from omnimj.control.recovery.recovery import Recovery, RecoveryState

__all__ = ["Recovery", "RecoveryGains", "RecoveryState"]
