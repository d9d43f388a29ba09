"""`omnimj run` drives a scenario and writes its folder; `omnimj scenarios` lists the scenarios."""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import (
    ADDRESS,
    INTERRUPTED,
    MODEL,
    Command,
    add_floors,
    add_gains,
    add_overrides,
    add_seed,
    add_thresholds,
    add_wire,
    command_line,
    has_out,
    read_thresholds,
    read_wire,
)
from omnimj.cli.progress import progress_bar
from omnimj.cli.terminal import announce_compilation, format_json, note_compiled, print_result
from omnimj.errors import InputError, SimulationError
from omnimj.recording.folder import atomic_file
from omnimj.resources import models_folder

if TYPE_CHECKING:
    from omnimj.simulate.plants import LinkOptions
    from omnimj.simulate.run import RunResult
    from omnimj.simulate.scenario.scenario import Scenario
    from omnimj.view.picture import Picture
    from omnimj.view.rerun.live import LiveRun


def add_scenarios_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj scenarios`."""
    parser.add_argument("--json", action="store_true", help="print a JSON object, name to description")


def run_scenarios(arguments: Any) -> int:
    """Print the list of scenarios, without slow imports."""
    from omnimj.simulate.scenario.listing import list_scenarios

    described = list_scenarios()
    if arguments.json:
        print(format_json(described))
        return 0
    width = max(map(len, described), default=0)
    for name, description in described.items():
        print(f"{name:{width}}  {description}")
    return 0


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj run`."""
    parser.add_argument("scenario", help="a name from `omnimj scenarios`, or a path to a TOML file")
    parser.add_argument("--plant", metavar="P", help=f"twin (default), planar, or {ADDRESS}")
    words = "fault detection: robust (default), published (default on the rig) or off"
    parser.add_argument("--method", metavar="M", help=words)
    add_seed(parser, "seed of the sensors' noise")
    add_overrides(parser, "faults.0.wheel=3")
    words = f"{MODEL}; the originals lie in {str(models_folder()).replace('%', '%%')}"
    parser.add_argument("--model", metavar="FILE", type=Path, help=words)
    add_wire(parser)
    add_floors(parser)
    add_thresholds(parser)
    add_gains(parser)
    parser.add_argument(
        "--out", metavar="DIR", type=Path, help="write trace, metrics, recording and report here"
    )
    parser.add_argument("--force", action="store_true", help="write into --out although it is not empty")
    words = "drive it with the other methods too and compare them"
    parser.add_argument("--compare", action="store_true", help=words)
    parser.add_argument("--view", action="store_true", help="watch the run in the Rerun viewer")
    parser.add_argument("--json", action="store_true", help="print metrics.json instead of the table")


def run_run(arguments: Any) -> int:
    """Drive the scenario, write its folder and print the verdict; 1 if a check fails."""
    from omnimj.recording.folder import check_folder
    from omnimj.simulate.scenario.scenario import read_scenario
    from omnimj.view.opengl import choose_backend

    if has_out(arguments):
        check_folder(arguments.out, arguments.force)
        choose_backend()
    scenario = read_scenario(arguments.scenario, arguments.overrides, arguments.model, arguments.floors)
    if arguments.gains is not None:
        scenario = _with_gains(arguments.gains, scenario)
    method, wire = _method(arguments, scenario), _wire(arguments, scenario)
    beside = other_methods(scenario, method) if arguments.compare else ()
    finished, live = _drive(arguments, scenario, method, wire)
    others = Comparison()
    if beside and not finished.interrupted:
        others = drive_comparison(arguments, scenario, beside)
    if finished.metrics:
        _write_and_print(arguments, finished, live, others)
    if others.interrupted:
        return INTERRUPTED
    return 1 if others.failures else _exit_code(finished, arguments.out)


def _with_gains(file: Path, scenario: Any) -> Any:
    from omnimj.control.gains import read_gains
    from omnimj.simulate.scenario.scenario import require_cascade, scenario_gains, with_gains

    require_cascade(scenario)
    return with_gains(scenario, read_gains(file, scenario_gains(scenario).control))


def _method(arguments: Any, scenario: Any) -> str:
    from omnimj.simulate.detectors import default_method, require_known_method

    method = default_method(scenario) if arguments.method is None else arguments.method
    require_known_method(method)
    return method


def _wire(arguments: Any, scenario: Any) -> LinkOptions | None:
    """Return the link options, None without a link; create the run's folder, where frames are logged."""
    if read_wire(arguments, None) is None:
        return None
    from omnimj.link.host.frame_log import FRAMES_FILE
    from omnimj.recording.folder import RUN_FILES, make_folder
    from omnimj.simulate.plants import plant_name

    plant_name(scenario, arguments.plant)
    if arguments.compare:
        rule = "it would drive the robot more than once"
        raise InputError("--compare", f"found with --plant {arguments.plant}", rule)
    if arguments.out is None:
        return read_wire(arguments, None)
    make_folder(arguments.out, arguments.force, (*RUN_FILES, FRAMES_FILE))
    return read_wire(arguments, arguments.out / FRAMES_FILE)


