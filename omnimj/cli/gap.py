"""`omnimj gap`: search for the physics that a model lacks, and the benchmark of that search."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import (
    Command,
    add_accept,
    add_floors,
    add_results,
    add_seed,
    add_workers,
    command_line,
    exit_code,
    parse_names,
    whole_number,
)
from omnimj.cli.progress import progress_bar, run_on_executor
from omnimj.cli.scoreboard import add_scoreboard_arguments, run_scoreboard_command
from omnimj.cli.terminal import (
    format_data_faults,
    format_json,
    format_study,
    format_table,
    print_result,
    print_study,
)
from omnimj.errors import InputError, SimulationError

if TYPE_CHECKING:
    from omnimj.estimate.gap.records import Finding
    from omnimj.studies.gap_benchmark.study import BenchmarkResult

_BY_CTRL_C = "interrupted"
MODEL, MJCF_MODEL, FLOORS, DIGEST, REPORT, RECORDING = FILES = (
    "model.toml",
    "model.xml",
    "floors.toml",
    "gap.json",
    "report.html",
    "before_after.rrd",
)
"""Files of a search, in the order in which they are written."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj gap`."""
    words = "folder of the measured runs"
    parser.add_argument("dataset", metavar="DATASET", type=Path, nargs="*", help=words)
    parser.add_argument(
        "--model",
        metavar="FILE",
        type=Path,
        help="model file of the plant (default: the shipped one); for any other machine its MJCF file",
    )
    add_floors(parser)
    parser.add_argument(
        "--holdout",
        metavar="NAMES",
        type=parse_names,
        default=(),
        help="runs or conditions to hold out for judging, comma separated (default: drawn by the seed)",
    )
    add_accept(parser)
    add_results(parser, "gap.json", required=False)
    add_seed(parser, "seed of the held-out runs and of the random curves, or of the benchmark")
    add_workers(parser.add_argument_group("many searches", "of benchmark and scoreboard"))
    add_benchmark_arguments(parser)
    add_scoreboard_arguments(parser)


def run(arguments: Any) -> int:
    """Search for the gap between model and measurement and write the result."""
    from omnimj.recording.folder import check_folder

    if arguments.scoreboard and not arguments.benchmark:
        return run_scoreboard_command(arguments)
    if arguments.out is None:
        raise InputError("omnimj gap", "the following arguments are required: --out", "see omnimj gap --help")
    if arguments.benchmark:
        return run_gap_benchmark(arguments)
    check_folder(arguments.out, arguments.force)
    _require_no_folders(arguments.out)
    finding = _search(arguments, _only_dataset(arguments))
    return _write_and_print(arguments, finding)


def _only_dataset(arguments: Any) -> Path:
    """The one dataset of a plain search."""
    if arguments.data is not None:
        raise InputError("--data", f"found {arguments.data}", "it belongs to --scoreboard")
    if not arguments.dataset:
        raise InputError("omnimj gap", "DATASET is missing", "see omnimj gap --help")
    if len(arguments.dataset) > 1:
        rule = "--scoreboard searches many datasets"
        raise InputError("omnimj gap", f"found {str(arguments.dataset[1])!r}, one argument too many", rule)
    return arguments.dataset[0]


def _require_no_folders(folder: Path) -> None:
    """Check before the search that no folder occupies the name of an output file."""
    for name in FILES:
        if (folder / name).is_dir():
            raise InputError(f"--out {folder}", f"has a folder {name}", "a file will go there")


def _search(arguments: Any, dataset: Path) -> Finding:
    from omnimj.estimate.gap.find import find_gap

    with progress_bar(arguments) as bar:
        return find_gap(
            dataset,
            arguments.model,
            arguments.holdout,
            bar.show_share,
            arguments.seed,
            arguments.floors,
            accept=arguments.accept,
        )


def new_texts(
    finding: Finding, model: Path | None, floors_file: Path | None
) -> tuple[dict[str, str], InputError | None]:
    """Return the texts of new model and floors, or an error to raise once the other files are written."""
    from omnimj.estimate.gap.files import new_floors_text, new_model_files
    from omnimj.parameters.floor import all_floors

    try:
        texts = new_model_files(finding, model or finding.model)
        floors = new_floors_text(finding, all_floors(floors_file), model)
    except InputError as error:
        return {}, error
    return texts if floors is None else {**texts, FLOORS: floors}, None


def gap_content(finding: Finding, texts: Mapping[str, str], command: str) -> dict[str, Any]:
    """Return the content of `gap.json`, which names the files of the new model and floors."""
    from omnimj.estimate.gap.files import digest

    model = next((name for name in (MJCF_MODEL, MODEL) if name in texts), None)
    return digest(finding, model, FLOORS if FLOORS in texts else None, command)


