"""What a scenario is about, and hence what its recording shows first.

The rules read the scenario's content, never its name: a scenario of one's own is arranged by them, too.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omnimj.parameters import Rig
from omnimj.view.wording import Described

_MOTORS = frozenset({"motor", "free", "locked", "hard_over"})
_SLIPS = frozenset({"slip", "all_wheel_slip"})
_PUSHES = frozenset({"payload", "slope"})
_LENGTHS = frozenset({"misalignment", "wheel_radius"})
_CHANNELS = {
    "yaw_rate": ("yaw_rate", "heading"),
    "yaw": ("yaw_rate", "heading"),
    "acceleration_x": ("acceleration",),
    "acceleration_y": ("acceleration",),
}


@dataclass(frozen=True)
class Subject:
    """What a spectator is to look at first."""

    heading: str = ""
    """Of the plots that come first, short enough for a tab; empty where none is more to the point."""
    plots: tuple[str, ...] = ()
    """Which these are, from top to bottom: names under `plots/`."""
    wheels: tuple[int, ...] = ()
    """Wheels 1…n whose lines are bold in them; none: all are alike."""
    from_above: bool = False
    """Whether the path is shown from above, beside the machine."""
    from_the_side: bool = False
    """Whether the first eye stands at the side, where slopes are seen."""


@dataclass(frozen=True)
class _Rule:
    """Faults of some kinds, and the plots that show them."""

    kinds: Collection[str]
    heading: str
    plots: tuple[str, ...]


_RULES = (
    _Rule(
        _SLIPS,
        "Slip and traction",
        ("slip_velocity", "traction_force", "residual_slip"),
    ),
    _Rule(
        _MOTORS,
        "Motors",
        ("current", "effectiveness", "residual_motor"),
    ),
    _Rule(
        _PUSHES,
        "What pushes the robot",
        ("current", "residual_force"),
    ),
    _Rule(_LENGTHS, "Heading", ("heading", "yaw_rate")),
)
"""From the first that applies the heading is taken; the plots of all that apply follow one another."""
_RIG = Subject("Current, slip, speed", ("current", "slip_velocity", "speed"))


def subject_of(scenario: Described, faults: Sequence[Mapping[str, Any]]) -> Subject:
    """What a run of the scenario is about.

    Args:
      scenario: What is asked for.
      faults: As in `metrics.json`: `kind`, and `wheel` or `channel` where they have one.
    """
    if isinstance(scenario.constants, Rig):
        return _RIG
    kinds = [str(fault["kind"]) for fault in faults] + ["slip"] * len(scenario.patches)
    headings, plots = [], []
    for fault in faults:
        if fault["kind"] == "sensor":
            headings.append("The wrong sensor")
            plots += _of_channel(str(fault.get("channel", "")))
    for rule in _RULES:
        if any(kind in rule.kinds for kind in kinds):
            headings.append(rule.heading)
            plots += rule.plots
    slopes = scenario.scene is not None or "slope" in kinds
    path = "path_error_max" in scenario.metric_units
    if not plots and slopes:
        headings, plots = ["Load on slopes"], ["normal_force", "current"]
    elif not plots and path:
        headings, plots = ["Heading and wheels"], ["heading", "wheel_speed"]
    wheels = sorted({int(fault["wheel"]) for fault in faults if fault.get("wheel") is not None})
    heading = headings[0] if headings else ""
    return Subject(heading, tuple(dict.fromkeys(plots)), tuple(wheels), path, slopes)


def _of_channel(channel: str) -> tuple[str, ...]:
    """Plots of a sensor's channel: `wheel_speed_2` is in `wheel_speed`."""
    name, _, number = channel.rpartition("_")
    return _CHANNELS.get(channel) or ((name,) if number.isdecimal() else (channel,))
