"""`omnimj scenarios`: lists what can be driven."""

from __future__ import annotations

import argparse
import json
from typing import Any

HELP = "list the scenarios with their one-line descriptions"
EXAMPLE = "example:\n  omnimj scenarios"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the sub-command."""
    parser.add_argument("--json", action="store_true", help="print a JSON object, name to description")


def run(arguments: Any) -> int:
    """Prints the list; imports nothing that takes time."""
    from omnimj.simulate.scenario.listing import list_scenarios

    described = list_scenarios()
    if arguments.json:
        print(json.dumps(described, indent=2, ensure_ascii=False))
        return 0
    width = max(map(len, described), default=0)
    for name, description in described.items():
        print(f"{name:{width}}  {description}")
    return 0
