"""Time series and fault states of a Rerun recording."""

from __future__ import annotations

from collections.abc import Collection, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import rerun as rr

from omnimj.control.recovery.modes import MODE_NAMES, NORMAL
from omnimj.parameters import Rig, Robot
from omnimj.signals import Array, Trace, equal_stretches
from omnimj.simulate.scenario.scenario import Scenario
from omnimj.view import palette
from omnimj.view.poses import thin
from omnimj.view.rerun.scene import time_column
from omnimj.view.residuals import Family, families
from omnimj.view.wording import (
    NOT_DIAGNOSED,
    RECOVERY,
    Span,
    diagnosis_spans,
    fault_spans,
    is_diagnosed,
    mode_name,
    recovery_spans,
)

RATE = 200.0
"""Samples per second of the time series."""


@dataclass(frozen=True)
class Line:
    """Line of a plot."""

    column: str
    """Column of the trace."""
    name: str
    """Label in the legend."""
    color: str
    scale: float = 1.0
    """Factor from the column's unit to the plot's."""
    width: float = 1.6
    """Width of the line [points]."""


@dataclass(frozen=True)
class Plot:
    """Time series view."""

    entity: str
    heading: str
    lines: tuple[Line, ...]
    legend: bool = False
    """True for a legend; plots by wheel need none, since a common legend names the wheels."""
    of_diagnosis: bool = False
    """True for residuals of a method, False for signals of the machine."""
    in_view: tuple[float, ...] = ()
    """Values that the value axis always includes."""

    def range(self, trace: Trace) -> tuple[float, float]:
        """Return the lowest and highest value with some margin, for the axis."""
        values = [line.scale * trace[line.column] for line in self.lines]
        low = min((*(float(np.nanmin(v)) for v in values), *self.in_view), default=0.0)
        high = max((*(float(np.nanmax(v)) for v in values), *self.in_view), default=1.0)
        room = max(0.08 * (high - low), 1e-3)
        return low - room, high + room


def plots_of(scenario: Scenario, method: str = NOT_DIAGNOSED, columns: Collection[str] = ()) -> list[Plot]:
    """Return all plots possible for a run, by the columns of its trace or of the method's log."""
    found = families(columns, method, scenario.diagnosis.printed)
    own = _rig_plots(scenario.rig) if scenario.is_rig else _robot_plots(scenario.robot)
    return [*own, *map(_residual_plot, found), *_effectiveness_plot(columns)]


def _residual_plot(family: Family) -> Plot:
    """Make the plot of one family of residuals with their thresholds, which are grey since most are equal."""
    lines = [Line(r.column, r.label, r.color) for r in family.residuals]
    for r in family.residuals:
        if r.threshold is not None:
            grey, name = palette.PLANNED, f"threshold, {r.label}"
            lines.append(Line(r.threshold, name, grey, 1.0, 1.0))
            if family.is_signed:
                lines.append(Line(r.threshold, f"− {name}", grey, -1.0, 1.0))
    unit = f" [{family.unit}]" if family.unit else ""
    heading = f"{family.heading}{', grey: threshold' if family.thresholds else ''}{unit}"
    # wheels are known by their colours; other residuals need a legend
    named = any(r.wheel is None for r in family.residuals) and len(lines) > 1
    return Plot(f"plots/residual_{family.name}", heading, tuple(lines), named, True)


def _effectiveness_plot(columns: Collection[str]) -> list[Plot]:
    found = [column for column in columns if column.startswith("effectiveness_")]
    lines = [
        Line(column, f"wheel {k}", palette.wheel_color(k - 1)) for k, column in enumerate(found, start=1)
    ]
    heading = "Effectiveness, 1 is healthy [1]"
    return [Plot("plots/effectiveness", heading, tuple(lines), True, True, (0.0, 1.0))] if lines else []


def _robot_plots(robot: Robot) -> list[Plot]:
    n = len(robot.wheels)

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
    gyro = (
        Line("twist_yaw", "true", palette.lighter(palette.PLANNED, 0.3), 1.0, 1.2),
        Line("yaw_rate", "gyro", palette.MEASURED),
    )
    accelerometer = (
        Line("acceleration_x", "along x", palette.MEASURED),
        Line("acceleration_y", "along y", palette.ACCENT),
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
        Plot("plots/yaw_rate", "Yaw rate [rad/s]", gyro, True),
        Plot("plots/acceleration", "Measured acceleration [m/s²]", accelerometer, True),
    ]


