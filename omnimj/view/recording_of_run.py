"""`run.rrd` of a run: its poses and everything that was logged of it."""

from __future__ import annotations

from pathlib import Path

from omnimj.recording.folder import whole_file
from omnimj.scenario.running import Run
from omnimj.view.machine import visible_poses
from omnimj.view.rerun_log import write_recording
from omnimj.view.scene3d import Poses


def poses_of(run: Run) -> Poses | None:
    """Poses of the machine with everything that is seen."""
    track = run.poses
    return visible_poses(run.scenario, run.trace, *((track.time, track.position) if track else ()))


def write_recording_of(path: Path, run: Run) -> None:
    """Writes the Rerun recording of a run, in full or not at all."""
    poses = poses_of(run)
    with whole_file(path) as temporary:
        write_recording(temporary, run.trace, run.scenario, run.metrics, poses)
