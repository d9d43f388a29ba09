"""Live view of a run or a drive by hand in the Rerun viewer."""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omnimj.parameters import Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.plant.faults import fault_record
from omnimj.plant.interface import Plant
from omnimj.signals import Array, Reference, Trace
from omnimj.simulate.detectors import make_detector
from omnimj.simulate.loop import Callbacks
from omnimj.simulate.run import RunResult
from omnimj.simulate.scenario.scenario import Scenario
from omnimj.view.motion import planned_position
from omnimj.view.poses import Poses, poses_from_trace, visible_model, visible_poses
from omnimj.view.rerun.recording import RunStream, live_blueprint
from omnimj.view.rerun.scene import log_floor
from omnimj.view.wording import NOT_DIAGNOSED

_FLUSHING = 30.0  # [s] for a viewer on a slow machine to receive the remaining data


class RecordingSink(Protocol):
    """Destination of a live recording: a viewer, or a file."""

    @property
    def is_open(self) -> bool:
        """True if the destination still accepts data."""
        ...

    def connect(self, stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
        """Connect to a stream: receive everything logged to it from now on."""
        ...

    def settle(self) -> None:
        """Raise `ViewerError` if the viewer failed."""
        ...


class _LiveView:
    """Stream of a run in progress, with the poses since the last batch."""

    def __init__(self, scenario: Scenario, known: Mapping[str, Any], sink: RecordingSink, trail: float):
        """Prepare the stream; the path is drawn in full detail for `trail` [s]."""
        self._scenario, self._known, self._sink = scenario, known, sink
        self._stream = rr.RecordingStream("omnimj")
        self._run = RunStream(self._stream, scenario, trail)
        self._poses: list[tuple[float, Array]] = []
        self._mj_model: Any = None

    def snapshot(self, now: float, pose: Array) -> None:
        """Store a pose, shape (nq,), for the next batch; callback every `SNAPSHOT_PERIOD`."""
        self._poses.append((now, np.array(pose)))

    def _taken(self) -> list[tuple[float, Array]]:
        taken, self._poses = self._poses, []
        return taken

    def _moved(self, taken: Sequence[tuple[float, Array]]) -> Poses | None:
        """Return stored poses in one record; None without any."""
        if not taken:
            return None
        times, poses = zip(*taken, strict=True)
        return Poses(self._mj_model, np.array(times), np.stack(poses))

    def _open(self, duration: float | None, start: tuple[float, float], planned: Array | None) -> None:
        """Connect the sink, with the layout of a run in progress, and show machine and planned path.

        The path has the shape (k, 2) [m]; without `duration` [s] the run has no planned end.
        """
        method = str(self._known.get("method", NOT_DIAGNOSED))
        detector = make_detector(method, self._scenario)
        names = () if detector is None else tuple(detector.log_names)
        faults = [fault_record(fault) for fault in self._scenario.faults]
        layout = live_blueprint(self._scenario, duration, start, method, names, faults)
        self._sink.connect(self._stream, layout)
        self._mj_model = visible_model(self._scenario)
        self._run.begin(self._known, planned, self._mj_model)


class LiveRun(_LiveView):
    """Callbacks of `run_scenario` that show a run in progress; `finish` adds the results."""

    def __init__(self, scenario: Scenario, known: Mapping[str, Any], sink: RecordingSink):
        """Prepare to show a run, of which the entries `known` of `metrics.json` are known before."""
        super().__init__(scenario, known, sink, scenario.duration)
        self._plan: Reference | None = None if scenario.is_rig else scenario.robot_drive.reference
        self._rows = 0

    @property
    def callbacks(self) -> Callbacks:
        """Callbacks to pass to `run_scenario`."""
        return Callbacks(snapshot=self.snapshot, rows=self.rows, start=self.start)

    def start(self, _plant: Plant) -> None:
        """Show the machine at its start; callback before the first step."""
        self._begin(None if self._plan is None else self._plan.position)

    def _begin(self, planned: Array | None) -> None:
        start = (0.0, 0.0) if planned is None else (float(planned[0, 0]), float(planned[0, 1]))
        self._open(self._scenario.duration, start, planned)
        self._run.stand(self._first_pose())

    def _first_pose(self) -> Poses:
        if self._plan is None:
            return Poses(self._mj_model, np.zeros(1), self._mj_model.qpos0[None])
        (x, y), heading = self._plan.position[0], self._plan.heading[0]
        place = {"time": 0.0, "x": x, "y": y, "heading": heading}
        place |= {f"wheel_speed_{i}": 0.0 for i in range(1, len(self._scenario.constants.wheels) + 1)}
        return poses_from_trace(self._mj_model, Trace({name: np.array([at]) for name, at in place.items()}))

    def rows(self, names: tuple[str, ...], table: Array) -> None:
        """Send the newest rows, shape (k, len(names)), and their poses; callback per batch."""
        columns = dict(zip(names, table.T, strict=True))
        self._rows += len(table)
        if self._sink.is_open:
            self._run.add(Trace(columns), self._moved(self._taken()))

    def finish(self, run: RunResult) -> None:
        """Send the rest of the data, the fault states and the checks; the viewer then plays the run."""
        if self._sink.is_open:
            self._send_rest(run)
            self._stream.flush(timeout_sec=_FLUSHING)
        self.close()
        self._sink.settle()

    def close(self) -> None:
        """Close the stream; a failed run stays visible up to its failure."""
        self._stream.disconnect()

    def _send_rest(self, run: RunResult) -> None:
        trace, track = run.trace, run.poses
        if self._mj_model is None:  # the kinematic level has no steps: nothing has been shown yet
            self._begin(planned_position(trace))
        rest = {name: values[self._rows :] for name, values in trace.columns.items()}
        if self._rows < len(trace["time"]):
            self._run.add(Trace(rest, trace.about), self._moved(self._taken()))
        if track is None:  # without recorded poses, the machine follows its path
            poses = visible_poses(self._scenario, trace)
            if poses is not None:
                self._run.move(poses, trace)
        self._run.end(trace, run.metrics)


_WAITING = 8  # queued batches of 0.1 s; a slower viewer misses some
_TRAIL = 60.0  # [s] of path drawn in full detail
_REACH = 6.0  # [m] of floor around the start
_ENDING = 10.0  # [s] to send the queued batches


class LiveDrive(_LiveView):
    """Callbacks of `drive_by_hand` that send data from a separate thread, so that driving never waits."""

    def __init__(self, scenario: Scenario, known: Mapping[str, Any], sink: RecordingSink):
        """Prepare to show a drive in a scenario from `free_drive`, with plant, method, seed and floor."""
        super().__init__(scenario, known, sink, _TRAIL)
        self.missed = 0
        """Number of batches dropped because the viewer was too slow."""
        self._waiting: queue.Queue[tuple[Trace, list[tuple[float, Array]]] | None] = queue.Queue(_WAITING)
        self._thread = threading.Thread(target=self._send, name="view", daemon=True)
        self._failure: Exception | None = None
        self._reckoning = DeadReckoning(scenario.robot)

    def start(self) -> None:
        """Show the robot at its start before the first step."""
        self._open(None, (0.0, 0.0), None)
        corners = _REACH * np.array([(-1.0, -1.0), (1.0, 1.0)])
        log_floor(self._stream, corners, (), self._scenario.floor)
        self._run.stand(Poses(self._mj_model, np.zeros(1), self._mj_model.qpos0[None]))
        self._thread.start()

    def rows(self, names: tuple[str, ...], table: Array) -> None:
        """Queue the newest rows, shape (k, len(names)), and their poses; drop them if the queue is full."""
        trace = Trace(dict(zip(names, table.T.copy(), strict=True)))
        try:
            self._waiting.put_nowait((trace, self._taken()))
        except queue.Full:
            self.missed += 1

    def _send(self) -> None:
        while (batch := self._waiting.get()) is not None:
            if self._failure is not None or not self._sink.is_open:
                continue
            try:
                self._show(*batch)
            except Exception as error:
                # the viewer is a program of others, which may fail in any way; while a robot drives, none of
                # it may end the thread with the queue unread, and `finish` raises it after the drive
                self._failure = error

    def _show(self, trace: Trace, taken: list[tuple[float, Array]]) -> None:
        trace = self._reckoning.placed(trace)
        moved = self._moved(taken)
        if moved is None:
            moved = poses_from_trace(self._mj_model, trace, turned=self._reckoning.turned_before)
        self._run.add(trace, moved)

    def finish(self) -> None:
        """Send the queued batches and detach from the viewer.

        Raises:
          ViewerError: The viewer failed.
        """
        with contextlib.suppress(queue.Full):
            self._waiting.put(None, timeout=_ENDING)
            self._thread.join(_ENDING)
        self._stream.disconnect()
        self._sink.settle()
        if self._failure is not None:
            raise self._failure


class DeadReckoning:
    """Dead reckoning of a robot from wheel speeds and heading, for plants without a true position."""

    def __init__(self, robot: Robot):
        """Begin at the origin with all wheel angles zero."""
        inverse = rolling_matrix(robot.wheel_positions, robot.rolling_directions)
        self._twist = robot.wheel.radius * np.linalg.pinv(inverse)[:2]
        self._place = np.zeros(2)
        self._turned = np.zeros(len(robot.wheels))
        self._last: float | None = None
        self.turned_before = self._turned
        """Wheel angles before the newest rows, shape (n,) [rad]."""

    def placed(self, trace: Trace) -> Trace:
        """Add `x`, `y`, `heading` to rows, later than all before, by ∫ R(θ) B⁺ r φ̇ dt if they lack them."""
        time, wheels = trace["time"], trace.wheels("wheel_speed")
        step = np.diff(time, prepend=time[0] if self._last is None else self._last)[:, None]
        self.turned_before, self._last = self._turned, float(time[-1])
        self._turned = self._turned + (wheels * step).sum(axis=0)
        if "x" in trace:
            return trace
        heading, body = trace["heading_estimate"], wheels @ self._twist.T
        c, s = np.cos(heading), np.sin(heading)
        world = np.stack((c * body[:, 0] - s * body[:, 1], s * body[:, 0] + c * body[:, 1]), axis=1)
        place = self._place + np.cumsum(world * step, axis=0)
        self._place = place[-1]
        added = {"x": place[:, 0], "y": place[:, 1], "heading": heading}
        return Trace({**trace.columns, **added}, trace.about)
