"""Output for terminals and pipes: robust streams, a progress bar, plain-text tables, notices."""

from __future__ import annotations

import codecs
import io
import json
import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

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
_ERROR_HANDLER = "omnimj-ascii"
_BAR_WIDTH, _PHASE_WIDTH = 32, 38  # with the percentage 80 columns
_BAR_STEPS = 1000


def _replace_unencodable(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(_ASCII_EQUIVALENTS.get(letter, "?") for letter in text), error.end


def prepare_streams() -> None:
    """Makes terminals without "≥" show ">=" instead of a traceback."""
    codecs.register_error(_ERROR_HANDLER, _replace_unencodable)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_ERROR_HANDLER)


def flush_output() -> None:
    """Flushes stdout; does nothing in a process that was started without it.

    Raises:
      OSError: The disk is full, or the reader of the pipe has gone.
    """
    if sys.stdout is not None:
        sys.stdout.flush()


def drop_output() -> None:
    """Discards buffered output that cannot be written; Python would report it at exit."""
    try:
        flush_output()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class ProgressBar:
    """Progress bar on a terminal, nothing in a pipe.

    `with ProgressBar() as bar: …bar.show(done, total)`; the line vanishes at the end.
    """

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
        """Draws the bar when the percentage or the phase has changed."""
        percent = 100 * done // total
        if not self._on_terminal or (percent, phase) == self._shown:
            return
        self._shown = (percent, phase)
        filled = _BAR_WIDTH * done // total
        # clears the rest of the line, where a longer phase may have been
        words = f"  {phase[:_PHASE_WIDTH]}\x1b[K" if phase else ""
        self._write(f"\r{'█' * filled}{'·' * (_BAR_WIDTH - filled)} {percent:3d} %{words}")

    def show_share(self, phase: str, share: float) -> None:
        """Draws the bar for a share of the work, 0 … 1."""
        self.show(round(_BAR_STEPS * min(max(share, 0.0), 1.0)), _BAR_STEPS, phase)

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()


def format_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Formats left-aligned columns two spaces apart, without trailing spaces."""
    lines = [list(header), *(list(row) for row in rows)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def format_json(content: Any) -> str:
    """Formats a JSON value for people: indented, with signs such as µ as they are."""
    return json.dumps(content, indent=2, ensure_ascii=False)


def format_study(
    parts: Iterable[str], tables: Iterable[Any], notes: Iterable[str], interrupted: bool, folder: Path
) -> str:
    """Joins what a study prints: its sentences, its titled tables, notes, and where the files are.

    Args:
      parts: Paragraphs before the tables.
      tables: Records with `title`, `head` and `rows`; empty ones are left out.
      notes: Paragraphs after the tables.
      interrupted: Whether Ctrl-C ended the study.
      folder: Folder of its files.
    """
    shown = [f"{one.title}\n{format_table(one.head, one.rows)}" for one in tables if one.rows]
    resumed = ["interrupted; the same command resumes it"] if interrupted else []
    return "\n\n".join((*parts, *shown, *notes, *resumed, f"written to {folder}"))


def format_value(value: float | None, unit: str = "") -> str:
    """Formats a number with four digits and its unit; None is a dash."""
    return "–" if value is None else f"{value:.4g} {unit}".rstrip()


def announce_compilation(plant: str, machine: str, kind: str = "plant") -> None:
    """Prints one line on stderr if native code must be compiled first, which is the case once.

    Args:
      plant: `twin` or `planar`, or the name of a method.
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
    """Remembers that the native code for this kind of plant is compiled."""
    from omnimj.physics.native import mark_compiled

    mark_compiled(f"{plant}-{machine}")
