"""What a run leaves behind: the files of its folder, and the live view."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.recording.folder import whole_file

if TYPE_CHECKING:
    from omnimj.scenario.running import Run
    from omnimj.scenario.scenario import Scenario
    from omnimj.view.live import LiveRun
    from omnimj.view.picture import Picture


def write_outputs(folder: Path, force: bool, run: Run, others: Mapping[str, Run] | None = None) -> None:
    """Writes `trace.parquet`, `metrics.json`, `run.rrd` and `report.html`, each in full or not at all.

    Runs beside it have a trace each, `trace_off.parquet` and so on, and are told in `report.html`.

    Args:
      folder: Created if needed.
      force: Whether the files of an earlier run may be replaced.
      run: What was driven.
      others: The same scenario with other methods, by method.

    Raises:
      InputError: The folder is not empty and `force` is not given, or it cannot be written.
    """
    from omnimj.recording.folder import RUN_FILES, make_folder
    from omnimj.recording.traces import write_trace
    from omnimj.scenario.methods import METHODS
    from omnimj.scenario.summary import write_metrics
    from omnimj.view.recording_of_run import write_recording_of
    from omnimj.view.report import write_report

    make_folder(folder, force, (*RUN_FILES, *map(_trace_beside, METHODS)))
    write_trace(folder / "trace.parquet", run.trace)
    traces = {method: other.trace for method, other in (others or {}).items()}
    for method, trace in traces.items():
        write_trace(folder / _trace_beside(method), trace)
    write_metrics(folder / "metrics.json", run.metrics)
    write_recording_of(folder / "run.rrd", run)
    with tempfile.TemporaryDirectory() as beside, whole_file(folder / "report.html") as temporary:
        write_report(temporary, run.trace, run.scenario, run.metrics, _picture_of(run, Path(beside)), traces)


def _trace_beside(method: str) -> str:
    """File of a run that was driven for comparison."""
    return f"trace_{method}.parquet"


def _picture_of(run: Run, folder: Path) -> Picture | None:
    from omnimj.view.picture import picture_of_run
    from omnimj.view.recording_of_run import poses_of

    poses = poses_of(run)
    return None if poses is None else picture_of_run(poses, run.trace, run.metrics, folder / "picture.png")


def open_live(scenario: Scenario, known: Mapping[str, Any]) -> LiveRun:
    """Opens the Rerun viewer for a run that will be driven.

    Where no viewer can be opened nothing is driven: the run would not be what was asked for, and to leave out
    `--view` is easier than to wait for its end.

    Args:
      scenario: What is asked for.
      known: What `metrics.json` will hold, as far as it is known.

    Raises:
      ViewerError: No viewer could be opened.
    """
    from omnimj.view.live import LiveRun
    from omnimj.view.viewer import open_viewer

    return LiveRun(scenario, known, open_viewer())


def show(run: Run, live: LiveRun) -> None:
    """Completes the run in the viewer and leaves the viewer to itself.

    Args:
      run: What was driven; its results are written and printed by now.
      live: From `open_live`.

    Raises:
      ViewerError: The viewer broke down.
    """
    live.finish(run)
