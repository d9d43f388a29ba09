"""A scenario of half a second for tests."""

from __future__ import annotations

from pathlib import Path

PUSH = """description = "A short push along y"
plant = "uto_robot"
floor = "pvc"
duration = {duration}

[drive]
kind = "profile"
direction = 1.5707963267948966
speed = 0.4
acceleration = 2.0
start_time = 0.05
cruise_time = 0.05
"""
WEAK = """
[[faults]]
kind = "motor"
wheel = 1
onset = 0.1
loss = 0.6
"""


def scenario_file(folder: Path, name: str = "push", duration: float = 0.6, faults: str = WEAK) -> str:
    """Writes the scenario; its path."""
    file = folder / f"{name}.toml"
    file.write_text(PUSH.format(duration=duration) + faults, encoding="utf-8")
    return str(file)
