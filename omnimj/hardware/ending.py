"""What must happen however a program ends: by its end, Ctrl-C, SIGTERM, or because its terminal is gone."""

from __future__ import annotations

import atexit
import contextlib
import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any

_SIGNALS = ("SIGTERM", "SIGHUP", "SIGBREAK")


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


class AtTheEnd:
    """Calls `stop` when the program ends; makes SIGTERM and SIGHUP what Ctrl-C is, so that all is kept.

    Against kill -9, and a computer that hangs, there is only the device's own rule on the age of commands.
    """

    def __init__(self, stop: Callable[[], None]):
        """From now on, until `release`; signals where this is the main thread and nobody else has them."""
        self._stop, self._before = stop, dict[int, Any]()
        atexit.register(stop)
        if threading.current_thread() is not threading.main_thread():
            return
        for name in _SIGNALS:
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_DFL:
                self._before[number] = signal.signal(number, _interrupt)

    def release(self) -> None:
        """The program may end as it likes; may be called twice."""
        atexit.unregister(self._stop)
        for number, before in self._before.items():
            with contextlib.suppress(ValueError):  # another thread than the one that asked for it
                if signal.getsignal(number) is _interrupt:
                    signal.signal(number, before)
        self._before.clear()
