"""A run in the Rerun viewer while it goes on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from omnimj.plant.faults import as_record
from omnimj.plant.interface import Plant
from omnimj.scenario.drive import Drive
from omnimj.scenario.methods import make_method
from omnimj.scenario.running import Run
from omnimj.scenario.scenario import Scenario
from omnimj.signals import Reference, Trace
from omnimj.view.machine import visible_model, visible_poses
from omnimj.view.plots import planned_position
from omnimj.view.rerun_log import RunStream, live_blueprint
from omnimj.view.scene3d import Poses, poses_from_trace
from omnimj.view.wording import NOT_DIAGNOSED

Array = NDArray[np.float64]
_FLUSHING = 30.0  # [s] for a viewer on a slow machine to take the rest


class Spectator(Protocol):
    """Who looks on: a viewer, or a file."""

    @property
    def is_open(self) -> bool:
        """Whether there is still somebody to send to."""
        ...

    def connect(self, stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
        """Takes all that is logged to a stream from now on."""
        ...

    def settle(self) -> None:
        """Raises `ViewerError` when the spectator broke down."""
        ...


class LiveRun:
    """Hooks of `run_scenario` that show a run while it goes on; `finish` adds what is known at its end."""

    def __init__(self, scenario: Scenario, known: Mapping[str, Any], spectator: Spectator):
        """A run that will be driven.

        Args:
          scenario: What is asked for.
          known: What `metrics.json` will hold, as far as it is known.
          spectator: Shows it.
        """
        self._scenario, self._known, self._spectator = scenario, known, spectator
        self._method = str(known.get("method", NOT_DIAGNOSED))
        self._stream = rr.RecordingStream("omnimj")
        self._run = RunStream(self._stream, scenario, scenario.duration)
        drive = scenario.drive
        self._plan: Reference | None = drive.reference if isinstance(drive, Drive) else None
        self._poses: list[tuple[float, Array]] = []
        self._rows = 0
        self._mj_model: Any = None

    def start(self, _plant: Plant) -> None:
        """Shows the machine in its place before the first step (`on_start`)."""
        self._begin(None if self._plan is None else self._plan.position)

    def _begin(self, planned: Array | None) -> None:
        start = (0.0, 0.0) if planned is None else (float(planned[0, 0]), float(planned[0, 1]))
        method = make_method(self._method, self._scenario)
        names = () if method is None else tuple(method.log_names)
        asked = [as_record(fault) for fault in self._scenario.faults]
        scenario, duration = self._scenario, self._scenario.duration
        blueprint = live_blueprint(scenario, duration, start, self._method, names, asked)
        self._spectator.connect(self._stream, blueprint)
        self._mj_model = visible_model(self._scenario)
        self._run.begin(self._known, planned, self._mj_model)
        self._run.stand(self._first_pose())

    def _first_pose(self) -> Poses:
        if self._plan is None:
            return Poses(self._mj_model, np.zeros(1), self._mj_model.qpos0[None])
        (x, y), heading = self._plan.position[0], self._plan.heading[0]
        place = {"time": 0.0, "x": x, "y": y, "heading": heading}
        place |= {f"wheel_speed_{i}": 0.0 for i in range(1, len(self._scenario.constants.wheels) + 1)}
        return poses_from_trace(self._mj_model, Trace({name: np.array([at]) for name, at in place.items()}))

    def snapshot(self, now: float, pose: Array) -> None:
        """Keeps a pose for the next batch (`snapshot`)."""
        self._poses.append((now, np.array(pose)))

    def rows(self, names: tuple[str, ...], table: Array) -> None:
        """Sends the newest rows and the poses of their time (`rows`)."""
        columns = dict(zip(names, table.T, strict=True))
        first, self._rows = self._rows, self._rows + len(table)
        if self._plan is not None:
            columns["target_heading"] = self._plan.heading[first : self._rows]
        if self._spectator.is_open:
            self._run.add(Trace(columns), self._batch())

    def _batch(self) -> Poses | None:
        """The poses since the batch before."""
        if not self._poses:
            return None
        times, poses = zip(*self._poses, strict=True)
        self._poses = []
        return Poses(self._mj_model, np.array(times), np.stack(poses))

    def finish(self, run: Run) -> None:
        """Sends what is left, the fault states and the checks; the viewer then plays the run.

        Args:
          run: What was driven, at least two rows.

        Raises:
          ViewerError: The viewer broke down.
        """
        if self._spectator.is_open:
            self._send_rest(run)
            self._stream.flush(timeout_sec=_FLUSHING)
        self.close()
        self._spectator.settle()

    def close(self) -> None:
        """Sends nothing more; a run that broke down stays as far as it was shown."""
        self._stream.disconnect()

    def _send_rest(self, run: Run) -> None:
        trace, track = run.trace, run.poses
        if self._mj_model is None:  # a level without steps: nothing was shown yet
            self._begin(planned_position(trace))
        rest = {name: values[self._rows :] for name, values in trace.columns.items()}
        if self._rows < len(trace["time"]):
            self._run.add(Trace(rest, trace.about), self._batch())
        if track is None:  # a plant without poses follows its path
            poses = visible_poses(self._scenario, trace)
            if poses is not None:
                self._run.move(poses, trace)
        self._run.end(trace, run.metrics)
