"""The time series and fault states of a Rerun recording."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from omnimj.parameters import Rig
from omnimj.signals import Trace
from omnimj.view import palette
from omnimj.view.scene3d import thin
from omnimj.view.timeline import time_column
from omnimj.view.wording import Described, Span, diagnosis_spans, fault_spans

Array = NDArray[np.float64]
RATE = 200.0
"""Samples per second of the time series."""
TRUTH, BELIEF, MODE = "fault", "diagnosis", "mode"
FINE = "healthy"
_STATE_COLORS = ("#E69F00", "#D55E00", "#CC79A7", "#0072B2", "#56B4E9", "#8C6D1F")


@dataclass(frozen=True)
class Line:
    """One line of a plot."""

    column: str
    """Of the trace."""
    name: str
    """In the legend."""
    color: str
    scale: float = 1.0
    """From the column's unit to the plot's."""
    width: float = 1.6
    """[points]"""


@dataclass(frozen=True)
class Plot:
    """One time series view: where it lies, its heading with the unit, its lines."""

    entity: str
    heading: str
    lines: tuple[Line, ...]
    legend: bool = False
    """Whether it names its lines; wheels have the same colours everywhere and are named once."""

    def range(self, trace: Trace) -> tuple[float, float]:
        """Lowest and highest value with some room, for the axis."""
        values = [line.scale * trace[line.column] for line in self.lines]
        low = min((float(np.nanmin(v)) for v in values), default=0.0)
        high = max((float(np.nanmax(v)) for v in values), default=1.0)
        room = max(0.08 * (high - low), 1e-3)
        return low - room, high + room


def plots_of(scenario: Described) -> list[Plot]:
    """All the plots that a run of this scenario can have."""
    constants = scenario.constants
    if isinstance(constants, Rig):
        return _rig_plots(constants.wheel.radius)
    return _robot_plots(len(constants.wheels))


def _robot_plots(n: int) -> list[Plot]:
    """The plots of a robot with n wheels."""

    def wheels(column: str) -> tuple[Line, ...]:
        return tuple(Line(f"{column}_{i}", f"wheel {i}", palette.wheel_color(i - 1)) for i in range(1, n + 1))

    def targets(column: str) -> tuple[Line, ...]:
        return tuple(
            Line(f"{column}_{i}", f"target {i}", palette.lighter(palette.wheel_color(i - 1)), 1.0, 1.0)
            for i in range(1, n + 1)
        )

    degrees = 180.0 / np.pi
    heading = (
        Line("target_heading", "planned", palette.lighter(palette.PLANNED, 0.3), degrees, 1.2),
        Line("heading", "driven", palette.MEASURED, degrees),
    )
    return [
        Plot(
            "plots/wheel_speed",
            "Wheel speed, thin: target [rad/s]",
            wheels("wheel_speed") + targets("target_wheel_speed"),
            True,
        ),
        Plot("plots/slip_velocity", "Slip velocity [m/s]", wheels("slip_velocity")),
        Plot("plots/traction_force", "Traction [N]", wheels("traction_force")),
        Plot("plots/normal_force", "Normal force [N]", wheels("normal_force")),
        Plot("plots/current", "Current [A]", wheels("current")),
        Plot("plots/heading", "Heading [degrees]", heading, True),
    ]


def _rig_plots(wheel_radius: float) -> list[Plot]:
    """The plots of a rig's run."""
    speeds = (
        Line("wheel_speed", "wheel rim r·φ̇", palette.ACCENT, wheel_radius),
        Line("carriage_speed", "carriage", palette.MEASURED),
    )
    forces = (
        Line("traction_force_1", "traction", palette.TRACTION),
        Line("lateral_force_1", "lateral", palette.FAULT),
    )
    currents = (
        Line("current_target", "command", palette.lighter(palette.PLANNED, 0.3)),
        Line("current", "measured", palette.MEASURED),
    )
    return [
        Plot("plots/speed", "Wheel rim and carriage [m/s]", speeds, True),
        Plot(
            "plots/slip_velocity", "Slip velocity [m/s]", (Line("slip_velocity_1", "true", palette.ACCENT),)
        ),
        Plot("plots/force", "Traction and lateral force [N]", forces, True),
        Plot(
            "plots/normal_force",
            "Normal force [N]",
            (Line("normal_force_1", "normal force", palette.NORMAL),),
        ),
        Plot("plots/current", "Current [A]", currents, True),
        Plot(
            "plots/lateral_speed", "Lateral speed [m/s]", (Line("lateral_speed", "gantry", palette.HEALTHY),)
        ),
    ]


