"""Colours that a colour-blind reader can tell apart, the same for a wheel in every plot and recording."""

from __future__ import annotations

WHEELS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6D1F", "#666666")
"""Okabe and Ito's palette, in the order of the wheels."""
WHEEL_LINES = ("-", (0, (6, 1.5)), (0, (3, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
"""Dashes, so that the wheels also differ in print without colour."""
PLANNED = "#5A5F66"
MEASURED = "#0072B2"
ACCENT = "#D55E00"
FAULT = "#E69F00"
FAULT_INK = "#7A4B00"
DIAGNOSIS = "#56B4E9"
HEALTHY = "#3E8E6B"
INK = "#1D2733"
MUTED = "#5A6572"
GRID = "#DDE2E8"
TRACTION = "#00966B"
NORMAL = "#56B4E9"


def wheel_color(i: int) -> str:
    """Colour of wheel i, counted from 0."""
    return WHEELS[i % len(WHEELS)]


def wheel_line(i: int) -> str | tuple[int, tuple[float, ...]]:
    """Dashes of wheel i, counted from 0."""
    return WHEEL_LINES[i % len(WHEEL_LINES)]


def rgb(color: str) -> tuple[int, int, int]:
    """`#RRGGBB` as three numbers from 0 to 255."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def lighter(color: str, share: float = 0.5) -> str:
    """The colour mixed with white; share 0 leaves it, 1 is white."""
    mixed = (round(channel + (255 - channel) * share) for channel in rgb(color))
    return "#" + "".join(f"{channel:02X}" for channel in mixed)
