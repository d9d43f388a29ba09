"""A progress bar on a terminal, nothing in a pipe."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import TextIO

_WIDTH, _PHASE = 32, 38  # columns of the bar, and of what is being done: 80 with the number


class ProgressBar:
    """`with ProgressBar() as bar: …bar.show(done, total)`; the line vanishes at the end."""

    def __init__(self, stream: TextIO | None = None):
        self._stream = sys.stderr if stream is None else stream
        self._on_terminal = self._stream.isatty()
        self._shown: tuple[int, str] | None = None

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._on_terminal and self._shown is not None:
            self._write("\r\x1b[K")

    def show(self, done: int, total: int, phase: str = "") -> None:
        """Draws the bar when the percentage has changed, or what is being done."""
        percent = 100 * done // total
        if not self._on_terminal or (percent, phase) == self._shown:
            return
        self._shown = (percent, phase)
        filled = _WIDTH * done // total
        # the end of a longer phase would stay behind a shorter one
        words = f"  {phase[:_PHASE]}\x1b[K" if phase else ""
        self._write(f"\r{'█' * filled}{'·' * (_WIDTH - filled)} {percent:3d} %{words}")

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()
