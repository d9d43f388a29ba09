"""Output for terminals and pipes: robust streams, signals, plain-text tables, notices."""

from __future__ import annotations

import codecs
import contextlib
import io
import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from omnimj.cli.progress import end_notice

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


def _replace_unencodable(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(_ASCII_EQUIVALENTS.get(letter, "?") for letter in text), error.end


def prepare_streams() -> None:
    """Prepare the output streams: replace signs that a terminal lacks, "≥" by ">=", instead of failing."""
    codecs.register_error(_ERROR_HANDLER, _replace_unencodable)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_ERROR_HANDLER)


def flush_output() -> None:
    """Flush stdout; do nothing in a process without it.

    Raises:
      OSError: The disk is full, or the reader of the pipe has closed it.
    """
    if sys.stdout is not None:
        sys.stdout.flush()


def drop_output() -> None:
    """Discard buffered output that cannot be written and that Python would report at exit."""
    try:
        flush_output()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_result(text: str) -> None:
    """Print a result whose files are still to be written, so that a full disk does not cost it.

    Nor does a reader that closes the pipe, such as `head`.
    """
    with contextlib.suppress(BrokenPipeError):
        print(text, flush=True)


_ENDING = ("SIGTERM", "SIGHUP", "SIGBREAK")


@contextlib.contextmanager
def ended_by_signals() -> Iterator[None]:
    """Treat the signals that end a program like Ctrl-C, so that what was finished is kept.

    A signal that is ignored, as under nohup, stays ignored.
    """
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for name in _ENDING:
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_DFL:
                before[number] = signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number, action in before.items():
            signal.signal(number, action)


def format_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table of left-aligned columns two spaces apart, without trailing spaces."""
    lines = [list(header), *(list(row) for row in rows)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def format_data_faults(faults: Sequence[Mapping[str, Any]]) -> str:
    """Format the findings of the data check as a table, the most important first; empty without any."""
    if not faults:
        return ""
    rows = [
        ("sure" if one["sure"] else "likely", str(one["kind"]).replace("_", " "), str(one["words"]))
        for one in faults
    ]
    return f"data check\n{format_table(('certainty', 'kind', 'what'), rows)}"


def format_json(content: Any) -> str:
    """Format a JSON value for reading: indented, with signs such as µ unescaped."""
    return json.dumps(content, indent=2, ensure_ascii=False)


def format_study(
    parts: Iterable[str], tables: Iterable[Any], notes: Iterable[str], interrupted: bool, folder: Path
) -> str:
    """Join the printed parts of a study: paragraphs, titled tables with rows, notes, place of the files."""
    shown = [f"{one.title}\n{format_table(one.head, one.rows)}" for one in tables if one.rows]
    resumed = ["interrupted; the same command resumes it"] if interrupted else []
    return "\n\n".join((*parts, *shown, *notes, *resumed, f"written to {folder}"))


def print_study(folder: Path, json_file: str, text: Callable[[], str], as_json: bool) -> None:
    """Print a study: the JSON file in its folder with `--json`, else the text made by `text`."""
    if as_json:
        print((folder / json_file).read_text(encoding="utf-8"), end="")
    else:
        print(text())


def format_value(value: float | None, unit: str = "") -> str:
    """Format a number with four digits and its unit; None as a dash."""
    return "–" if value is None else f"{value:.4g} {unit}".rstrip()


def announce_compilation(plant: str, machine: str, kind: str = "plant", quiet: bool = False) -> None:
    """Report on stderr that a plant or method must be compiled first; a terminal counts the functions."""
    from omnimj.physics.native import is_compiled, on_compilation

    if quiet or is_compiled(f"{plant}-{machine}"):
        return
    end_notice()
    words = f"compiling native code for the {plant} {kind}, once, for up to a minute …"
    print(words, end="" if sys.stderr.isatty() else "\n", file=sys.stderr, flush=True)
    if sys.stderr.isatty():
        on_compilation(
            lambda count: print(f"\r{words} {count} functions", end="", file=sys.stderr, flush=True)
        )


def note_compiled(plant: str, machine: str) -> None:
    """Record that the native code for this kind of plant is compiled."""
    from omnimj.physics.native import is_compiled, mark_compiled, on_compilation

    if sys.stderr.isatty() and not is_compiled(f"{plant}-{machine}"):
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)
    on_compilation(None)
    mark_compiled(f"{plant}-{machine}")
