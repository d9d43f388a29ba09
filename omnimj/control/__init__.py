"""Control of a robot from what it measures: heading, allocation, wheel-speed loops, limits."""

from omnimj.control.controller import Controller, ControlState
from omnimj.control.limits import Reason
from omnimj.control.target import Target, target_at

__all__ = ["ControlState", "Controller", "Reason", "Target", "target_at"]
