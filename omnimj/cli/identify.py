"""`omnimj identify`: LuGre parameters per floor from rig runs, with intervals."""

from __future__ import annotations

import argparse
import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.terminal import ProgressBar, format_table

if TYPE_CHECKING:
    from omnimj.estimate.identification.records import Estimate, Identification, IdentifiedFloor

HELP = "LuGre parameters of each floor from rig runs, with intervals and what the runs cannot tell"
EXAMPLE = """writes floors.toml (for omnimj validate --floors), identification.json, report.html

examples:
  omnimj record rig_currents --out data/currents
  omnimj identify data/currents --out out/floors
  omnimj validate data/validation --floors out/floors/floors.toml --out out/validation"""

FILES = ("floors.toml", "identification.json", "report.html")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the sub-command."""
    parser.add_argument("dataset", type=Path, help="a folder of rig runs with dataset.toml")
    parser.add_argument("--model", metavar="FILE", type=Path, help="a copy of rig.toml with changed values")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="where the results go")
    parser.add_argument("--force", action="store_true", help="write into --out although it is not empty")
    parser.add_argument("--json", action="store_true", help="print identification.json instead of the table")


def run(arguments: Any) -> int:
    """Reads, fits, prints, writes.

    Returns:
      0, or 130 after Ctrl-C with the floors that were finished.

    Raises:
      InputError: Bad data, a folder that cannot be written, or data in which nothing moves.
    """
    from omnimj.recording.folder import check_folder

    check_folder(arguments.out, arguments.force)
    from omnimj.estimate.identification.files import identification_content
    from omnimj.estimate.identification.identify import identify
    from omnimj.parameters import read_rig
    from omnimj.recording.read_dataset import read_dataset

    rig, dataset = read_rig(arguments.model), read_dataset(arguments.dataset)
    with ProgressBar() as bar:
        found = identify(dataset, rig, bar.show)
    if found.interrupted and not found.floors:
        return 130
    told = identification_content(found, shlex.join(["omnimj", *arguments.given]))
    _write(arguments, found, told)
    print(
        json.dumps(told, indent=2, ensure_ascii=False)
        if arguments.json
        else _format_identification(found, arguments.out)
    )
    return 130 if found.interrupted else 0


def _write(arguments: Any, found: Identification, told: dict[str, Any]) -> None:
    from omnimj.estimate.identification.files import write_floors, write_identification
    from omnimj.recording.folder import atomic_file, make_folder
    from omnimj.view.report.identification import write_identification_report

    make_folder(arguments.out, arguments.force, FILES)
    write_floors(arguments.out / FILES[0], found)
    write_identification(arguments.out / FILES[1], told)
    with atomic_file(arguments.out / FILES[2]) as temporary:
        write_identification_report(temporary, found, told["command"])


def _format_identification(found: Identification, out: Path) -> str:
    lines = list(found.notes)
    for floor in found.floors:
        lines += ["", *_format_floor(floor)]
    lines += ["", *(["interrupted"] if found.interrupted else []), f"written to {out}"]
    return "\n".join(lines).lstrip("\n")


def _format_floor(floor: IdentifiedFloor) -> list[str]:
    low, high = floor.curve.covered
    lines = [f"{floor.floor}: {len(floor.runs)} runs, masses {', '.join(f'{m:g}' for m in floor.masses)} kg"]
    rows = [(e.name, f"{e.value:.4g} {e.unit}", format_interval(e)) for e in floor.estimates]
    lines.append(format_table(("parameter", "value", "90 % interval"), rows))
    if low == low:
        lines.append(f"curve F/F_N over {1000 * low:.3g} … {1000 * high:.3g} mm/s of slip")
    lines += [f"- {said}" for said in floor.undetermined]
    if floor.left_out:
        lines.append(f"- not fitted, since slip never shows in them: {', '.join(floor.left_out)}")
    return lines


def format_interval(estimate: Estimate) -> str:
    """`0.118 … 0.122`, or which end is open."""
    if estimate.low is None and estimate.high is None:
        return "not determined"
    if estimate.low is None:
        return f"≤ {estimate.high:.4g}, open below"
    if estimate.high is None:
        return f"≥ {estimate.low:.4g}, open above"
    return f"{estimate.low:.4g} … {estimate.high:.4g}"
