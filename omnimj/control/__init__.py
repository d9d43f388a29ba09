"""Control of a robot from what it measures: heading, allocation, wheel-speed loops, limits."""

from omnimj.control.cascade.controller import Controller, ControlState
from omnimj.control.cascade.limits import Reason
from omnimj.signals import Target, target_at

__all__ = ["ControlState", "Controller", "Reason", "Target", "target_at"]
