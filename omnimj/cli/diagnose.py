"""`omnimj diagnose`: diagnosis of recorded runs; `omnimj calibrate`: thresholds from fault-free ones."""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import (
    MODEL,
    ROBOT_MODEL,
    Command,
    add_accept,
    add_floors,
    add_observer_gains,
    add_results,
    add_thresholds,
    add_workers,
    command_line,
    exit_code,
    read_observer_gains,
    read_thresholds,
    require_writable,
)
from omnimj.cli.floor_labels import add_floor_label_arguments, run_floor_labels, wants_floor_labels
from omnimj.cli.progress import progress_bar
from omnimj.cli.terminal import (
    announce_compilation,
    format_json,
    format_table,
    note_compiled,
)
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.diagnosis.calibration import Calibration
    from omnimj.diagnosis.replay import DiagnosisConfig, RunDiagnosis
    from omnimj.parameters.floor import Floor
    from omnimj.recording.dataset import Dataset
    from omnimj.view.report.page import RunSection


_NOT_WRITTEN = (
    "nothing written: a threshold far above the shipped one hides faults; --accept writes it all the same"
)
_LOWEST, _HIGHEST = 1e-6, 3600.0  # limits of the requested false-alarm rate [1/h]
DIAGNOSE_FILES = ("diagnoses.json", "report.html")


