"""`omnimj validate`: measured currents drive the model; RMS speed errors beside the published table."""

from __future__ import annotations

import argparse
import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import add_floors
from omnimj.cli.terminal import ProgressBar, announce_compilation, format_table, note_compiled
from omnimj.errors import UnknownNameError

if TYPE_CHECKING:
    from omnimj.estimate.identification.records import Cell, Validation

HELP = "drive the model with measured currents: RMS speed errors beside the published table"
EXAMPLE = """examples:
  omnimj record rig_validation --out data/validation
  omnimj validate data/validation --out out/validation
  omnimj validate data/validation --model out/gap/model.toml --plant twin --out out/after"""

FILES = ("validation.json", "report.html")
CHOICES = ("twin", "planar", "both")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the sub-command."""
    parser.add_argument("dataset", type=Path, help="a folder of rig runs with dataset.toml")
    parser.add_argument(
        "--model", metavar="FILE", type=Path, help="a copy of rig.toml with changed values or effects"
    )
    add_floors(parser)
    parser.add_argument("--plant", metavar="P", default="both", help="twin, planar or both (default)")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="where the results go")
    parser.add_argument("--force", action="store_true", help="write into --out although it is not empty")
    parser.add_argument("--json", action="store_true", help="print validation.json instead of the table")


def run(arguments: Any) -> int:
    """Reads, replays, prints, writes.

    Returns:
      0, or 130 after Ctrl-C with the runs that were finished.

    Raises:
      InputError: Bad data, a bad model, or a folder that cannot be written.
      SimulationError: A simulation broke down.
    """
    from omnimj.recording.folder import check_folder

    if arguments.plant not in CHOICES:
        raise UnknownNameError("--plant", "plant", arguments.plant, CHOICES)
    plants = ("twin", "planar") if arguments.plant == "both" else (arguments.plant,)
    check_folder(arguments.out, arguments.force)
    from omnimj.parameters import read_rig
    from omnimj.parameters.floor import all_floors
    from omnimj.recording.read_dataset import read_dataset

    rig, floors = read_rig(arguments.model), all_floors(arguments.floors)
    dataset = read_dataset(arguments.dataset, floors)
    for plant in plants:
        announce_compilation(plant, "quarter_rig")
    from omnimj.estimate.identification.files import validation_content
    from omnimj.estimate.identification.validation import validate

    with ProgressBar() as bar:
        found = validate(dataset, rig, floors, plants, bar.show)
    if not found.runs:
        return 130
    for plant in plants:
        note_compiled(plant, "quarter_rig")
    told = validation_content(found, shlex.join(["omnimj", *arguments.given]))
    _write(arguments, found, told)
    print(
        json.dumps(told, indent=2, ensure_ascii=False)
        if arguments.json
        else _format_validation(found, arguments.out)
    )
    return 130 if found.interrupted else 0


def _write(arguments: Any, found: Validation, told: dict[str, Any]) -> None:
    from omnimj.estimate.identification.files import write_validation
    from omnimj.recording.folder import atomic_file, make_folder
    from omnimj.view.report.validation import write_validation_report

    make_folder(arguments.out, arguments.force, FILES)
    write_validation(arguments.out / FILES[0], told)
    with atomic_file(arguments.out / FILES[1]) as temporary:
        write_validation_report(temporary, found, told["command"])


def _format_validation(found: Validation, out: Path) -> str:
    sideways = any(cell.lateral_speed for cell in found.cells)
    head = ["mass kg", "floor", *(["lateral m/s"] if sideways else []), "current A"]
    head += [f"{plant} m/s" for plant in found.plants] + ["published m/s"]
    lines = [*found.notes, format_table(head, [_row(cell, found.plants, sideways) for cell in found.cells])]
    means = ", ".join(f"{plant} {found.mean(plant):.4f}" for plant in found.plants)
    lines.append(f"RMS error of the carriage's speed, mean over {len(found.cells)} conditions: {means} m/s")
    if found.effects:
        lines.append(f"the model carries {', '.join(found.effects)}")
    if found.interrupted:
        lines.append("interrupted")
    lines.append(f"written to {out}")
    return "\n".join(lines)


def _row(cell: Cell, plants: tuple[str, ...], sideways: bool) -> list[str]:
    row = [f"{cell.mass:g}", cell.floor, *([f"{cell.lateral_speed:+.2f}"] if sideways else [])]
    row += [f"{cell.current:.2f}", *(f"{cell.rms[plant]:.4f}" for plant in plants)]
    return [*row, " → ".join(f"{value:.3f}" for value in cell.published) or "–"]
