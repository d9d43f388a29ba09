"""`omnimj diagnose`: what a method says of recorded runs, without any plant."""

from __future__ import annotations

import argparse
import dataclasses
import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import (
    MODEL,
    add_floors,
    add_observer_gains,
    add_thresholds,
    read_observer_gains,
    read_thresholds,
)
from omnimj.cli.terminal import ProgressBar, announce_compilation, format_table, note_compiled

if TYPE_CHECKING:
    from omnimj.diagnosis.replay import DiagnosisConfig, RunDiagnosis
    from omnimj.parameters.floor import Floor
    from omnimj.recording.dataset import Dataset
    from omnimj.view.report.diagnosis import RunSection

HELP = "say what is broken in recorded runs of the robot or the rig, without any plant"
EXAMPLE = """examples:
  omnimj record robot_missions --out data/missions
  omnimj diagnose data/missions --out out/diagnosis
  omnimj diagnose data/missions --method published --out out/published"""

FILES = ("diagnoses.json", "report.html")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the sub-command."""
    parser.add_argument(
        "dataset",
        type=Path,
        help="a folder of recorded runs with dataset.toml, or of a run over a link, with frames.bin",
    )
    words = "robust (default on the robot) or published (default on the rig)"
    parser.add_argument("--method", metavar="M", help=words)
    parser.add_argument("--model", metavar="FILE", type=Path, help=MODEL)
    add_floors(parser)
    add_thresholds(parser)
    add_observer_gains(parser)
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="where the results go")
    parser.add_argument("--force", action="store_true", help="write into --out although it is not empty")
    parser.add_argument("--json", action="store_true", help="print diagnoses.json instead of the table")


def run(arguments: Any) -> int:
    """Reads, replays, writes run by run, prints.

    Returns:
      0, whatever was found; 130 after Ctrl-C with the runs that were finished.

    Raises:
      InputError: Bad data, a method that is not for them, or a folder that cannot be written.
    """
    from omnimj.diagnosis.replay import check_config, require_other_folder
    from omnimj.recording.folder import check_folder

    check_folder(arguments.out, arguments.force)
    order = _order(arguments)
    require_other_folder(order.dataset, arguments.out)
    check_config(order)
    announce_compilation(order.method, order.dataset.plant, "method")
    found, sections, interrupted = _diagnose(arguments, order)
    if not found:
        return 130
    note_compiled(order.method, order.dataset.plant)
    from omnimj.diagnosis.files import diagnoses_json, write_diagnoses
    from omnimj.recording.folder import atomic_file
    from omnimj.view.report.diagnosis import write_diagnosis_report

    command = shlex.join(["omnimj", *arguments.given])
    told = diagnoses_json(order, found, command, interrupted)
    write_diagnoses(arguments.out / FILES[0], told)
    with atomic_file(arguments.out / FILES[1]) as temporary:
        write_diagnosis_report(temporary, order, found, sections, command, interrupted)
    if arguments.json:
        print(json.dumps(told, indent=2, ensure_ascii=False))
    else:
        print(_format_diagnosis(order, found, interrupted, arguments.out))
    return 130 if interrupted else 0


def _order(arguments: Any) -> DiagnosisConfig:
    from omnimj.diagnosis.logs import read_machine, resolve_method
    from omnimj.diagnosis.replay import DiagnosisConfig
    from omnimj.parameters.floor import all_floors
    from omnimj.recording.read_dataset import read_dataset

    floors = all_floors(arguments.floors)
    dataset = _recorded(arguments, floors) or read_dataset(arguments.dataset, floors)
    machine = read_machine(dataset, arguments.model)
    method = resolve_method(arguments.method, machine)
    thresholds = read_thresholds(arguments.thresholds, method)
    observer = read_observer_gains(arguments.gains, method)
    return DiagnosisConfig(dataset, machine, method, floors, thresholds, observer)


def _recorded(arguments: Any, floors: Mapping[str, Floor]) -> Dataset | None:
    """The frames of a run over a link as a dataset; None for any other folder."""
    from omnimj.link.host.dataset import is_link_recording, read_link_recording
    from omnimj.parameters import read_robot
    from omnimj.parameters.floor import find_floor

    if not is_link_recording(arguments.dataset):
        return None
    dataset = read_link_recording(arguments.dataset, read_robot(arguments.model))
    find_floor(str(dataset.runs[0].conditions["floor"]), f"{arguments.dataset}: floor", floors)
    return dataset


def _diagnose(arguments: Any, order: DiagnosisConfig) -> tuple[list[RunDiagnosis], list[RunSection], bool]:
    """Each run's trace is written as soon as it is there; of the others nothing is kept but what was said."""
    from omnimj.diagnosis.logs import make_detector
    from omnimj.diagnosis.replay import diagnose
    from omnimj.recording.folder import make_folder
    from omnimj.recording.traces import write_trace
    from omnimj.signals import Trace
    from omnimj.view.report.diagnosis import MOST_FIGURES, run_section

    out, runs = arguments.out, order.dataset.runs
    names = make_detector(order.method, order.machine, runs[0], order.floors).log_names
    found: list[RunDiagnosis] = []
    sections: list[RunSection] = []
    try:
        with ProgressBar() as bar:
            for one in diagnose(order, bar.show):
                if not found:
                    make_folder(out, arguments.force, (*FILES, *(f"{run.name}.parquet" for run in runs)))
                about = {"dataset": str(order.dataset.path), "run": one.name, "method": order.method}
                said = [dataclasses.asdict(d) for d in one.diagnoses]
                trace = Trace(one.trace.columns, {**about, "diagnoses": said})
                write_trace(out / f"{one.name}.parquet", trace)
                section = run_section(one, names, len(found) < MOST_FIGURES)
                found.append(dataclasses.replace(one, trace=Trace({})))
                sections.append(section)
    except KeyboardInterrupt:
        return found, sections, True
    return found, sections, False


def _format_diagnosis(
    order: DiagnosisConfig, found: Sequence[RunDiagnosis], interrupted: bool, out: Path
) -> str:
    from omnimj.view.wording import (
        describe_confidence,
        describe_diagnosis,
        describe_time,
        describe_undiagnosed,
        describe_unjudged,
        summarize_runs,
    )

    rows = []
    for one in found:
        if not one.diagnoses:
            rows.append((one.name, describe_undiagnosed(one), describe_unjudged(one) or "–", ""))
        rows += [
            (one.name, describe_diagnosis(d), describe_time(d), describe_confidence(d)) for d in one.diagnoses
        ]
    lines = [*order.dataset.notes, *(note for one in found for note in one.notes)]
    lines += [format_table(("run", "what", "when", "how sure"), rows), ""]
    seconds = sum(one.judged for one in found)
    lines.append(f"{summarize_runs(found)}, method {order.method}, {seconds:.4g} s of data")
    if interrupted:
        lines.append("interrupted")
    lines.append(f"written to {out}")
    return "\n".join(lines)