def _write_and_print(arguments: Any, finding: Finding) -> int:
    """Print and write the finding, also that of an interrupted search: a full disk must not cost it."""
    texts, refused = new_texts(finding, arguments.model, arguments.floors)
    content = gap_content(finding, texts, command_line(arguments))
    failed = finding.failure and finding.failure != _BY_CTRL_C
    if refused is None and not failed:
        print_result(format_json(content) if arguments.json else format_finding(finding))
    write_outputs(arguments.out, arguments.force, finding, arguments.model, content, texts)
    if refused is not None:
        raise refused
    if failed:
        raise SimulationError(f"{finding.failure}; everything found until then is in {arguments.out}")
    if not arguments.json:
        print(f"\n{_format_written(arguments.out, content)}")
    return exit_code(finding.failure)


def write_outputs(
    folder: Path,
    force: bool,
    finding: Finding,
    machine_file: Path | None,
    content: Mapping[str, Any],
    texts: Mapping[str, str],
) -> None:
    """Write model, floors, `gap.json`, `report.html` and `before_after.rrd`, each in full or not at all."""
    from omnimj.recording.folder import make_folder
    from omnimj.recording.json_files import write_json, write_text
    from omnimj.view.report.gap import write_gap_report
    from omnimj.view.rerun.before_after import has_scene, write_before_after

    make_folder(folder, force, FILES)
    for name in (MODEL, MJCF_MODEL, FLOORS):
        if name in texts:
            write_text(folder / name, texts[name])
        else:  # a file of an earlier search, which `force` replaces
            (folder / name).unlink(missing_ok=True)
    write_json(folder / DIGEST, content)
    write_gap_report(folder / REPORT, finding, content["model"], content["floors"], content["command"])
    if finding.overlays and has_scene(finding.plant):
        write_before_after(folder / RECORDING, finding, machine_file)


def _format_written(folder: Path, content: Mapping[str, Any]) -> str:
    new = [f"the new model is {folder / content['model']}"] if content["model"] else []
    new += [f"the refitted floors are {folder / content['floors']}"] if content["floors"] else []
    return "; ".join([f"written to {folder}", *new])


def format_finding(finding: Finding) -> str:
    """Format data check, verdict, location and size of the gap, missing effects and next step."""
    from omnimj.estimate.gap import sentences
    from omnimj.recording.read_dataset import INCOMPLETE

    incomplete = [note for note in finding.data_notes if note.startswith(INCOMPLETE)]
    parts = [
        *incomplete,
        format_data_faults(finding.data_faults),
        f"{sentences.headline(finding)}\n{sentences.summarize_finding(finding)}",
        sentences.as_sentence(finding.reason),
        _format_where(finding),
        _format_effects(finding),
        _format_gaps(finding),
        _format_next(finding),
        _format_notes([note for note in finding.data_notes if note not in incomplete]),
    ]
    return "\n\n".join(part for part in parts if part)


def _format_notes(notes: Sequence[str]) -> str:
    """Notes on the data, a line each; those on single runs, which may be many, are counted."""
    shown = [note for note in notes if not note.startswith("run ")]
    if left := len(notes) - len(shown):
        shown.append(f"{left} note{'s' * (left > 1)} on single runs: see the report")
    return "\n".join(shown)


def _format_where(finding: Finding) -> str:
    from omnimj.estimate.gap.sentences import format_amount, format_percent, format_regime

    rows = []
    for place in finding.where:
        unit = finding.channels.get(place.channel, ("", ""))[0]
        rows.append(
            (
                format_percent(place.share),
                place.channel,
                format_amount(place.before, unit),
                format_amount(place.after, unit),
                format_regime(place),
            )
        )
    return _format_titled("where", ("share", "channel", "before", "after", "regime"), rows)


def _format_effects(finding: Finding) -> str:
    from omnimj.estimate.gap.sentences import (
        effect_label,
        format_amount,
        format_number,
        format_percent,
        join_words,
    )

    rows, notes = [], []
    for effect in finding.effects:
        p_false = "–" if effect.p_false is None else format_number(effect.p_false, 2)
        first = (effect_label(effect), format_percent(effect.gain.value), p_false)
        for k, (name, value) in enumerate(effect.parameters.items()):
            low, high = format_amount(value.low, "1"), format_amount(value.high, "1")
            shown = (name, format_amount(value.value, value.unit), f"{low} … {high}")
            rows.append((*(first if k == 0 else ("", "", "")), *shown))
        if effect.indistinguishable_from:
            rivals = join_words(effect.indistinguishable_from, "or")
            notes.append(f"{effect_label(effect)} cannot be distinguished from {rivals} with these data")
    head = ("effect", "gain", "p_false", "parameter", "value", "90 %")
    return "\n".join(part for part in (_format_titled("what is missing", head, rows), *notes) if part)


