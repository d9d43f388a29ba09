"""`omnimj calibrate`: thresholds of the robust method from fault-free recordings."""

from __future__ import annotations

import argparse
import json
import math
import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import ROBOT_MODEL, add_floors, add_observer_gains, read_observer_gains
from omnimj.cli.terminal import ProgressBar, announce_compilation, format_table, note_compiled
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.diagnosis.calibration import Calibration
    from omnimj.diagnosis.replay import DiagnosisConfig

HELP = "set the thresholds of the robust method from fault-free recordings, at a rate of false alarms"
EXAMPLE = """examples:
  omnimj record robot_missions --repeats 20 --out data/healthy
  omnimj calibrate data/healthy --false-alarms-per-hour 0.1 --out thresholds.toml
  omnimj diagnose data/missions --thresholds thresholds.toml --out out/diagnosis"""

_LOWEST, _HIGHEST = 1e-6, 3600.0  # [1/h]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the sub-command."""
    words = "a folder of recorded runs of the robot, all of them without a fault"
    parser.add_argument("dataset", type=Path, help=words)
    words = "how many there may be in an hour of motion, all thresholds together"
    parser.add_argument(
        "--false-alarms-per-hour", metavar="X", type=_rate, required=True, dest="rate", help=words
    )
    parser.add_argument("--model", metavar="FILE", type=Path, help=ROBOT_MODEL)
    add_floors(parser)
    add_observer_gains(parser)
    parser.add_argument("--out", metavar="FILE", type=Path, required=True, help="the file to write")
    parser.add_argument("--force", action="store_true", help="write --out although it is there")
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


def run(arguments: Any) -> int:
    """Reads, replays twice, writes, prints.

    Raises:
      InputError: Bad data, data of another machine than the robot, or a file that cannot be written.
    """
    _require_writable(arguments.out, arguments.force)
    order = _order(arguments)
    from omnimj.diagnosis.calibration import calibrate
    from omnimj.diagnosis.files import calibration_json, thresholds_toml, write_thresholds
    from omnimj.diagnosis.replay import check_config, require_other_folder

    require_other_folder(order.dataset, arguments.out.parent)
    check_config(order)
    announce_compilation(order.method, order.dataset.plant, "method")
    with ProgressBar() as bar:
        found = calibrate(order, arguments.rate, bar.show)
    note_compiled(order.method, order.dataset.plant)
    command = shlex.join(["omnimj", *arguments.given])
    write_thresholds(arguments.out, thresholds_toml(found, order.dataset, command))
    if arguments.json:
        print(json.dumps(calibration_json(found, order.dataset, command), indent=2, ensure_ascii=False))
    else:
        print(_format_calibration(found, order, arguments.out))
    return 0


def _require_writable(path: Path, force: bool) -> None:
    place = f"--out {path}"
    if path.is_dir():
        raise InputError(place, "is a folder", "a file is needed")
    if path.exists() and not force:
        raise InputError(place, "is there already", "choose another file, or --force to replace it")
    nearest = next(one for one in path.absolute().parents if os.path.lexists(one))
    if not nearest.is_dir():
        raise InputError(place, f"cannot be made, {nearest} is a file", "a folder is needed")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(place, f"cannot be written, {nearest} is read-only", "choose another folder")


def _order(arguments: Any) -> DiagnosisConfig:
    from omnimj.diagnosis.logs import read_machine
    from omnimj.diagnosis.replay import DiagnosisConfig
    from omnimj.parameters.floor import all_floors
    from omnimj.recording.read_dataset import read_dataset

    floors = all_floors(arguments.floors)
    dataset = read_dataset(arguments.dataset, floors)
    if dataset.plant != "uto_robot":
        rule = "the robust method, whose thresholds these are, is for the robot"
        raise InputError(arguments.dataset, f"plant is {dataset.plant!r}", rule, ("uto_robot",))
    observer = read_observer_gains(arguments.gains, "robust")
    return DiagnosisConfig(
        dataset, read_machine(dataset, arguments.model), "robust", floors, observer=observer
    )


def _format_calibration(found: Calibration, order: DiagnosisConfig, out: Path) -> str:
    from omnimj.control.detection.robust.thresholds import THRESHOLD_UNITS, Thresholds
    from omnimj.diagnosis.files import format_calibration

    usual, rows = Thresholds(), []
    for one in found.set:
        by = "its floor" if one.value == one.floor else "the tail"
        numbers = [f"{x:.4g}" for x in (one.value, one.tail.largest, getattr(usual, one.name))]
        rows.append((one.name, *numbers, THRESHOLD_UNITS[one.name], by))
    head = ("threshold", "value", "largest seen", "shipped", "unit", "set by")
    lines = [
        *order.dataset.notes,
        *format_calibration(found),
        "",
        format_table(head, rows),
        "",
        f"written to {out}",
    ]
    return "\n".join(lines)
