"""Operator of a drive by hand: terminal and gamepad, read once per control step, and a status line."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from omnimj.signals import Target
from omnimj.simulate.teleop.devices import GamepadReader
from omnimj.simulate.teleop.steering import DIRECTIONS, Key, KeyReader, Steering

STALE_AFTER = 0.1
"""Time between two reads beyond which directions typed meanwhile are outdated and ignored [s]."""
_DISPLAY_PERIOD = 0.1  # [s]


class KeyInput(Protocol):
    """Source of key bytes: `Terminal`."""

    def read(self) -> bytes | None:
        """Bytes typed since the last call; None when the terminal is gone."""
        ...

    def show(self, line: str) -> None:
        """Write one line over the previous one."""
        ...


class GamepadInput(Protocol):
    """Source of stick events: `Gamepad`."""

    def read(self) -> bytes | None:
        """Bytes since the last call; None when the gamepad is gone."""
        ...


class Operator:
    """Source of targets for `drive_by_hand`, which ends on a key or when the terminal is gone."""

    def __init__(
        self,
        steering: Steering,
        period: float,
        keyboard: KeyInput,
        pad: GamepadInput | None = None,
        clock: Callable[[], float] = time.monotonic,
        status: Callable[[], str] = str,
    ):
        """Connect an operator at a terminal, with a gamepad if there is one.

        Args:
          steering: Steering that makes the targets.
          period: Control period [s].
          keyboard: Source of keys.
          pad: Source of stick events; None without a gamepad.
          clock: Monotonic clock [s].
          status: Function that returns text to append to the status line.
        """
        self._steering, self._period, self._keyboard, self._pad = steering, period, keyboard, pad
        self._clock, self._status = clock, status
        self._keys, self._sticks = KeyReader(), GamepadReader()
        self._last_read = self._last_shown = clock()

    def target(self, heading: float, time_scaling: float) -> Target | None:
        """Target of the coming control period; None when the operator ends the drive.

        Args:
          heading: The controller's estimate of the robot's heading [rad].
          time_scaling: Share of the demanded speed that recovery allows, 0…1.
        """
        now = self._clock()
        if not self._read_keys(now):
            return None
        if self._pad is not None:
            self._read_gamepad(now)
        target = self._steering.target(now, self._period, heading, time_scaling)
        if now - self._last_shown >= _DISPLAY_PERIOD:
            self._last_shown = now
            x, y, turn = self._steering.twist
            self._keyboard.show(f"{x:+.2f} {y:+.2f} m/s {turn:+.2f} rad/s  {self._status()}")
        return target

    def _read_keys(self, now: float) -> bool:
        """Process typed keys; False ends the drive."""
        content, old = self._keyboard.read(), now - self._last_read > STALE_AFTER
        self._last_read = now
        if content is None:
            return False
        for key in self._keys.feed(now, content):
            if key is Key.END:
                return False
            if not (old and key in DIRECTIONS):
                self._steering.on_key(now, key)
        return True

    def _read_gamepad(self, now: float) -> None:
        """Process gamepad events; losing the gamepad stops the robot."""
        assert self._pad is not None
        content = self._pad.read()
        if content is None:
            self._pad = None
            self._steering.stop(now)
        elif content:
            stick, stops = self._sticks.feed(content)
            self._steering.on_stick(now, stick)
            if stops:
                self._steering.stop(now)