def _format_gaps(finding: Finding) -> str:
    from omnimj.estimate.gap.sentences import format_amount, format_percent

    rows = []
    for channel, gap in finding.heldout.items():
        unit = finding.channels.get(channel, ("", ""))[0]
        smaller = "–" if gap.after is None or not gap.before else format_percent(1.0 - gap.after / gap.before)
        rows.append(
            (
                channel,
                format_amount(gap.before, unit),
                format_amount(gap.after, unit),
                smaller,
                format_amount(gap.floor, unit),
                format_amount(finding.noise.get(channel), unit),
            )
        )
    head = ("channel", "before", "after", "smaller by", "repeats", "noise")
    return _format_titled("RMS mismatch on held-out runs", head, rows)


def _format_next(finding: Finding) -> str:
    from omnimj.estimate.gap import sentences
    from omnimj.view.report.finding_tables import format_conditions

    lines = [*sentences.summarize_given_up(finding), f"next: {sentences.next_step(finding)}"]
    if finding.next_experiment:
        driven = finding.next_experiment.get("run") or {}
        lines += [f"run to drive: {format_conditions(driven)}", sentences.format_separation(finding)]
    return "\n".join(lines)


def _format_titled(title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return f"{title}\n{format_table(head, rows)}" if rows else ""


def add_benchmark_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `--benchmark`."""
    group = parser.add_argument_group(
        "benchmark", "synthetic datasets with hidden truths; no DATASET is given"
    )
    words = "hide effects drawn by --seed, search blind, score; an interrupted --out is resumed"
    group.add_argument("--benchmark", action="store_true", help=words)
    count = whole_number(1, 1000)
    words = "repetitions of the set of cases, 257 of the rig or 60 of another machine (default 1)"
    group.add_argument("--trials", metavar="N", type=count, default=1, help=words)
    words = "only the first N cases, which are in random order"
    group.add_argument("--cases", metavar="N", type=whole_number(1, 10**6), help=words)
    words = "plant that makes the data of the rig: twin (default), or planar, which is faster"
    group.add_argument("--made-by", metavar="M", default="twin", help=words)
    words = (
        "machine of the datasets: quarter_rig (default), servo_arm, two_link_arm, linear_axis or an MJCF file"
    )
    group.add_argument("--plant", metavar="P", default="quarter_rig", help=words)


def run_gap_benchmark(arguments: Any) -> int:
    """Run the benchmark of the search; 1 if a search failed."""
    given = {"DATASET": arguments.dataset, "--model": arguments.model, "--holdout": arguments.holdout}
    given |= {"--data": arguments.data, "--scoreboard": arguments.scoreboard}
    for name, value in given.items():
        if value:
            raise InputError(
                "--benchmark", f"found {name}", "the benchmark makes its own data for the shipped model"
            )
    from omnimj.studies.gap_benchmark.study import NUMBERS, BenchmarkConfig, run_benchmark
    from omnimj.view.report.evaluation import write_tables_report

    order = BenchmarkConfig(
        arguments.out,
        arguments.seed,
        arguments.trials,
        arguments.cases,
        arguments.made_by,
        arguments.workers,
        arguments.plant,
    )
    outcome = run_on_executor(arguments, run_benchmark, order)
    heading = "Blind benchmark of the gap workflow"
    write_tables_report(arguments.out / REPORT, heading, outcome.lines, outcome.tables, NUMBERS)
    print_study(arguments.out, NUMBERS, lambda: _format_benchmark(outcome, arguments.out), arguments.json)
    return exit_code(outcome.interrupted, outcome.failed)


def _format_benchmark(outcome: BenchmarkResult, folder: Path) -> str:
    head = "\n".join(line.replace("**", "") for line in outcome.lines)
    return format_study([head], outcome.tables, (), outcome.interrupted, folder)


GAP = Command(
    "gap",
    "find what a model lacks: where it disagrees with measured runs, and which effect explains it",
    """examples:
  omnimj gap data/lateral --out out/lateral
  omnimj gap data/axis --model my_axis.toml --holdout sine_07,slow --out out/axis
  omnimj validate data/lateral --model out/lateral/model.toml --out out/after
  omnimj gap --benchmark --seed 100 --workers 2 --out out/benchmark
  omnimj gap --scoreboard my_machine --data downloads --out out/scoreboard""",
    add_arguments,
    run,
)
