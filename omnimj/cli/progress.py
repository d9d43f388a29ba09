"""A progress bar on a terminal, nothing in a pipe."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import TextIO

_WIDTH = 32


class ProgressBar:
    """`with ProgressBar() as bar: …bar.show(done, total)`; the line vanishes at the end."""

    def __init__(self, stream: TextIO | None = None):
        self._stream = sys.stderr if stream is None else stream
        self._on_terminal = self._stream.isatty()
        self._shown = -1

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._on_terminal and self._shown >= 0:
            self._write("\r\x1b[K")

    def show(self, done: int, total: int) -> None:
        """Draws the bar when the percentage has changed."""
        percent = 100 * done // total
        if not self._on_terminal or percent == self._shown:
            return
        self._shown = percent
        filled = _WIDTH * done // total
        self._write(f"\r{'█' * filled}{'·' * (_WIDTH - filled)} {percent:3d} %")

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()
