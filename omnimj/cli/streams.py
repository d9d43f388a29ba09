"""Makes the standard streams safe to write to: any encoding, a full disk, a reader that has gone."""

from __future__ import annotations

import codecs
import io
import os
import sys

_PLAIN = {
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
_PLAINLY = "omnimj-plainly"


def _plainly(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(_PLAIN.get(letter, "?") for letter in text), error.end


def prepare_streams() -> None:
    """Lets a terminal that has no "≥" show ">=" instead of a traceback."""
    codecs.register_error(_PLAINLY, _plainly)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_PLAINLY)


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