def _write_and_print(arguments: Any, finished: RunResult, live: LiveRun | None, others: Comparison) -> None:
    """Print and write a run of at least two rows, complete or not: a full disk must not cost the result."""
    failure = finished.trace.about["failure"]
    finished.metrics["failure"] = failure
    finished.metrics["command"] = command_line(arguments)
    if others.runs:
        failures = others.failures
        compared = {name: {**run.metrics, "failure": failures.get(name)} for name, run in others.runs.items()}
        finished.metrics["compared"] = compared
    if not failure:
        from omnimj.cli.run_summary import format_run

        text = json.dumps(finished.metrics, indent=2) if arguments.json else format_run(finished)
        print_result(text)
    if arguments.out is not None:
        # the folder already holds the frames of the link
        with progress_bar(arguments) as bar:
            bar.show(1, 1, f"writing {arguments.out}")
            write_outputs(arguments.out, arguments.force or "link" in finished.metrics, finished, others.runs)
        if not failure and not arguments.json:
            print(f"written to {arguments.out}")
    for method, reason in others.failures.items():
        print(f"omnimj: method {method}: {reason}", file=sys.stderr)
    if live is not None:
        live.finish(finished)


def _exit_code(finished: RunResult, out: Path | None) -> int:
    failure = finished.trace.about["failure"]
    if failure:
        written = f"; everything recorded until then is in {out}" if out and finished.metrics else ""
        raise SimulationError(f"{failure}{written}")
    if finished.interrupted:
        return INTERRUPTED
    return 0 if finished.metrics["passed"] else 1


def _drive(
    arguments: Any, scenario: Any, method: str, wire: LinkOptions | None
) -> tuple[RunResult, LiveRun | None]:
    from omnimj.simulate.loop import NO_CALLBACKS
    from omnimj.simulate.plants import KINEMATIC, plant_name
    from omnimj.simulate.run import run_scenario

    thresholds = read_thresholds(arguments.thresholds, method)
    plant = plant_name(scenario, arguments.plant)
    compiled = "remote" if wire is not None else plant
    if plant != KINEMATIC:
        # before the imports that compile
        announce_compilation(compiled, scenario.plant, quiet=arguments.quiet)
    live, callbacks = None, NO_CALLBACKS
    if arguments.view:
        known = {"scenario": scenario.name, "method": method, "seed": arguments.seed}
        from omnimj.view.rerun.live import LiveRun
        from omnimj.view.rerun.viewer import open_viewer

        live = LiveRun(scenario, known, open_viewer())  # a failure prevents the run
        callbacks = live.callbacks
    with progress_bar(arguments) as bar:
        finished = run_scenario(
            scenario,
            arguments.plant,
            method,
            arguments.seed,
            dataclasses.replace(callbacks, progress=bar.show),
            thresholds,
            wire,
        )
    if plant != KINEMATIC and finished.metrics:
        note_compiled(compiled, scenario.plant)
    return finished, live


def other_methods(scenario: Scenario, method: str) -> tuple[str, ...]:
    """List the methods that a run can be compared with; there must be one, and all must suit this robot."""
    from omnimj.simulate.detectors import available_methods, make_detector

    others = tuple(name for name in available_methods(scenario) if name != method)
    if not others:
        rule = f"{scenario.name} is at the kinematic level, where there is nothing to diagnose from"
        raise InputError("--compare", "there is no other method", rule)
    for name in others:
        make_detector(name, scenario)
    return others


