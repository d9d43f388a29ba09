"""`omnimj run`: drives one scenario, prints its checks, writes its folder."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.progress import ProgressBar
from omnimj.cli.tables import shown, table
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.scenario.running import Run

HELP = "drive one scenario and judge it by its checks"
EXAMPLE = """examples:
  omnimj run nylon_patch
  omnimj run nylon_patch --set floor=pvc --set drive.speed=0.8 --out out/nylon
  omnimj run degraded_motor --plant planar --seed 3 --json"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the sub-command."""
    parser.add_argument("scenario", help="a name from `omnimj scenarios`, or a path to a TOML file")
    parser.add_argument("--plant", metavar="P", help="twin (default) or planar")
    parser.add_argument("--method", metavar="M", default="off", help="diagnosis; this version has only: off")
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of the sensors' noise (default 0)")
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        dest="overrides",
        help="change a value of the scenario file, e.g. faults.0.wheel=3; may be given many times",
    )
    parser.add_argument("--model", metavar="FILE", type=Path, help="a copy of robot.toml or rig.toml")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, help="write trace, metrics, recording and report here"
    )
    parser.add_argument("--force", action="store_true", help="write into --out although it is not empty")
    parser.add_argument("--view", action="store_true", help="open the run in Rerun")
    parser.add_argument("--json", action="store_true", help="print metrics.json instead of the table")


def run(arguments: Any) -> int:
    """Drives, prints, writes.

    Returns:
      0 when every check holds, 1 when one does not, 130 after Ctrl-C with what was recorded until then.
    """
    from omnimj.recording.folder import check_folder
    from omnimj.scenario.scenario import read_scenario

    if arguments.seed < 0:
        raise InputError("--seed", f"found {arguments.seed}", "must be at least 0")
    if arguments.force and arguments.out is None:
        raise InputError("--force", "there is no --out", "it belongs to --out DIR")
    if arguments.out is not None:
        check_folder(arguments.out, arguments.force)
    scenario = read_scenario(arguments.scenario, arguments.overrides, arguments.model)
    finished = _drive(arguments, scenario)
    if not finished.metrics:
        return 130
    finished.metrics["command"] = shlex.join(["omnimj", *arguments.given])
    if arguments.out is not None:
        from omnimj.cli.outputs import write_outputs

        write_outputs(arguments.out, arguments.force, finished)
    print(json.dumps(finished.metrics, indent=2) if arguments.json else _told(finished, arguments.out))
    if arguments.view:
        from omnimj.cli.outputs import show

        show(finished, arguments.out)
    if finished.interrupted:
        return 130
    return 0 if finished.metrics["passed"] else 1


def _drive(arguments: Any, scenario: Any) -> Run:
    from omnimj.physics.native import is_compiled, mark_compiled
    from omnimj.scenario.plants import KINEMATIC, plant_name
    from omnimj.scenario.running import require_method, run_scenario

    require_method(arguments.method)
    plant = plant_name(scenario, arguments.plant)
    if plant != KINEMATIC and not is_compiled():
        print("compiling native code, once, this takes a minute …", file=sys.stderr, flush=True)
    with ProgressBar() as bar:
        finished = run_scenario(scenario, arguments.plant, arguments.method, arguments.seed, bar.show)
    if plant == "twin" and not finished.interrupted:
        mark_compiled()
    return finished


def _told(finished: Run, out: Path | None) -> str:
    """What was driven, the table of checks, the verdict."""
    metrics, units = finished.metrics, finished.scenario.metric_units
    lines = [
        f"{metrics['scenario']}: {finished.scenario.description}",
        f"{metrics['robot']} on {metrics['floor']}, plant {metrics['plant']}, method {metrics['method']}, "
        f"seed {metrics['seed']}, {metrics['duration']:g} s at {metrics['realtime_factor']:.3g} × real time",
        "",
    ]
    rows = []
    for check in metrics["checks"]:
        unit, sign = units[check["name"]], "≥" if check["bound"] == "min" else "≤"
        limit = f"{sign} {shown(check['limit'], unit)}"
        rows.append((check["name"], shown(check["value"], unit), limit, "ok" if check["ok"] else "FAILED"))
    lines.append(table(("check", "value", "limit", ""), rows) if rows else "no checks")
    lines.append("")
    if finished.interrupted:
        lines.append("interrupted")
    else:
        failed = sum(not check["ok"] for check in metrics["checks"])
        lines.append(f"failed: {failed} of {len(rows)} checks" if failed else "passed")
    if out is not None:
        lines.append(f"written to {out}")
    return "\n".join(lines)
