"""Makes the standard streams safe to write to: any encoding, a full disk, a reader that has gone."""

from __future__ import annotations

import codecs
import io
import os
import sys
from collections.abc import Sequence
from types import TracebackType
from typing import TextIO

_ASCII_EQUIVALENTS = {
    "≥": ">=",
    "≤": "<=",
    "×": "x",
    "…": "...",
    "–": "-",
    "−": "-",
    "→": "->",
    "²": "2",
    "█": "#",
    "·": ".",
}
_ERROR_HANDLER = "omnimj-plainly"


def _replace_unencodable(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(_ASCII_EQUIVALENTS.get(letter, "?") for letter in text), error.end


def prepare_streams() -> None:
    """Lets a terminal that has no "≥" show ">=" instead of a traceback."""
    codecs.register_error(_ERROR_HANDLER, _replace_unencodable)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_ERROR_HANDLER)


def flush_output() -> None:
    """Passes on what was printed; nothing to do for a process that was started without stdout.

    Raises:
      OSError: Nobody takes it.
    """
    if sys.stdout is not None:
        sys.stdout.flush()


def drop_output() -> None:
    """Throws away what stdout still holds if nobody takes it, or Python would complain at its end."""
    try:
        flush_output()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


# A progress bar on a terminal, nothing in a pipe.

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


# Plain-text tables, for eyes and for pipes.


def format_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Left-aligned columns two spaces apart, without a space at the ends of lines."""
    lines = [list(header), *(list(row) for row in rows)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def format_value(value: float | None, unit: str = "") -> str:
    """A number in four digits with its unit; a dash where there is none."""
    return "–" if value is None else f"{value:.4g} {unit}".rstrip()


# Says before the first run on a kind of plant that native code is compiled, and never again.


def announce_compilation(plant: str, machine: str, kind: str = "plant") -> None:
    """One line on stderr before the wait, if there will be one.

    Args:
      plant: `twin` or `planar`, or a method.
      machine: `uto_robot` or `quarter_rig`.
      kind: `plant` or `method`.
    """
    from omnimj.physics.native import is_compiled

    if not is_compiled(f"{plant}-{machine}"):
        print(
            f"compiling native code for the {plant} {kind}, once, for up to a minute …",
            file=sys.stderr,
            flush=True,
        )


def note_compiled(plant: str, machine: str) -> None:
    """Remembers that a run on this kind of plant got beyond its first step."""
    from omnimj.physics.native import mark_compiled

    mark_compiled(f"{plant}-{machine}")