def add_diagnose_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj diagnose`."""
    parser.add_argument(
        "dataset",
        type=Path,
        help="folder of recorded runs with dataset.toml, or of a run over a link with frames.bin; "
        "or a folder of datasets",
    )
    words = "robust (default on the robot) or published (default on the rig)"
    parser.add_argument("--method", metavar="M", help=words)
    parser.add_argument("--model", metavar="FILE", type=Path, help=MODEL)
    add_floors(parser)
    add_thresholds(parser)
    add_observer_gains(parser)
    add_workers(parser)
    add_accept(parser)
    add_floor_label_arguments(parser)
    add_results(parser, "diagnoses.json")


def run_diagnose(arguments: Any) -> int:
    """Diagnose each recorded run and write its trace, or do so for each dataset; 1 if one of these failed."""
    from omnimj.cli.fleet import is_fleet, run_fleet

    if wants_floor_labels(arguments):
        return run_floor_labels(arguments)
    if is_fleet(arguments.dataset):
        return run_fleet(arguments, diagnose_in_fleet, _FLEET_HEAD, _fleet_row)
    order, found, interrupted, content = _diagnose_dataset(arguments)
    text = _format_diagnosis(order, found, interrupted, arguments.out)
    print(format_json(content) if arguments.json else text)
    return exit_code(interrupted)


_FLEET_HEAD = ("dataset", "runs", "seconds", "diagnoses")


def diagnose_in_fleet(arguments: Any) -> dict[str, Any]:
    """Diagnose one dataset of several, write its files and return a summary."""
    _, found, _, _ = _diagnose_dataset(arguments)
    diagnoses = [{"run": one.name, **dataclasses.asdict(d)} for one in found for d in one.diagnoses]
    seconds, blind = sum(one.judged for one in found), sum(one.cannot_judge for one in found)
    return {"runs": len(found), "seconds": seconds, "cannot_judge": blind, "diagnoses": diagnoses}


def _fleet_row(name: str, summary: Mapping[str, Any]) -> tuple[str, ...]:
    kinds = [one["kind"] for one in summary["diagnoses"]]
    words = ", ".join(f"{kinds.count(kind)} × {kind}" for kind in sorted(set(kinds))) or "no fault"
    return name, str(summary["runs"]), f"{summary['seconds']:.4g}", words


def _diagnose_dataset(
    arguments: Any,
) -> tuple[DiagnosisConfig, list[RunDiagnosis], bool, dict[str, Any]]:
    """Diagnose a dataset and write all files.

    Returns:
      Configuration, diagnoses without traces, whether Ctrl-C ended it, and the content of `diagnoses.json`.
    """
    from omnimj.diagnosis.files import diagnoses_json
    from omnimj.diagnosis.replay import check_config, require_other_folder
    from omnimj.estimate.gap.check.acceptance import fault_records, sound_logs
    from omnimj.recording.folder import check_folder
    from omnimj.recording.json_files import write_json
    from omnimj.view.report.diagnosis import write_diagnosis_report

    check_folder(arguments.out, arguments.force)
    order = _diagnosis_config(arguments)
    require_other_folder(order.dataset, arguments.out)
    logs, check = sound_logs(order.dataset, order.machine.constants, arguments.accept)
    order = dataclasses.replace(order, dataset=logs)
    check_config(order)
    announce_compilation(order.method, order.dataset.plant, "method", quiet=arguments.quiet)
    found, sections, interrupted = _diagnose(arguments, order)
    if not found:
        raise KeyboardInterrupt
    note_compiled(order.method, order.dataset.plant)
    command = command_line(arguments)
    content = diagnoses_json(order, found, command, interrupted) | {"data_faults": fault_records(check)}
    write_json(arguments.out / DIAGNOSE_FILES[0], content)
    write_diagnosis_report(arguments.out / DIAGNOSE_FILES[1], order, found, sections, command, interrupted)
    return order, found, interrupted, content


def _diagnosis_config(arguments: Any) -> DiagnosisConfig:
    from omnimj.diagnosis.logs import read_machine, resolve_method
    from omnimj.diagnosis.replay import DiagnosisConfig
    from omnimj.parameters.floor import all_floors, own_floors
    from omnimj.recording.read_dataset import read_dataset

    floors = all_floors(arguments.floors)
    dataset = _recorded(arguments, floors) or read_dataset(arguments.dataset, floors)
    machine = read_machine(dataset, arguments.model)
    method = resolve_method(arguments.method, machine)
    thresholds = read_thresholds(arguments.thresholds, method)
    observer = read_observer_gains(arguments.gains, method)
    expected = own_floors(arguments.floors)
    return DiagnosisConfig(dataset, machine, method, floors, thresholds, observer, expected)


def _recorded(arguments: Any, floors: Mapping[str, Floor]) -> Dataset | None:
    """Read the logged frames of a run over a link as a dataset; return None for any other folder."""
    from omnimj.link.host.dataset import is_link_recording, read_link_recording
    from omnimj.parameters import read_robot
    from omnimj.parameters.floor import find_floor

    if not is_link_recording(arguments.dataset):
        return None
    dataset = read_link_recording(arguments.dataset, read_robot(arguments.model))
    find_floor(str(dataset.runs[0].conditions["floor"]), f"{arguments.dataset}: floor", floors)
    return dataset


def _diagnose(arguments: Any, order: DiagnosisConfig) -> tuple[list[RunDiagnosis], list[RunSection], bool]:
    """Diagnose all runs; write each trace at once and keep only its diagnoses and report section."""
    from omnimj.diagnosis.replay import diagnose
    from omnimj.recording.folder import make_folder
    from omnimj.recording.traces import write_trace
    from omnimj.signals import Trace
    from omnimj.view.report.diagnosis import bins_for, run_section
    from omnimj.view.report.page import MOST_FIGURES

    out, runs = arguments.out, order.dataset.runs
    names = order.detector_for(runs[0]).log_names
    found: list[RunDiagnosis] = []
    sections: list[RunSection] = []
    try:
        with progress_bar(arguments) as bar:
            for one in diagnose(order, bar.show):
                if not found:
                    make_folder(
                        out, arguments.force, (*DIAGNOSE_FILES, *(f"{run.name}.parquet" for run in runs))
                    )
                about = {"dataset": str(order.dataset.path), "run": one.name, "method": order.method}
                diagnoses = [dataclasses.asdict(d) for d in one.diagnoses]
                trace = Trace(one.trace.columns, {**about, "diagnoses": diagnoses})
                write_trace(out / f"{one.name}.parquet", trace)
                bins = bins_for(len(runs)) if len(found) < MOST_FIGURES else 0
                section = run_section(one, order.method, names, bins)
                found.append(dataclasses.replace(one, trace=Trace({})))
                sections.append(section)
    except KeyboardInterrupt:
        return found, sections, True
    return found, sections, False


def _format_diagnosis(
    order: DiagnosisConfig, found: Sequence[RunDiagnosis], interrupted: bool, out: Path
) -> str:
    from omnimj.view.diagnosis_words import describe, describe_undiagnosed, describe_unjudged, summarize_runs

    rows = []
    for one in found:
        if not one.diagnoses:
            rows.append((one.name, describe_undiagnosed(one), describe_unjudged(one) or "–", "", ""))
        rows += [(one.name, *describe(d)) for d in one.diagnoses]
    lines = [*order.dataset.notes, *(note for one in found for note in one.notes)]
    lines += [format_table(("run", "what", "when", "confidence", "decided by"), rows), ""]
    seconds = sum(one.judged for one in found)
    lines.append(f"{summarize_runs(found)}, method {order.method}, {seconds:.4g} s of data")
    if interrupted:
        left = len(order.dataset.runs) - len(found)
        lines.append(f"interrupted: {left} runs are not diagnosed; --force begins again")
    lines.append(f"written to {out}")
    return "\n".join(lines)


def add_calibrate_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj calibrate`."""
    words = "folder of recorded runs of the robot, all of them fault-free"
    parser.add_argument("dataset", type=Path, help=words)
    words = "rate of false alarms per hour of motion, all thresholds together"
    parser.add_argument(
        "--false-alarms-per-hour", metavar="X", type=_rate, required=True, dest="rate", help=words
    )
    parser.add_argument("--model", metavar="FILE", type=Path, help=ROBOT_MODEL)
    add_floors(parser)
    add_observer_gains(parser)
    add_accept(parser, "and write thresholds far above the shipped ones")
    parser.add_argument("--out", metavar="FILE", type=Path, required=True, help="file to write")
    parser.add_argument("--force", action="store_true", help="replace --out")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def _rate(text: str) -> float:
    try:
        rate = float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        rate = math.nan
    if not _LOWEST <= rate <= _HIGHEST:
        rule = f"must be a number, at least {_LOWEST:g} and at most {_HIGHEST:g}"
        raise argparse.ArgumentTypeError(f"found {text[:40]!r}; {rule}")
    return rate


def run_calibrate(arguments: Any) -> int:
    """Calibrate the thresholds on fault-free recordings; 1 if one is so high that it needs `--accept`."""
    require_writable(arguments.out, arguments.force)
    order = _calibration_config(arguments)
    from omnimj.diagnosis.calibration import calibrate
    from omnimj.diagnosis.files import calibration_json, thresholds_toml, write_thresholds
    from omnimj.diagnosis.replay import check_config, require_other_folder
    from omnimj.estimate.gap.check.acceptance import fault_records, sound_dataset

    require_other_folder(order.dataset, arguments.out.parent)
    logs, check = sound_dataset(order.dataset, order.machine.constants, arguments.accept)
    order = dataclasses.replace(order, dataset=logs)
    check_config(order)
    announce_compilation(order.method, order.dataset.plant, "method", quiet=arguments.quiet)
    with progress_bar(arguments) as bar:
        found = calibrate(order, arguments.rate, bar.show)
    note_compiled(order.method, order.dataset.plant)
    command = command_line(arguments)
    writes = found.misfit is None or arguments.accept
    if writes:
        write_thresholds(arguments.out, thresholds_toml(found, order.dataset, command))
    if arguments.json:
        content = calibration_json(found, order.dataset, command) | {"data_faults": fault_records(check)}
        print(format_json(content | {"written": str(arguments.out) if writes else None}))
    else:
        print(_format_calibration(found, order, arguments.out if writes else None))
    return 0 if writes else 1


def _calibration_config(arguments: Any) -> DiagnosisConfig:
    from omnimj.diagnosis.logs import read_machine
    from omnimj.diagnosis.replay import DiagnosisConfig
    from omnimj.parameters.floor import all_floors, own_floors
    from omnimj.recording.read_dataset import read_dataset

    floors = all_floors(arguments.floors)
    dataset = read_dataset(arguments.dataset, floors)
    if dataset.plant != "uto_robot":
        rule = "the robust method, whose thresholds these are, is for the robot"
        raise InputError(arguments.dataset, f"plant is {dataset.plant!r}", rule, ("uto_robot",))
    observer = read_observer_gains(arguments.gains, "robust")
    machine, expected = read_machine(dataset, arguments.model), own_floors(arguments.floors)
    return DiagnosisConfig(dataset, machine, "robust", floors, observer=observer, expected_floors=expected)


def _format_calibration(found: Calibration, order: DiagnosisConfig, out: Path | None) -> str:
    from omnimj.control.detection.robust.thresholds import THRESHOLD_UNITS, Thresholds
    from omnimj.diagnosis.files import format_calibration

    usual, rows = Thresholds(), []
    for one in found.set:
        by = "lower bound" if one.value == one.floor else "tail"
        shipped = getattr(usual, one.name)
        numbers = [f"{x:.4g}" for x in (one.value, one.tail.largest, shipped)]
        ratio = f"{one.value / shipped:.3g}"
        rows.append((one.name, *numbers, ratio, THRESHOLD_UNITS[one.name].replace("1", ""), by))
    head = ("threshold", "value", "largest seen", "shipped", "ratio", "unit", "set by")
    lines = [
        *order.dataset.notes,
        *format_calibration(found),
        "",
        format_table(head, rows),
        "",
        _NOT_WRITTEN if out is None else f"written to {out}",
    ]
    return "\n".join(lines)


DIAGNOSE = Command(
    "diagnose",
    "diagnose recorded runs of the robot or the rig, without any plant",
    """examples:
  omnimj record robot_missions --out data/missions
  omnimj diagnose data/missions --out out/diagnosis
  omnimj diagnose data/missions --method published --out out/published
  omnimj diagnose data/night --workers 8 --out out/night
  omnimj diagnose data/edge --floor-labels green,table --calibrate-on data/green data/table --out out/edge""",
    add_diagnose_arguments,
    run_diagnose,
)


CALIBRATE = Command(
    "calibrate",
    "set the thresholds of the robust method from fault-free recordings, for a rate of false alarms",
    """examples:
  omnimj record robot_missions --repeats 20 --out data/healthy
  omnimj calibrate data/healthy --false-alarms-per-hour 0.1 --out thresholds.toml
  omnimj diagnose data/missions --thresholds thresholds.toml --out out/diagnosis""",
    add_calibrate_arguments,
    run_calibrate,
)