@dataclass(frozen=True)
class Comparison:
    """Runs of the same scenario with other methods."""

    runs: dict[str, RunResult] = field(default_factory=dict)
    """Runs of at least two rows, by method."""
    failures: dict[str, str] = field(default_factory=dict)
    """Time and reason of breakdowns, by method."""
    interrupted: bool = False
    """True if Ctrl-C ended the last run; earlier runs are complete."""


def drive_comparison(arguments: Any, scenario: Scenario, methods: tuple[str, ...]) -> Comparison:
    """Drive the scenario once with each of the methods, on the same plant and with the same seed."""
    from omnimj.simulate.loop import Callbacks
    from omnimj.simulate.run import run_scenario

    runs: dict[str, RunResult] = {}
    failures: dict[str, str] = {}
    try:
        for method in methods:
            with progress_bar(arguments) as bar:
                callbacks = Callbacks(functools.partial(bar.show, phase=f"method {method}"))
                run = run_scenario(scenario, arguments.plant, method, arguments.seed, callbacks)
            if run.metrics:
                runs[method] = run
            if run.trace.about["failure"]:
                failures[method] = run.trace.about["failure"]
            elif run.interrupted:
                return Comparison(runs, failures, True)
    except KeyboardInterrupt:  # between two runs; finished runs are kept
        return Comparison(runs, failures, True)
    return Comparison(runs, failures)


def write_outputs(
    folder: Path, force: bool, run: RunResult, others: Mapping[str, RunResult] | None = None
) -> None:
    """Write `trace.parquet`, `metrics.json`, `run.rrd` and `report.html`, each in full or not at all.

    Runs with other methods have a trace each, `trace_off.parquet` and so on, and are shown in `report.html`.
    """
    from omnimj.recording.folder import RUN_FILES, make_folder
    from omnimj.recording.json_files import write_json
    from omnimj.recording.traces import write_trace
    from omnimj.simulate.detectors import METHODS
    from omnimj.view.report.run import write_report
    from omnimj.view.rerun.recording import write_recording_of

    make_folder(folder, force, (*RUN_FILES, *map(_comparison_trace, METHODS)))
    write_trace(folder / "trace.parquet", run.trace)
    traces = {method: other.trace for method, other in (others or {}).items()}
    for method, trace in traces.items():
        write_trace(folder / _comparison_trace(method), trace)
    write_json(folder / "metrics.json", run.metrics)
    write_recording_of(folder / "run.rrd", run)
    with tempfile.TemporaryDirectory() as beside, atomic_file(folder / "report.html") as temporary:
        write_report(temporary, run.trace, run.scenario, run.metrics, _picture_of(run, Path(beside)), traces)


def _comparison_trace(method: str) -> str:
    """Return the name of the trace file of a run with another method."""
    return f"trace_{method}.parquet"


def _picture_of(run: RunResult, folder: Path) -> Picture | None:
    from omnimj.view.picture import picture_of_run
    from omnimj.view.rerun.recording import poses_of

    poses = poses_of(run)
    return None if poses is None else picture_of_run(poses, run.trace, run.metrics, folder / "picture.png")


SCENARIOS = Command(
    "scenarios",
    "list the scenarios with their one-line descriptions",
    "example:\n  omnimj scenarios",
    add_scenarios_arguments,
    run_scenarios,
)


RUN = Command(
    "run",
    "drive one scenario and judge it by its checks",
    """examples:
  omnimj run nylon_patch
  omnimj run nylon_patch --set floor=pvc --set drive.speed=0.8 --out out/nylon
  omnimj run degraded_motor --plant planar --seed 3 --json
  omnimj run degraded_motor --method published --set diagnosis.thresholds=printed
  omnimj run circle_8m --compare --out out/circle
  omnimj run circle_8m --gains tuned_gains.toml
  omnimj run nylon_patch --plant udp:127.0.0.1:9750 --lock-step --out out/wire""",
    add_run_arguments,
    run_run,
)
