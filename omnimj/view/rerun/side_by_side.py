"""`recording.rrd`: a real run of a robot and its simulation side by side, in one hall."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from scipy.integrate import cumulative_trapezoid

from omnimj.estimate.drives.compare import velocity_course
from omnimj.estimate.drives.records import DrivenRun, Motion
from omnimj.parameters import Robot, read_floors
from omnimj.plant.mujoco.assembly import robot_model
from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.poses import Poses, robot_poses
from omnimj.view.rerun.blueprint import Eye, arranged, scene_view
from omnimj.view.rerun.dead_reckoning import filled
from omnimj.view.rerun.scene import (
    MEASURED,
    Machine,
    begin_recording,
    log_floor,
    log_name,
    on_floor,
    recording_file,
    time_column,
)
from omnimj.view.rerun.signals import Line, log_rows, log_styles

_ROOM = 0.7  # [m] between the paths: robots do not touch
_DEGREES = 180.0 / np.pi


def write_side_by_side(path: Path, run: DrivenRun, robot: Robot) -> None:
    """Write the recording of one run."""
    with recording_file(path, "omnimj_side_by_side") as stream:
        stream.send_blueprint(_blueprint(run), make_active=False)
        begin_recording(stream, f"{run.run}: measured and {run.plant}")
        mj_model = robot_model(robot, next(iter(read_floors().values())))
        places = side_by_side(run)
        corners = np.vstack([pose[:, :2] for pose in places.values()])
        log_floor(stream, corners, (), run.floor)
        angles = cumulative_trapezoid(run.wheel_speed, run.time, axis=0, initial=0.0)
        for name, pose in places.items():
            color = MEASURED if name == "measured" else palette.AFTER
            machine = Machine(stream, mj_model, f"world/{name}")
            qpos = robot_poses(mj_model, np.column_stack([pose, angles]))
            machine.log_bodies(Poses(mj_model, run.time, qpos), rollers_turn=False)
            log_name(stream, f"world/{name}/chassis", (0.0, 0.0, 0.45), name, color)
            _log_path(stream, name, pose, color)
        beside = places["measured"] - places["measured"][0] + places[run.plant][0]
        _log_path(stream, "measured_beside", beside, MEASURED)
        _log_courses(stream, run)


def side_by_side(run: DrivenRun) -> dict[str, Array]:
    """Poses of both robots beside each other, shape (k, 3) each: `measured` and the plant's name.

    Gaps of the measurement are bridged. The robots stand apart across the direction in which they drive.
    """
    measured, simulated = (
        np.column_stack([filled(column) for column in motion.pose.T])
        for motion in (run.measured, run.simulated)
    )
    start = measured[0, :2].copy()
    for pose in (measured, simulated):
        pose[:, :2] -= start
    away = measured[-1, :2]
    length = float(np.hypot(*away))
    across = np.array([-away[1], away[0]]) / length if length > 0.0 else np.array([0.0, 1.0])
    if across[1] < 0.0:
        across = -across
    beside = measured.copy()
    reach = [float(np.ptp(pose[:, :2] @ across)) for pose in (measured, simulated)]
    beside[:, :2] += (max(reach) + _ROOM) * across
    return {"measured": beside, run.plant: simulated}


def _log_path(stream: rr.RecordingStream, name: str, pose: Array, color: str) -> None:
    strip = rr.LineStrips3D([on_floor(pose[:, :2], 0.006)], colors=[palette.rgb(color)], radii=[0.008])
    stream.log(f"world/paths/{name}", strip, static=True)


def _log_courses(stream: rr.RecordingStream, run: DrivenRun) -> None:
    """Log velocity, heading and currents, measured and simulated in one plot each."""
    measured, simulated = _courses(run, run.measured), _courses(run, run.simulated)
    index = time_column(run.time)
    for name in measured:
        lines = (
            Line(name, "measured", MEASURED, width=3.0),
            Line(name, run.plant, palette.AFTER, width=1.5),
        )
        log_styles(stream, f"plots/{name}", lines)
        log_rows(stream, f"plots/{name}", index, np.column_stack([measured[name], simulated[name]]))


def _courses(run: DrivenRun, motion: Motion) -> dict[str, Array]:
    ahead, left = velocity_course(run, motion).T
    heading = _DEGREES * (motion.pose[:, 2] - run.simulated.pose[0, 2])
    currents = {f"current_{i}": column for i, column in enumerate(motion.currents.T, start=1)}
    return {"velocity_ahead": ahead, "velocity_left": left, "heading": heading, **currents}


def _blueprint(run: DrivenRun) -> rrb.Blueprint:
    wheels = range(1, run.measured.currents.shape[1] + 1)
    titles = {
        "velocity_ahead": "Velocity ahead [m/s]",
        "velocity_left": "Velocity to the left [m/s]",
        "heading": "Heading since the start [°]",
        **{f"current_{i}": f"Current of wheel {i} [A]" for i in wheels},
    }
    series = [
        rrb.TimeSeriesView(
            origin=f"plots/{name}",
            name=title,
            plot_legend=rrb.PlotLegend(visible=name == "velocity_ahead", corner=rrb.Corner2D.RightBottom),
        )
        for name, title in titles.items()
    ]
    return arranged(scene_view(f"Measured and {run.plant}", _eye(run)), rrb.Vertical(*series))


def _eye(run: DrivenRun) -> Eye:
    """Camera behind the start that sees both paths."""
    points = np.vstack([pose[:, :2] for pose in side_by_side(run).values()])
    low, high = points.min(axis=0), points.max(axis=0)
    x, y = 0.5 * (low + high)
    far = 1.0 + float((high - low).max())
    return Eye((x - 0.7 * far, y, 0.7 * far), (x, y, 0.0))
