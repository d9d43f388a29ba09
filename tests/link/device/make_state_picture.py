"""Draws the state machine of the device from what the real one does in an exhaustive search.

Run as `PYTHONPATH=tests/link python tests/link/device/make_state_picture.py` after a change of the
device; it writes the picture in `omnimj/docs/threats.md`.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

from session_model import EVENTS, at_power_up, driving, explored

import omnimj

PAGE = Path(omnimj.__file__).parent / "docs" / "threats.md"
BEGIN, END = "<!-- generated: states -->\n", "\n<!-- end -->"
DEPTH = 5
MODES = ("idle", "disarmed", "stopped", "faulty", "armed", "driving")
ALIKE = {"period whose telemetry is lost": "period", "move that answers an old telemetry": "move"}
"""Events that need no arrow of their own beside another one's."""


def picture() -> str:
    """Diagram of all transitions, one arrow per pair of states."""
    found = [explored(DEPTH, begin).transitions for begin in (at_power_up, driving)]
    arrows = defaultdict(set)
    for before, event, after in frozenset.union(*found):
        arrows[before, after].add(ALIKE.get(event, event))
    lines = ["stateDiagram-v2", "    [*] --> idle: power-up"]
    for before, after in sorted(arrows, key=lambda pair: [MODES.index(one) for one in pair]):
        names = ", ".join(name for name in EVENTS if name in arrows[before, after])
        lines.append(f"    {before} --> {after}: {names}")
    return "\n".join(["```mermaid", *lines, "```"])


def updated(text: str) -> str:
    """The page with its picture made anew."""
    before, found, rest = text.partition(BEGIN)
    _, closed, after = rest.partition(END)
    assert found and closed
    return before + BEGIN + picture() + END + after


if __name__ == "__main__":
    PAGE.write_text(updated(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
