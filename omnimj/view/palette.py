"""Colours that colour-blind readers can distinguish; each wheel has the same one in all plots."""

from __future__ import annotations

WHEELS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6D1F", "#666666")
"""Colours of the wheels in their order, from the palette of Okabe and Ito."""
WHEEL_LINES = ("-", (0, (6, 1.5)), (0, (3, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
"""Dash patterns that distinguish the wheels in print without colour."""
PLANNED = "#5A5F66"
MEASURED = "#0072B2"
ACCENT = "#D55E00"
BEFORE, AFTER = ACCENT, MEASURED
"""Simulated without and with the effects that a model has lacked."""
FAULT = "#E69F00"
FAULT_INK = "#7A4B00"
DIAGNOSIS = "#56B4E9"
HEALTHY = "#3E8E6B"
INK = "#1D2733"
MUTED = "#5A6572"
GRID = "#DDE2E8"
TRACTION = "#00966B"
NORMAL = "#56B4E9"

STATES = {
    "healthy": HEALTHY,
    "no fault": HEALTHY,
    "suspect": "#F0C94A",
    "faulty": "#C44E0B",
    "cannot judge": "#B9C0C9",
    "slip": "#E69F00",
    "all wheels slip": "#B87A00",
    "motor loss": "#C44E0B",
    "motor fault": "#C44E0B",
    "motor free": "#CC79A7",
    "wheel locked": "#0072B2",
    "motor runs away": "#8A2BE2",
    "as planned": HEALTHY,
    "compensating": "#0072B2",
    "slip capped": "#E69F00",
    "slowed down": "#B87A00",
    "turning about a wheel": "#8A2BE2",
    "stopping": "#B22222",
    "recovery reverted": "#777777",
    "torque constant is estimated": "#F0C94A",
    "torque constant was estimated": "#7FB8DA",
}
"""Colours of true and diagnosed states, the same in all views."""
METHODS: dict[str, tuple[str, str | tuple[int, tuple[float, ...]], float]] = {
    "off": ("#A9B1BA", "-", 3.2),
    "published": ("#D55E00", (0, (6, 1.5)), 1.5),
    "robust": ("#0072B2", "-", 1.3),
}
"""Colour, dash pattern and line width [points] by method, distinguishable when overlaid."""
_OTHER_STATES = ("#56B4E9", "#8C6D1F", "#6A5ACD", "#777777", "#B22222", "#2F8F9D")


def state_color(state: str) -> str:
    """Return the colour of a state; that of an unknown state depends only on its name."""
    return STATES.get(state) or _OTHER_STATES[sum(state.encode()) % len(_OTHER_STATES)]


def wheel_color(i: int) -> str:
    """Return the colour of wheel i, counted from 0."""
    return WHEELS[i % len(WHEELS)]


def wheel_line(i: int) -> str | tuple[int, tuple[float, ...]]:
    """Return the dash pattern of wheel i, counted from 0."""
    return WHEEL_LINES[i % len(WHEEL_LINES)]


def rgb(color: str) -> tuple[int, int, int]:
    """Convert `#RRGGBB` to three numbers from 0 to 255."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def lighter(color: str, share: float = 0.5) -> str:
    """Mix a colour with white; share 0 keeps it, 1 is white."""
    mixed = (round(channel + (255 - channel) * share) for channel in rgb(color))
    return "#" + "".join(f"{channel:02X}" for channel in mixed)


def ink_on(color: str) -> str:
    """Return black or white, whichever is readable on a colour."""
    red, green, blue = rgb(color)
    return INK if 0.299 * red + 0.587 * green + 0.114 * blue > 140 else "#FFFFFF"
