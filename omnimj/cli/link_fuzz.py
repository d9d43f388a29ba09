"""`omnimj link fuzz`: frames over bad wires, for as long as one likes."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import whole_number
from omnimj.cli.terminal import ProgressBar, format_table

if TYPE_CHECKING:
    from omnimj.link.check.fuzz import FuzzReport

HELP = "send frames with flips, drops, inserts, duplicates and noise, and see what is accepted"
EXAMPLE = """examples:
  omnimj link fuzz
  omnimj link fuzz --frames 1000000 --noise 100000000 --seed 1 --json"""
_FRAMES, _NOISE = 100_000, 10_000_000
_MAX_COUNT = 10**12
_MAX_GROWTH = 16 * 1024.0  # [kB] an allocator may take its time to give back, a leak would be far more


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the sub-command."""
    parser.add_argument(
        "--frames",
        metavar="N",
        type=whole_number(1, _MAX_COUNT),
        default=_FRAMES,
        help=f"how many (default {_FRAMES})",
    )
    parser.add_argument(
        "--noise",
        metavar="BYTES",
        type=whole_number(0, _MAX_COUNT),
        default=_NOISE,
        help=f"of noise among them (default {_NOISE})",
    )
    seed = whole_number(0, 2**63 - 1)
    parser.add_argument("--seed", metavar="N", type=seed, default=0, help="of all that is drawn (default 0)")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run(arguments: Any) -> int:
    """Sends, counts, prints.

    Returns:
      0 when all that came whole was accepted, nothing else was, and memory did not grow; else 1.
    """
    from omnimj.link.check.fuzz import fuzz

    with ProgressBar() as bar:
        report = fuzz(
            arguments.frames,
            arguments.noise,
            arguments.seed,
            lambda done: bar.show(min(done, arguments.frames), arguments.frames),
        )
    passed = report.passed and report.peak_growth <= _MAX_GROWTH
    found = _summarize_fuzz(report, arguments.seed, passed)
    if arguments.json:
        print(json.dumps(found, indent=2))
    else:
        rows = [
            (name.replace("_", " "), _format_count(value)) for name, value in found.items() if name != "drops"
        ]
        rows += [
            (f"dropped: {name.replace('_', ' ')}", _format_count(count))
            for name, count in found["drops"].items()
        ]
        print(format_table(("what", "found"), rows))
    return 0 if passed else 1


def _summarize_fuzz(report: FuzzReport, seed: int, passed: bool) -> dict[str, Any]:
    from omnimj.link.codec.layout import DropReason

    return {
        "frames": report.frames,
        "noise_bytes": report.noise,
        "seed": seed,
        "came_whole": report.whole,
        "accepted": report.accepted,
        "accepted_wrongly": report.wrong,
        "memory_growth_kb": report.peak_growth,
        "blocks_growth": report.blocks_growth,
        "seconds": report.seconds,
        "passed": passed,
        "drops": {drop.name.lower(): report.drops[drop] for drop in DropReason},
    }


def _format_count(value: float) -> str:
    if isinstance(value, bool):
        return "yes" if value else "NO"
    return f"{value:,}" if isinstance(value, int) else f"{value:,.1f}"