def with_columns(plots: Sequence[Plot], columns: Container[str]) -> list[Plot]:
    """The plots and lines for which there are columns."""
    kept = [replace(p, lines=tuple(line for line in p.lines if line.column in columns)) for p in plots]
    return [plot for plot in kept if plot.lines]


class Signals:
    """The time series on their way into a stream: one entity per plot, all its lines in each row."""

    def __init__(self, stream: rr.RecordingStream, plots: Sequence[Plot]):
        """Logs what the lines look like."""
        self._stream, self._plots = stream, plots
        for plot in plots:
            style = rr.SeriesLines(
                colors=[palette.rgb(line.color) for line in plot.lines],
                names=[line.name for line in plot.lines],
                widths=[line.width for line in plot.lines],
            )
            stream.log(plot.entity, style, static=True)

    def add(self, trace: Trace) -> None:
        """Logs the rows of a trace, `RATE` of them per second."""
        keep = thin(trace["time"], RATE)
        index = time_column(trace["time"][keep])
        for plot in self._plots:
            values = np.stack([line.scale * trace[line.column][keep] for line in plot.lines], axis=1)
            columns = rr.Scalars.columns(scalars=values.ravel())
            lengths = np.full(len(keep), len(plot.lines))
            self._stream.send_columns(plot.entity, [index], columns.partition(lengths))


def log_states(stream: rr.RecordingStream, trace: Trace, metrics: Mapping[str, Any], wheels: int) -> None:
    """What was broken and what the controller believed, a lane per wheel; the controller's mode.

    Args:
      stream: Where to log.
      trace: The whole run; its first row alone shows that nothing has happened yet.
      metrics: Content of `metrics.json`, as far as it is known.
      wheels: n.
    """
    duration = float(trace["time"][-1])
    _log_lanes(stream, TRUTH, fault_spans(metrics, duration), wheels)
    if metrics.get("diagnoses"):
        _log_lanes(stream, BELIEF, diagnosis_spans(metrics, duration), wheels)
    if "mode" in trace:
        _log_mode(stream, trace)


def _log_lanes(stream: rr.RecordingStream, entity: str, spans: Sequence[Span], wheels: int) -> None:
    all_wheels = {f"wheel_{i}" for i in range(1, wheels + 1)}
    for lane in sorted({span.lane for span in spans} | all_wheels):
        times, states = lane_states([span for span in spans if span.lane == lane])
        log_lane(stream, f"{entity}/{lane}", times, states)


def log_lane(stream: rr.RecordingStream, entity: str, times: Array, states: list[str]) -> None:
    """One lane of the state timeline with a colour per state; healthy is green and the rest is not."""
    values = [FINE, *sorted(set(states) - {FINE})]
    colors = [palette.HEALTHY, *(_STATE_COLORS[i % len(_STATE_COLORS)] for i in range(len(values) - 1))]
    rgba = [(*palette.rgb(color), 255) for color in colors]
    stream.log(entity, rr.StateConfiguration(values=values, labels=values, colors=rgba), static=True)
    stream.send_columns(entity, [time_column(times)], rr.StateChange.columns(state=states))


def lane_states(spans: Sequence[Span]) -> tuple[Array, list[str]]:
    """Times of change and the state from then on; faults that hold at once are joined by `+`."""
    times = sorted({0.0, *(span.start for span in spans), *(span.end for span in spans)})
    states = []
    for time in times:
        held = [span.state for span in spans if span.start <= time < span.end]
        states.append(" + ".join(dict.fromkeys(held)) or FINE)
    return np.array(times), states


def _log_mode(stream: rr.RecordingStream, trace: Trace) -> None:
    names: Mapping[int, str] = trace.about.get("mode_names") or {}
    mode = trace["mode"].astype(int)
    rows = np.concatenate([[0], np.flatnonzero(np.diff(mode)) + 1])
    states = [str(names.get(value, f"mode {value}")) for value in mode[rows].tolist()]
    log_lane(stream, MODE, trace["time"][rows], states)
