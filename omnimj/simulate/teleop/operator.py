"""Who drives: terminal and gamepad read once per control step, steering told, a line shown now and then."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from omnimj.signals import Target
from omnimj.simulate.teleop.devices import GamepadReader
from omnimj.simulate.teleop.steering import DIRECTIONS, Key, KeyReader, Steering

STALE_AFTER = 0.1
"""Directions that were typed while nobody looked for so long may be old: they do not count [s]."""
_DISPLAY_PERIOD = 0.1  # [s]


class KeyInput(Protocol):
    """Where bytes of keys come from: `Terminal`."""

    def read(self) -> bytes | None:
        """What was typed since; None when it is gone."""
        ...

    def show(self, line: str) -> None:
        """Writes one line over the one before."""
        ...


class GamepadInput(Protocol):
    """Where events of sticks come from: `Gamepad`."""

    def read(self) -> bytes | None:
        """What has come; None when it is gone."""
        ...


class Operator:
    """Asks for the next target; ends with the key for it, and when the terminal is gone."""

    def __init__(
        self,
        steering: Steering,
        period: float,
        keyboard: KeyInput,
        pad: GamepadInput | None = None,
        clock: Callable[[], float] = time.monotonic,
        told: Callable[[], str] = str,
    ):
        """Who drives.

        Args:
          steering: Makes targets.
          period: Control period [s].
          keyboard: Always there.
          pad: A gamepad, where one is present.
          clock: Goes forward only [s].
          told: What else the line is to say.
        """
        self._steering, self._period, self._keyboard, self._pad = steering, period, keyboard, pad
        self._clock, self._told = clock, told
        self._keys, self._sticks = KeyReader(), GamepadReader()
        self._looked = self._shown = clock()

    def target(self, heading: float, pace: float) -> Target | None:
        """The target of the coming control period; None when the operator has had enough.

        Args:
          heading: Of the robot, as the controller believes [rad].
          pace: Share of the demand that recovery allows, 0…1.
        """
        now = self._clock()
        if not self._look(now):
            return None
        if self._pad is not None:
            self._feel(now)
        target = self._steering.target(now, self._period, heading, pace)
        if now - self._shown >= _DISPLAY_PERIOD:
            self._shown = now
            x, y, turn = self._steering.twist
            self._keyboard.show(f"{x:+.2f} {y:+.2f} m/s {turn:+.2f} rad/s  {self._told()}")
        return target

    def _look(self, now: float) -> bool:
        """Reads the keys; False at the end."""
        content, old = self._keyboard.read(), now - self._looked > STALE_AFTER
        self._looked = now
        if content is None:
            return False
        for key in self._keys.feed(now, content):
            if key is Key.END:
                return False
            if not (old and key in DIRECTIONS):
                self._steering.on_key(now, key)
        return True

    def _feel(self, now: float) -> None:
        """Reads the gamepad; one that is gone stops the robot."""
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
