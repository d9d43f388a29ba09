"""What to do about what is believed: the robot is kept on its job with what is left of it."""

from omnimj.control.gains import RecoveryGains
from omnimj.control.recovery.supervisor import Recovery, RecoveryState

__all__ = ["Recovery", "RecoveryGains", "RecoveryState"]
