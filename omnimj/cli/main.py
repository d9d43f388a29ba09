"""The command `omnimj`: sub-commands, exit codes, errors in one line."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NoReturn

from omnimj import __version__
from omnimj.cli import calibrate as calibrate_command
from omnimj.cli import completion as completion_command
from omnimj.cli import device as device_command
from omnimj.cli import diagnose as diagnose_command
from omnimj.cli import evaluate as evaluate_command
from omnimj.cli import gap as gap_command
from omnimj.cli import identify as identify_command
from omnimj.cli import link as link_command
from omnimj.cli import record as record_command
from omnimj.cli import run as run_command
from omnimj.cli import scenarios as scenarios_command
from omnimj.cli import sensitivity as sensitivity_command
from omnimj.cli import teleop as teleop_command
from omnimj.cli import tune as tune_command
from omnimj.cli import validate as validate_command
from omnimj.cli.terminal import drop_output, flush_output, prepare_streams
from omnimj.errors import InputError, OmnimjError, UnknownNameError

# What `omnimj` says of itself: the first meeting, and the list of sub-commands by what they are for.

WELCOME = f"""omnimj {__version__}: a MuJoCo twin of a four-wheel omni robot and of its test rig,
with faults and their diagnosis, and a way from measured runs to what the model
lacks.

  omnimj run nylon_patch --out out/nylon
      drives a scenario and judges it; open out/nylon/report.html, or add --view
      to watch it live
  omnimj scenarios
      lists what else can be driven
  omnimj gap DATASET --out out/gap
      says where the model parts from measured runs, and by which effect;
      without a robot, `omnimj record rig_mixed --out DATASET` makes such runs

All commands: omnimj --help. One of them, with examples: omnimj run --help.
"""

Groups = Mapping[str, tuple[str, ...]]
"""What commands are for → their names."""


class GroupedHelp(argparse.RawDescriptionHelpFormatter):
    """Lists the sub-commands of a parser under headings; one without a heading comes last."""

    def __init__(self, prog: str, groups: Groups):
        super().__init__(prog)
        self._groups = groups

    def _format_action(self, action: argparse.Action) -> str:
        if not isinstance(action, argparse._SubParsersAction):
            return super()._format_action(action)
        self._action_max_length += self._indent_increment  # the headings indent once more
        return "\n".join(self._blocks({one.dest: one for one in action._get_subactions()}))

    def _blocks(self, listed: dict[str, argparse.Action]) -> Iterator[str]:
        for title, names in (*self._groups.items(), ("Other", tuple(listed))):
            found = [listed.pop(name) for name in names if name in listed]
            if not found:
                continue
            self._indent()
            lines = "".join(super(GroupedHelp, self)._format_action(one) for one in found)
            self._dedent()
            yield f"{' ' * self._current_indent}{title}\n{lines}"


FAILED, BAD_INPUT, INTERRUPTED, NO_READER = 1, 2, 130, 141
GROUPS = {
    "Simulate": ("scenarios", "run", "teleop"),
    "Bring model and measurement together": ("record", "identify", "validate", "gap", "sensitivity"),
    "Diagnose and judge": ("diagnose", "calibrate", "evaluate", "tune"),
    "Robot on a wire": ("link", "device"),
    "This machine": ("bench", "completion"),
}
"""Sub-commands by what they are for, as the help lists them."""


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage above it."""

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """A name out of a list is told like every other; argparse would cut the list."""
        if action.choices is not None and value not in action.choices:
            kind = str(action.metavar or action.dest).lower()
            raise UnknownNameError(self.prog, kind, value, map(str, action.choices))

    def error(self, message: str) -> NoReturn:
        """Ends with the exit code of bad input."""
        raise InputError(self.prog, message, f"see {self.prog} --help")


def _bench_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def _run_bench(arguments: Any) -> int:
    from omnimj.cli.bench import run

    return run(arguments)


def make_parser() -> Parser:
    """The parser of `omnimj` with all its sub-commands; imports nothing that takes time."""
    parser = Parser(
        prog="omnimj",
        description="A MuJoCo twin of a four-wheel omni robot and of its one-wheel test rig.",
        epilog="example:\n  omnimj run nylon_patch --out out/nylon\n\nmore: omnimj COMMAND --help",
        formatter_class=lambda prog: GroupedHelp(prog, GROUPS),
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"omnimj {__version__}")
    commands = parser.add_subparsers(title="commands", dest="command", metavar="COMMAND", required=True)

    def add(
        name: str,
        description: str,
        example: str,
        add_arguments: Callable[[argparse.ArgumentParser], None],
        run: Callable[[Any], int],
    ) -> None:
        one = commands.add_parser(
            name,
            help=description,
            description=description[0].upper() + description[1:] + ".",
            epilog=example,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        add_arguments(one)
        options = [name for action in one._actions for name in action.option_strings]
        one.set_defaults(run=run, options=options)

    for name, module in (
        ("scenarios", scenarios_command),
        ("run", run_command),
        ("teleop", teleop_command),
        ("record", record_command),
        ("identify", identify_command),
        ("validate", validate_command),
        ("gap", gap_command),
        ("diagnose", diagnose_command),
        ("calibrate", calibrate_command),
        ("evaluate", evaluate_command),
        ("sensitivity", sensitivity_command),
        ("tune", tune_command),
        ("link", link_command),
        ("device", device_command),
        ("completion", completion_command),
    ):
        add(name, module.HELP, module.EXAMPLE, module.add_arguments, module.run)
    bench = "measure speed: steps per second, times real time, overhead of the callback, batch scaling"
    add("bench", bench, "example:\n  omnimj bench --json", _bench_arguments, _run_bench)
    return parser


def _parse(parser: Parser, given: list[str]) -> argparse.Namespace:
    """The arguments of one sub-command.

    Raises:
      InputError: No sub-command, or an argument that it does not have.
    """
    arguments, unknown = parser.parse_known_args(given)
    if unknown:
        place = f"omnimj {arguments.command}"
        if unknown[0].startswith("-"):
            raise UnknownNameError(place, "option", unknown[0].partition("=")[0], arguments.options)
        raise InputError(place, f"found {unknown[0]!r}, one argument too many", f"see {place} --help")
    return arguments


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one sub-command; without any argument says where to begin.

    Args:
      argv: Arguments without the program's name; those of the process when None.

    Returns:
      0 on success, 1 when a check failed or a simulation broke down, 2 on bad input, 130 on Ctrl-C, 141 when
      the reader of its output left before the work was done.
    """
    given = list(sys.argv[1:] if argv is None else argv)
    prepare_streams()
    code = NO_READER
    try:
        code = _run(given)
        flush_output()
        return code
    except InputError as error:
        return _print_error(error, BAD_INPUT)
    except OmnimjError as error:
        return _print_error(error, FAILED)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # the reader of a pipe, such as head, has read enough
        drop_output()
        return code
    except OSError as error:  # a file that may not be read, a disk that is full
        drop_output()
        return _print_error(InputError(error.filename or "omnimj", error.strerror or str(error)), BAD_INPUT)


def _run(given: list[str]) -> int:
    if not given:
        print(WELCOME, end="")
        return 0
    arguments = _parse(make_parser(), given)
    arguments.given = given
    return arguments.run(arguments)


def _print_error(error: Exception, code: int) -> int:
    text = " ".join(str(error).split())
    print(text if re.match(r"omnimj[ a-z]*: ", text) else f"omnimj: {text}", file=sys.stderr)
    return code
