"""Progress of long work: a bar with the time left on a terminal, a line per tenth of the work in a pipe."""

from __future__ import annotations

import io
import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, TextIO

_LOG = logging.getLogger(__name__)
_BAR_WIDTH, _PHASE_WIDTH = 22, 36  # 80 columns together with percentage and time left
_BAR_STEPS = 1000
_KNOWN_AFTER, _KNOWN_SHARE = 2.0, 0.03  # [s], share of the work: an earlier estimate would jump
_LINE_INTERVAL = 5.0  # [s] between two lines in a pipe; shorter work stays silent there
_NOTICE_AFTER = 0.5  # [s]

_notice: threading.Timer | None = None


class ProgressBar:
    """Progress bar on a terminal; in a pipe, a line per tenth of the work, at most every 5 s.

    `with ProgressBar() as bar: …bar.show(done, total)`; the bar is erased at the end. The time left is that
    of the present phase, elapsed · (1 − share)/share.
    """

    def __init__(self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic):
        self._stream, self._clock = sys.stderr if stream is None else stream, clock
        self._on_terminal = self._stream.isatty()
        self._shown: tuple[int, str] | None = None
        self._phase, self._begin, self._tenth = "", clock(), 0
        self._last_line = self._begin  # time of the first call of `show`, then of the last line

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._on_terminal and self._shown is not None:
            self._write("\r\x1b[K")

    def show(self, done: int, total: int, phase: str = "") -> None:
        """Redraw the bar if the percentage or the phase has changed."""
        percent = 100 * done // total
        if (percent, phase) == self._shown:
            return
        now = self._clock()
        if self._shown is None:  # what came before, such as compiling, is no part of this work
            self._last_line = now
        if self._shown is None or phase != self._phase:
            self._phase, self._begin, self._tenth = phase, now, -1
        self._shown = (percent, phase)
        left = _time_left(now - self._begin, done / total)
        if percent // 10 != self._tenth:
            self._tenth = percent // 10
            _LOG.debug("%d %% %s", percent, phase)
            if not self._on_terminal and now - self._last_line >= _LINE_INTERVAL:
                self._last_line = now
                words = (f"{percent} %", phase, f"{left} left" if left else "")
                self._write(f"omnimj: {', '.join(word for word in words if word)}\n")
        if self._on_terminal:
            self._draw(done / total, percent, phase, left)

    def _draw(self, share: float, percent: int, phase: str, left: str) -> None:
        end_notice()
        filled = int(_BAR_WIDTH * share)
        # clears the rest of the line, which may hold a longer phase
        words = f"  {phase[:_PHASE_WIDTH]}" if phase else ""
        left = f"  {left} left" if left else ""
        self._write(f"\r{'█' * filled}{'·' * (_BAR_WIDTH - filled)} {percent:3d} %{left}{words}\x1b[K")

    def show_share(self, phase: str, share: float) -> None:
        """Redraw the bar for a share of the work, 0 … 1."""
        self.show(round(_BAR_STEPS * min(max(share, 0.0), 1.0)), _BAR_STEPS, phase)

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()


def progress_bar(arguments: Any) -> ProgressBar:
    """Make the progress bar of a command; with `--quiet` it shows nothing."""
    return ProgressBar(io.StringIO() if getattr(arguments, "quiet", False) else None)


def run_on_executor(arguments: Any, run: Callable[..., Any], config: Any) -> Any:
    """Run a study, such as `run_evaluation`, with the executor and the progress bar of a command."""
    from omnimj.studies.workers import open_executor

    with open_executor(arguments.executor, arguments.workers) as executor, progress_bar(arguments) as bar:
        return run(config, bar.show_share, executor)


def _time_left(elapsed: float, share: float) -> str:
    """Estimate of the time left as `m:ss`; empty while it is unknown."""
    if elapsed < _KNOWN_AFTER or share < _KNOWN_SHARE or share >= 1.0:
        return ""
    minutes, seconds = divmod(round(elapsed * (1.0 - share) / share), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"


@contextmanager
def start_notice(arguments: Any) -> Iterator[None]:
    """Write `loading …` to a terminal where nothing else has appeared after half a second."""
    global _notice
    if sys.stderr.isatty() and not arguments.quiet:
        _notice = threading.Timer(_NOTICE_AFTER, sys.stderr.write, ("loading …\n",))
        _notice.daemon = True
        _notice.start()
    try:
        yield
    finally:
        end_notice()


def end_notice() -> None:
    """Cancel the pending notice, because other output has appeared."""
    global _notice
    if _notice is not None:
        _notice.cancel()
        _notice = None


@contextmanager
def logging_to(arguments: Any) -> Iterator[None]:
    """Send the log of omnimj to `--log FILE`, and with `--verbose` to stderr."""
    from omnimj.errors import write_failure

    logger, handlers = logging.getLogger("omnimj"), []
    if arguments.verbose:
        handlers.append(logging.StreamHandler())
    if arguments.log is not None:
        try:
            handlers.append(logging.FileHandler(arguments.log, encoding="utf-8"))
        except OSError as error:
            raise write_failure(f"--log {arguments.log}", error) from None
    level = logger.level
    for handler in handlers:
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
        logger.addHandler(handler)
        logger.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        logger.setLevel(level)
        for handler in handlers:
            logger.removeHandler(handler)
            handler.close()
