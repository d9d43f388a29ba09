"""`omnimj import`: logs of other programs as a dataset, with a preview and a mapping file to edit."""

from __future__ import annotations

import argparse
import dataclasses
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import FAILED, Command, command_line, parse_names
from omnimj.cli.progress import progress_bar
from omnimj.cli.terminal import format_json, format_table

if TYPE_CHECKING:
    from omnimj.recording.importing.workflow import ImportPlan

_MOST = 12  # runs and notes that are printed; --json has all


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj import`."""
    words = "logs of one kind: .csv .txt .tsv .dat .log, .json .jsonl, .mat, .parquet, .mcap, "
    words += "folders of ROS 2 bags or their .db3"
    parser.add_argument("files", metavar="FILE", type=Path, nargs="+", help=words)
    words = "mapping to apply; where FILE does not exist, the proposed mapping is written to it"
    parser.add_argument("--mapping", metavar="FILE", type=Path, help=words)
    words = "folder of the dataset; without it, only a preview is printed"
    parser.add_argument("--out", metavar="DATASET", type=Path, help=words)
    words = "plant of the proposed mapping: uto_robot (any robot), quarter_rig, linear_axis or mjcf"
    parser.add_argument("--plant", metavar="P", dest="kind", help=words)
    words = "floor of all runs, in the proposed mapping"
    parser.add_argument("--floor", metavar="NAME", help=words)
    words = "topics of recorded messages to read, with commas; without it, all that have numbers"
    parser.add_argument("--topics", metavar="NAMES", type=parse_names, default=(), help=words)
    parser.add_argument(
        "--format", metavar="F", default="parquet", dest="table_format", help="parquet (default) or csv"
    )
    words = "replace an earlier dataset that omnimj wrote to --out, and an earlier proposed mapping"
    parser.add_argument("--force", action="store_true", help=words)
    parser.add_argument("--json", action="store_true", help="print the preview as JSON")


def run(arguments: Any) -> int:
    """Preview logs, propose a mapping, or write the dataset; 1 if the mapping is not complete for that."""
    from omnimj.errors import UnknownNameError
    from omnimj.recording.folder import check_folder
    from omnimj.recording.importing.mapping import PLANTS
    from omnimj.recording.importing.workflow import ImportConfig, plan_import, write_import
    from omnimj.recording.write_dataset import FORMATS

    if arguments.kind is not None and arguments.kind not in PLANTS:
        raise UnknownNameError("--plant", "plant", arguments.kind, PLANTS)
    if arguments.table_format not in FORMATS:
        raise UnknownNameError("--format", "format", arguments.table_format, FORMATS)
    if arguments.out is not None:
        check_folder(arguments.out, arguments.force)
    has_mapping = arguments.mapping is not None and os.path.lexists(arguments.mapping)
    config = ImportConfig(
        tuple(arguments.files),
        arguments.mapping if has_mapping else None,
        arguments.kind,
        arguments.floor,
        arguments.topics,
    )
    with progress_bar(arguments) as bar:
        plan = plan_import(config, bar.show)
    ready = plan.proposal.is_complete and len(plan.runs) == len(arguments.files)
    written: list[str] = []
    if arguments.out is not None and (ready or has_mapping):
        written = write_import(plan, arguments.out, arguments.force, arguments.table_format)
        done = f"written to {arguments.out}"
        if not has_mapping and arguments.mapping is not None:
            done += f"; {_write_proposal(plan, arguments)}"
    else:
        done = "the mapping is complete" if has_mapping and ready else ""
        done = done if has_mapping else _write_proposal(plan, arguments)
    content, text = _content(plan, arguments, written, done), _format(plan, written, done, has_mapping)
    print(format_json(content) if arguments.json else text)
    return FAILED if arguments.out is not None and not (ready or has_mapping) else 0


def _write_proposal(plan: ImportPlan, arguments: Any) -> str:
    """Write the proposed mapping, unless an earlier one is there; return what was done in words."""
    from omnimj.recording.folder import make_parents
    from omnimj.recording.importing.mapping import mapping_text
    from omnimj.recording.json_files import write_text

    first = arguments.files[0]
    file = arguments.mapping or first.with_name(f"{first.stem}.mapping.toml")
    if os.path.lexists(file) and not arguments.force:
        return f"{file} is there already and was kept: give it with --mapping, or --force to replace it"
    make_parents(file, file, "choose another file with --mapping")
    write_text(file, mapping_text(plan.proposal))
    return f"proposed mapping written to {file}: check it, then give it with --mapping"


def _content(plan: ImportPlan, arguments: Any, written: list[str], done: str) -> dict[str, Any]:
    from omnimj.recording.json_files import to_jsonable

    mapping = plan.proposal.mapping
    return to_jsonable(
        {
            "layouts": plan.layouts,
            "topics": [dataclasses.asdict(one) for one in plan.topics],
            "plant": mapping.plant,
            "missing": plan.proposal.missing,
            "unclear": plan.proposal.unclear,
            "columns": [dataclasses.asdict(one) for one in plan.columns],
            "left_out": plan.left_out,
            "plants": plan.plants,
            "runs": {name: dataclasses.asdict(quality) for name, quality in plan.quality.items()},
            "scalars": plan.scalars,
            "notes": [*plan.notes, *written],
            "result": done,
            "command": command_line(arguments),
        }
    )


def _format(plan: ImportPlan, written: list[str], done: str, has_mapping: bool) -> str:
    parts = ["\n".join(plan.layouts)]
    if plan.topics:
        parts.append(_format_topics(plan))
    parts.append(_format_columns(plan))
    if plan.left_out:
        parts[-1] += f"\nleft out: {', '.join(plan.left_out)}"
    if plan.scalars:
        parts[-1] += f"\nbeside the table: {', '.join(f'{k} = {v}' for k, v in plan.scalars.items())}"
    if plan.quality:
        parts.append(_format_runs(plan))
    parts.append(_format_plants(plan))
    notes = [*plan.notes, *written]
    if notes:
        more = [f"… and {len(notes) - _MOST} more notes (--json has all)"] if len(notes) > _MOST else []
        parts.append("\n".join([*_shortened(notes), *more]))
    lacking = [*plan.proposal.missing, *(f"a scale of {name}" for name in plan.proposal.unclear)]
    if lacking:
        parts.append(f"{'mapping' if has_mapping else 'proposed mapping'} lacks: {', '.join(lacking)}")
    return "\n\n".join([*parts, done]).rstrip()


def _shortened(notes: list[str]) -> list[str]:
    """Notes on the whole first, then those on single runs."""
    ordered = sorted(notes, key=lambda note: note.startswith("run "))
    return ordered[:_MOST]


def _format_topics(plan: ImportPlan) -> str:
    from omnimj.recording.importing.topics.join import LONGEST_GAP

    rows = [
        (one.name, one.type_name or "–", str(one.messages), f"{one.rate:.4g} 1/s", one.stamps, one.joined)
        for one in plan.topics
    ]
    table = format_table(("topic", "type", "messages", "rate", "stamps", "joined"), rows)
    words = (
        f"linear: between two messages at most {LONGEST_GAP:g} usual steps apart, else empty; whole numbers"
    )
    return f"{table}\n{words} and set values hold the last one"


def _format_columns(plan: ImportPlan) -> str:
    rows = [
        (one.name, one.unit or "–", f"{one.low:.5g} … {one.high:.5g}", one.becomes or "–", one.remark)
        for one in plan.columns
    ]
    return format_table(("column", "unit", "values", "becomes", "remark"), rows)


def _format_runs(plan: ImportPlan) -> str:
    rows = [
        (
            name,
            str(q.samples),
            f"{q.duration:.4g} s",
            f"{q.rate:.4g} 1/s",
            f"{1e3 * q.steps[0]:.3g} … {1e3 * q.steps[1]:.3g} ms",
            f"{q.gaps}, up to {q.longest_gap:.3g} s" if q.gaps else "–",
            f"{q.bursts:.0%}" if q.bursts else "–",
        )
        for name, q in list(plan.quality.items())[:_MOST]
    ]
    more = len(plan.quality) - _MOST
    table = format_table(("run", "samples", "duration", "rate", "steps", "gaps", "in bursts"), rows)
    return f"{table}\n… and {more} more runs" if more > 0 else table


def _format_plants(plan: ImportPlan) -> str:
    from omnimj.recording.importing.workflow import describe_plant

    rows = [
        (describe_plant(plan, plant), f"lacks {', '.join(missing)}" if missing else "has all columns")
        for plant, missing in plan.plants.items()
    ]
    return format_table(("plant", "columns"), rows)


IMPORT = Command(
    "import",
    "import logs of other programs as a dataset: CSV of any dialect, JSON, MATLAB, MCAP, ROS 2 bags",
    """Without --out it prints how the logs were understood, and writes a mapping file to edit beside the
first log, or to --mapping FILE. With a complete mapping and --out it writes the dataset.

examples:
  omnimj import logs/run_01.csv --mapping my_mapping.toml
  omnimj import logs/run_01.csv logs/run_02.csv --mapping my_mapping.toml --out data/robot
  omnimj import servo.json --plant mjcf --out data/servo
  omnimj import rosbag2_drive --topics /joint_states,/imu --mapping drive.toml

MCAP and ROS 2 bags need the libraries of the extra omnimj[import].""",
    add_arguments,
    run,
)
