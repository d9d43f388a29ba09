"""`omnimj link`: what can be asked of the link to a robot, a sub-command each."""

from __future__ import annotations

import argparse
from typing import Any

from omnimj.cli import link_check, link_fuzz

HELP = "test the link to a robot"
_COMMANDS = (("check", link_check), ("fuzz", link_fuzz))
# what is said below the examples of one command is for its own help
_EXAMPLES = (
    line for _, module in _COMMANDS for line in module.EXAMPLE.splitlines() if line.startswith("  omnimj ")
)
EXAMPLE = "\n".join(("examples:", *_EXAMPLES))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Sub-commands of the sub-command."""
    commands = parser.add_subparsers(dest="link_command", metavar="COMMAND", required=True)
    for name, module in _COMMANDS:
        one = commands.add_parser(
            name,
            help=module.HELP,
            description=module.HELP[0].upper() + module.HELP[1:] + ".",
            epilog=module.EXAMPLE,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        module.add_arguments(one)
        options = [name for action in one._actions for name in action.option_strings]
        one.set_defaults(link_run=module.run, options=options)


def run(arguments: Any) -> int:
    """Runs what was asked for."""
    return arguments.link_run(arguments)
