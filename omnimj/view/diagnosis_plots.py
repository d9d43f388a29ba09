"""What a diagnosing method looked at, over a run: residuals with their thresholds, and effectiveness."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omnimj.signals import Trace
from omnimj.view import palette
from omnimj.view.drawing import banded, finish, legend, new_figure, value_axis
from omnimj.view.wording import Span

_RESIDUAL = "residual_"
_UNITS = {
    "motor": "motor, Λ [nats]",
    "slip": "slip [m]",
    "force_x": "force x [N]",
    "force_y": "force y [N]",
    "force": "force [N]",
    "moment": "moment [N·m]",
    "wheel_speed": "wheel speed\n[rad/s]",
}


def families(names: Sequence[str]) -> dict[str, list[str]]:
    """Residuals by what they are of: those of wheels 1 … n belong together."""
    found: dict[str, list[str]] = {}
    for name in names:
        if name.startswith(_RESIDUAL):
            stem = re.sub(r"_\d+$", "", name.removeprefix(_RESIDUAL))
            found.setdefault(stem, []).append(name)
    return found


def residuals(trace: Trace, names: Sequence[str], spans: Sequence[Span]) -> Figure:
    """All residuals over time, a plot for each family; thresholds dotted.

    Args:
      trace: Of a run, with the method's columns.
      names: The method's columns.
      spans: Diagnoses to shade.
    """
    own = families(names)
    figure, axes = new_figure(0.7 + 1.35 * len(own), rows=len(own), sharex=True)
    wheels = 0
    for ax, (stem, columns) in zip(axes, own.items(), strict=True):
        for i, name in enumerate(columns):
            color, style = palette.wheel_color(i), {"linestyle": palette.wheel_line(i)}
            if len(columns) == 1:
                color, style = palette.INK, {}
            banded(ax, trace["time"], trace[name], color, label=f"wheel {i + 1}", **style)
        _thresholds(ax, trace, columns)
        value_axis(ax, _UNITS.get(stem, stem.replace("_", " ")))
        wheels = max(wheels, len(columns))
    finish(axes, trace["time"], spans)
    widest = max(own, key=lambda stem: len(own[stem]))
    if wheels > 1:
        legend(axes[list(own).index(widest)])
    return figure


def _thresholds(ax: Axes, trace: Trace, columns: Sequence[str]) -> None:
    """Of each residual that has one; on both sides where it has both signs."""
    known = set()
    for name in columns:
        threshold = f"threshold_{name.removeprefix(_RESIDUAL)}"
        if threshold not in trace:
            continue
        limit = float(trace[threshold][-1])
        sides = (limit, -limit) if float(np.min(trace[name])) < -0.05 * limit else (limit,)
        for side in sides:
            if np.isfinite(side) and side not in known:
                style = {"color": palette.INK, "linewidth": 1.1, "linestyle": (0, (2, 1.6)), "zorder": 4}
                ax.axhline(side, label=None if known else "threshold", **style)  # pyright: ignore[reportArgumentType]
                known.add(side)
    if known and min(known) > 0.0:
        # residuals that stay at zero would leave an axis on which the threshold is not seen
        top = 1.15 * max(*known, *(float(np.nanmax(trace[name])) for name in columns))
        ax.set_ylim(-0.05 * top, top)


def effectiveness(trace: Trace, spans: Sequence[Span]) -> Figure:
    """What is left of each wheel's drive over time [1]."""
    figure, (ax,) = new_figure(2.4)
    i = 0
    while f"effectiveness_{i + 1}" in trace:
        style = {"linestyle": palette.wheel_line(i), "label": f"wheel {i + 1}"}
        banded(ax, trace["time"], trace[f"effectiveness_{i + 1}"], palette.wheel_color(i), **style)
        i += 1
    ax.set_ylim(min(-0.05, ax.get_ylim()[0]), max(1.1, ax.get_ylim()[1]))
    value_axis(ax, "what is left [1]")
    finish([ax], trace["time"], spans)
    legend(ax)
    return figure
