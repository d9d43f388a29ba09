"""A drive by hand in the Rerun viewer: no plan, no end, and never in the way of the loop that drives."""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Mapping
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from omnimj.control.allocation import inverse_kinematics
from omnimj.parameters import Robot
from omnimj.scenario.methods import make_method
from omnimj.scenario.scenario import Scenario
from omnimj.signals import Trace
from omnimj.view.live import Spectator
from omnimj.view.machine import visible_model
from omnimj.view.rerun_log import RunStream, live_blueprint
from omnimj.view.rerun_scene import log_floor
from omnimj.view.scene3d import Poses, poses_from_trace

Array = NDArray[np.float64]
_WAITING = 8  # batches of a tenth of a second; a viewer that is later than that misses some
_TRAIL = 60.0  # [s] whose path is drawn in full detail
_REACH = 6.0  # [m] of floor around the start
_ENDING = 10.0  # [s] for what still waits


class LiveDrive:
    """Hooks of `drive_by_hand`; a thread of its own sends what they are given."""

    def __init__(self, scenario: Scenario, known: Mapping[str, Any], spectator: Spectator):
        """A drive that is about to begin.

        Args:
          scenario: From `free_drive`.
          known: Plant, method, seed, floor.
          spectator: Shows it.
        """
        self.missed = 0
        """Batches that the viewer was too slow for."""
        self._scenario, self._known, self._spectator = scenario, known, spectator
        self._stream = rr.RecordingStream("omnimj")
        self._run = RunStream(self._stream, scenario, _TRAIL)
        self._mj_model: Any = None
        self._poses: list[tuple[float, Array]] = []
        self._waiting: queue.Queue[tuple[Trace, list[tuple[float, Array]]] | None] = queue.Queue(_WAITING)
        self._thread = threading.Thread(target=self._send, name="view", daemon=True)
        self._failure: Exception | None = None
        robot = scenario.constants
        assert isinstance(robot, Robot)
        self._reckoning = Reckoning(robot)

    def start(self) -> None:
        """Shows the robot in its place before the first step."""
        method = str(self._known["method"])
        made = make_method(method, self._scenario)
        names = () if made is None else tuple(made.log_names)
        self._spectator.connect(self._stream, live_blueprint(self._scenario, None, (0.0, 0.0), method, names))
        self._mj_model = visible_model(self._scenario)
        self._run.begin(self._known, None, self._mj_model)
        corners = _REACH * np.array([(-1.0, -1.0), (1.0, 1.0)])
        log_floor(self._stream, corners, (), self._scenario.floor)
        self._run.stand(Poses(self._mj_model, np.zeros(1), self._mj_model.qpos0[None]))
        self._thread.start()

    def snapshot(self, now: float, pose: Array) -> None:
        """Keeps a pose for the next batch."""
        self._poses.append((now, np.array(pose)))

    def rows(self, names: tuple[str, ...], table: Array) -> None:
        """Hands the newest rows and the poses of their time to the thread, or drops them."""
        trace = Trace(dict(zip(names, table.T.copy(), strict=True)))
        poses, self._poses = self._poses, []
        try:
            self._waiting.put_nowait((trace, poses))
        except queue.Full:
            self.missed += 1

    def _send(self) -> None:
        while (batch := self._waiting.get()) is not None:
            if self._failure is not None or not self._spectator.is_open:
                continue
            try:
                self._show(*batch)
            except Exception as error:  # a viewer that breaks down must not stop whoever drives
                self._failure = error

    def _show(self, trace: Trace, taken: list[tuple[float, Array]]) -> None:
        trace = self._reckoning.placed(trace)
        if taken:
            times, poses = zip(*taken, strict=True)
            moved = Poses(self._mj_model, np.array(times), np.stack(poses))
        else:
            moved = poses_from_trace(self._mj_model, trace, turned=self._reckoning.turned_before)
        self._run.add(trace, moved)

    def finish(self) -> None:
        """Sends what still waits and leaves the viewer to itself.

        Raises:
          ViewerError: The viewer broke down.
        """
        with contextlib.suppress(queue.Full):
            self._waiting.put(None, timeout=_ENDING)
            self._thread.join(_ENDING)
        self._stream.disconnect()
        self._spectator.settle()
        if self._failure is not None:
            raise self._failure


class Reckoning:
    """Where a robot is by its wheels and its heading, for one that nobody watches from outside."""

    def __init__(self, robot: Robot):
        """Begins at the origin."""
        inverse = inverse_kinematics(robot.wheel_positions, robot.rolling_directions)
        self._twist = robot.wheel.radius * np.linalg.pinv(inverse)[:2]
        self._place = np.zeros(2)
        self._turned = np.zeros(len(robot.wheels))
        self._last: float | None = None
        self.turned_before = self._turned
        """By how much the wheels had turned before the newest rows [rad]."""

    def placed(self, trace: Trace) -> Trace:
        """The rows with `x`, `y`, `heading`: the plant's where it tells, else ∫ R(θ) B⁺ r φ̇ dt.

        Args:
          trace: Later than all before.
        """
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
