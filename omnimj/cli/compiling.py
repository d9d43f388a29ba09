"""Says before the first run on a kind of plant that native code is compiled, and never again."""

from __future__ import annotations

import sys


def say_compiling(plant: str, machine: str, kind: str = "plant") -> None:
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