def _rig_plots(rig: Rig) -> list[Plot]:
    speeds = (
        Line("wheel_speed", "wheel rim r·φ̇", palette.ACCENT, rig.wheel.radius),
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
    """Select the plots and lines whose columns exist."""
    kept = [replace(p, lines=tuple(line for line in p.lines if line.column in columns)) for p in plots]
    return [plot for plot in kept if plot.lines]


def log_styles(stream: rr.RecordingStream, entity: str, lines: Sequence[Line]) -> None:
    """Log colours, names and widths of the lines of a plot."""
    style = rr.SeriesLines(
        colors=[palette.rgb(line.color) for line in lines],
        names=[line.name for line in lines],
        widths=[line.width for line in lines],
    )
    stream.log(entity, style, static=True)


def log_rows(stream: rr.RecordingStream, entity: str, index: rr.TimeColumn, rows: Array) -> None:
    """Log the values of all lines of a plot, shape (k, lines)."""
    columns = rr.Scalars.columns(scalars=rows.ravel())
    stream.send_columns(entity, [index], columns.partition(np.full(len(rows), rows.shape[1])))


class Signals:
    """Time series of a stream: one entity per plot, with all its lines in each row."""

    def __init__(self, stream: rr.RecordingStream, plots: Sequence[Plot]):
        """Log the styles of the lines."""
        self._stream, self._plots = stream, plots
        for plot in plots:
            log_styles(stream, plot.entity, plot.lines)

    def add(self, trace: Trace) -> None:
        """Log the rows of a trace, thinned to `RATE` per second."""
        keep = thin(trace["time"], RATE)
        index = time_column(trace["time"][keep])
        for plot in self._plots:
            values = np.stack([line.scale * trace[line.column][keep] for line in plot.lines], axis=1)
            log_rows(self._stream, plot.entity, index, values)


FAULT_LANE, DIAGNOSIS_LANE, MODE_LANE = "fault", "diagnosis", "mode"
HEALTHY, AS_PLANNED = "healthy", MODE_NAMES[NORMAL]


def log_states(
    stream: rr.RecordingStream, trace: Trace, metrics: Mapping[str, Any], wheels: int, is_rig: bool
) -> None:
    """Log true faults and diagnoses, a lane per wheel, and the mode of the method."""
    duration = float(trace["time"][-1])
    _log_lanes(stream, FAULT_LANE, fault_spans(metrics, duration), wheels)
    if is_diagnosed(metrics):
        _log_lanes(stream, DIAGNOSIS_LANE, diagnosis_spans(metrics, duration), wheels)
    if "mode" in trace:
        _log_mode(stream, trace, str(metrics.get("method")), is_rig)
    if RECOVERY in trace:
        times, states = lane_states(recovery_spans(trace))
        log_lane(stream, RECOVERY, times, [AS_PLANNED if state == HEALTHY else state for state in states])


def eventful_lanes(metrics: Mapping[str, Any], duration: float) -> list[str]:
    """Return the entities of the lanes with events in a run of `duration` [s]; all lanes if none has any.

    A wheel with a fault also gets a lane of diagnoses, even if empty.
    """
    true = {span.lane for span in fault_spans(metrics, duration)}
    named = true | {span.lane for span in diagnosis_spans(metrics, duration)}
    lanes = [f"/{FAULT_LANE}/{lane}" for lane in sorted(true)] + [
        f"/{DIAGNOSIS_LANE}/{lane}" for lane in sorted(named)
    ]
    return [*(lanes or (f"/{FAULT_LANE}/**", f"/{DIAGNOSIS_LANE}/**")), f"/{MODE_LANE}", f"/{RECOVERY}"]


def _log_lanes(stream: rr.RecordingStream, entity: str, spans: Sequence[Span], wheels: int) -> None:
    all_wheels = {f"wheel_{i}" for i in range(1, wheels + 1)}
    for lane in sorted({span.lane for span in spans} | all_wheels):
        times, states = lane_states([span for span in spans if span.lane == lane])
        log_lane(stream, f"{entity}/{lane}", times, states)


def log_lane(stream: rr.RecordingStream, entity: str, times: Array, states: list[str]) -> None:
    """Log states that begin at given times, shape (k,) [s]; a state has one colour in all lanes."""
    values = sorted(set(states), key=lambda state: (state != HEALTHY, state))
    colors = [(*palette.rgb(palette.state_color(state)), 255) for state in values]
    stream.log(entity, rr.StateConfiguration(values=values, labels=values, colors=colors), static=True)
    stream.send_columns(entity, [time_column(times)], rr.StateChange.columns(state=states))


def lane_states(spans: Sequence[Span]) -> tuple[Array, list[str]]:
    """Return times of change, shape (k,) [s], and states; simultaneous faults are joined by `+`."""
    times = sorted({0.0, *(span.start for span in spans), *(span.end for span in spans)})
    states = []
    for time in times:
        held = [span.state for span in spans if span.start <= time < span.end]
        states.append(" + ".join(dict.fromkeys(held)) or HEALTHY)
    return np.array(times), states


def _log_mode(stream: rr.RecordingStream, trace: Trace, method: str, is_rig: bool) -> None:
    mode = trace["mode"].astype(int)
    rows = equal_stretches(mode)
    states = [mode_name(method, is_rig, value) for value in mode[rows].tolist()]
    log_lane(stream, MODE_LANE, trace["time"][rows], states)
