"""What a link may send."""

from __future__ import annotations

import enum

from omnimj.hardware.device_limits import is_zero
from omnimj.hardware.messages import Command, Frame, Hello, Ping


class Mode(enum.Enum):
    """What a link may send."""

    DRIVE = "drive"
    DRY_RUN = "dry run"
    """Hello, ping, and commands of zero; it is never armed."""
    READONLY = "readonly"
    """Hello and ping: a device tells its readings to whoever began the session."""

    def lets_through(self, frame: Frame) -> bool:
        """Whether a frame may leave."""
        if self is Mode.DRIVE or isinstance(frame.message, Hello | Ping):
            return True
        return self is Mode.DRY_RUN and isinstance(frame.message, Command) and is_zero(frame.message)
