"""Rerun recordings of a run: written as `run.rrd`, or streamed in batches during the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omnimj.parameters import Rig
from omnimj.signals import Array, Trace
from omnimj.simulate.run import RunResult
from omnimj.simulate.scenario.scenario import Scenario
from omnimj.view import wording
from omnimj.view.motion import planned_position
from omnimj.view.poses import Poses, visible_poses
from omnimj.view.rerun.blueprint import Eye, focus_of, run_blueprint
from omnimj.view.rerun.scene import (
    AROUND,
    MACHINE,
    NORMAL_SCALE,
    TRACTION_SCALE,
    Machine,
    Trail,
    begin_recording,
    log_floor,
    log_planned,
    recording_file,
)
from omnimj.view.rerun.signals import Signals, eventful_lanes, log_states, plots_of, with_columns

_FORCES = (
    f"**Green arrows**: traction, {1000 * TRACTION_SCALE:.0f} mm per N. "
    f"**Light blue arrows**: normal force, {1000 * NORMAL_SCALE:.0f} mm per N. "
)
_PATHS = (
    "**Blue line**: driven path. **Grey line**: planned path. **Light blue area**: a patch of other floor. "
)
_ROLLERS = "The dark stripes show how the rollers turn."


def write_recording(
    path: Path,
    trace: Trace,
    scenario: Scenario,
    metrics: Mapping[str, Any],
    poses: Poses | None = None,
) -> None:
    """Write a run as a Rerun recording, in full or not at all; without poses it has no machine."""
    with recording_file(path, "omnimj") as stream:
        stream.send_blueprint(whole_blueprint(scenario, trace, metrics, poses is not None), make_active=False)
        run = RunStream(stream, scenario, float(trace["time"][-1]))
        run.begin(metrics, planned_position(trace), None if poses is None else poses.mj_model)
        run.add(trace, poses)
        run.end(trace, metrics)


class RunStream:
    """Run sent to a stream: static content, then batches of signals and poses, finally the results."""

    def __init__(self, stream: rr.RecordingStream, scenario: Scenario, duration: float):
        """Prepare the stream of a run that lasts at most `duration` [s]."""
        self._stream, self._scenario, self._duration = stream, scenario, duration
        self._machine: Machine | None = None
        self._signals: Signals | None = None
        self._trail: Trail | None = None
        self._planned: Array | None = None
        self._known: Mapping[str, Any] = {}
        self._is_rig, self._wheels = scenario.is_rig, scenario.constants.wheel_count

    def begin(self, known: Mapping[str, Any], planned: Array | None, mj_model: mujoco.MjModel | None) -> None:
        """Send machine, floor and planned path, shape (k, 2) [m].

        `known` is the content of `metrics.json` that is known before the run.
        """
        stream = self._stream
        begin_recording(stream, wording.title(known))
        self._log_words(known)
        self._known = known
        self._planned = planned
        self._log_floor(np.empty((0, 2)))
        if planned is not None:
            log_planned(stream, planned)
        if mj_model is not None:
            self._machine = Machine(stream, mj_model)

    def stand(self, poses: Poses) -> None:
        """Send the machine at rest and healthy, visible until the first batch."""
        still = Trace({"time": poses.time})
        self.move(poses, still)
        nothing = {**self._known, "faults": (), "diagnoses": ()}
        log_states(self._stream, still, nothing, self._wheels, self._is_rig)

    def add(self, trace: Trace, poses: Poses | None) -> None:
        """Send the next rows, later than all before, and their poses where they are known."""
        if self._signals is None:
            method = str(self._known.get("method", wording.NOT_DIAGNOSED))
            plots = plots_of(self._scenario, method, list(trace.columns))
            self._signals = Signals(self._stream, with_columns(plots, trace))
        self._signals.add(trace)
        if "x" in trace:
            if self._trail is None:
                self._trail = Trail(self._stream, self._duration)
            self._trail.add(trace)
        if poses is not None:
            self.move(poses, trace)

    def move(self, poses: Poses, trace: Trace) -> None:
        """Send poses of the machine and the forces at its wheels."""
        if self._machine is not None:
            self._machine.log_motion(poses, trace)

    def end(self, trace: Trace, metrics: Mapping[str, Any]) -> None:
        """Send fault states, checks and the floor under the whole path."""
        log_states(self._stream, trace, metrics, self._wheels, self._is_rig)
        self._log_words(metrics)
        if "x" in trace:
            self._log_floor(np.column_stack([trace["x"], trace["y"]]))

    def _log_words(self, metrics: Mapping[str, Any]) -> None:
        words = rr.TextDocument(_about(self._scenario, metrics), media_type="text/markdown")
        self._stream.log("about", words, static=True)

    def _log_floor(self, driven: Array) -> None:
        points = [np.zeros((1, 2)), driven]
        if self._planned is not None:
            points.append(self._planned)
        points.append(_rig_reach(self._scenario.rig) if self._is_rig else np.empty((0, 2)))
        log_floor(self._stream, np.concatenate(points), self._scenario.patches, self._scenario.floor)


def _rig_reach(rig: Rig) -> Array:
    """Return the points on the floor that the rig can always reach, shape (k, 2) [m]."""
    along, across = rig.rig.rail_length, rig.rig.lateral_travel
    return np.array([[along, 0.0], [0.0, -across], [0.0, across]])


def whole_blueprint(
    scenario: Scenario, trace: Trace, metrics: Mapping[str, Any], has_machine: bool
) -> rrb.Blueprint:
    """Make the blueprint of a finished run: playback starts, and all axes cover the whole run."""
    method, duration = str(metrics.get("method", wording.NOT_DIAGNOSED)), float(trace["time"][-1])
    plots = with_columns(plots_of(scenario, method, list(trace.columns)), trace)
    start = (float(trace["x"][0]), float(trace["y"][0])) if "x" in trace else (0.0, 0.0)
    subject = focus_of(scenario, metrics.get("faults") or ())
    eye = first_eye(scenario, start, has_machine, subject.from_the_side)
    ranges = [plot.range(trace) for plot in plots]
    above = _eye_above(trace) if subject.from_above and "x" in trace else None
    lanes = eventful_lanes(metrics, duration)
    return run_blueprint(plots, duration, eye, ranges, lanes, subject, above)


def _eye_above(trace: Trace) -> Eye:
    """Place a camera above the middle of the path, high enough to show all of it."""
    places = [np.column_stack([trace["x"], trace["y"]])]
    planned = planned_position(trace)
    if planned is not None:
        places.append(planned)
    found = np.concatenate(places)
    low, high = np.nanmin(found, axis=0), np.nanmax(found, axis=0)
    (x, y), reach = (low + high) / 2.0, float((high - low).max())
    return Eye((float(x), float(y) - 0.01, 1.3 * reach + 0.8), (float(x), float(y), 0.0))


def live_blueprint(
    scenario: Scenario,
    duration: float | None,
    start: tuple[float, float],
    method: str = wording.NOT_DIAGNOSED,
    log_names: Sequence[str] = (),
    faults: Sequence[Mapping[str, Any]] = (),
) -> rrb.Blueprint:
    """Make the blueprint of a run in progress: it follows the newest data, and value axes grow.

    Without `duration` [s] the drive has no planned end; the robot starts at `start` [m]; faults as in
    `metrics.json`.
    """
    plots, subject = plots_of(scenario, method, log_names), focus_of(scenario, faults)
    eye = first_eye(scenario, start, True, subject.from_the_side)
    return run_blueprint(plots, duration, eye, subject=subject)


def first_eye(
    scenario: Scenario, start: tuple[float, float], has_machine: bool, from_the_side: bool = False
) -> Eye:
    """Place the first camera: near the robot, at its side on slopes, at the rig, above the path.

    The robot starts at `start` [m]; a recording without machine shows the path from above.
    """
    if scenario.is_rig:
        return Eye((0.1, 1.35, 0.65), (0.75, 0.0, 0.12))
    x, y = start
    if not has_machine:
        return Eye((x - 2.5, y - 2.5, 4.0), (x, y, 0.0))
    if from_the_side:
        return Eye((x + 0.1, y - 1.5, 0.25), (x + 0.1, y, 0.1), f"{MACHINE}/chassis/{AROUND}")
    return Eye((x - 0.66, y - 0.8, 0.6), (x, y, 0.07), f"{MACHINE}/chassis/{AROUND}")


def _about(scenario: Scenario, metrics: Mapping[str, Any]) -> str:
    floor = str(metrics.get("floor", scenario.floor)).replace("_", " ")
    lines = [scenario.description, ""]
    lines.append(f"Floor: {floor}. Method: {metrics.get('method', '–')}. Seed: {metrics.get('seed', '–')}.")
    lines.append("")
    for check in metrics.get("checks") or ():
        name, unit = check["name"], scenario.metric_units.get(check["name"], "")
        sign = "✓" if check["ok"] else "✗" if check.get("judged", True) else "–"
        value, limit = wording.number(check.get("value"), 3), wording.number(check.get("limit"), 3)
        bound = "at least" if check.get("bound") == "min" else "at most"
        lines.append(f"- {sign} {name.replace('_', ' ')}: {value} {unit} ({bound} {limit})")
    paths = "" if scenario.is_rig else _PATHS
    return "\n".join([*lines, "", _FORCES + paths + _ROLLERS])


def poses_of(run: RunResult) -> Poses | None:
    """Return the poses of the visible machine; None where they are unknown."""
    track = run.poses
    return visible_poses(run.scenario, run.trace, *((track.time, track.position) if track else ()))


def write_recording_of(path: Path, run: RunResult) -> None:
    """Write the Rerun recording of a run, in full or not at all."""
    write_recording(path, run.trace, run.scenario, run.metrics, poses_of(run))
