"""The command `omnimj`: sub-commands, exit codes, errors in one line."""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from omnimj import __version__
from omnimj.cli import run as run_command
from omnimj.cli import scenarios as scenarios_command
from omnimj.errors import InputError, OmnimjError

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage above it."""

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
        epilog="example:\n  omnimj run nylon_patch --out out/nylon",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"omnimj {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)

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
        one.set_defaults(run=run)

    for name, module in (("scenarios", scenarios_command), ("run", run_command)):
        add(name, module.HELP, module.EXAMPLE, module.add_arguments, module.run)
    bench = "measure speed: steps per second, times real time, overhead of the callback, batch scaling"
    add("bench", bench, "example:\n  omnimj bench --json", _bench_arguments, _run_bench)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one sub-command.

    Args:
      argv: Arguments without the program's name; those of the process when None.

    Returns:
      0 on success, 1 when a check failed or a simulation broke down, 2 on bad input, 130 on Ctrl-C.
    """
    given = list(sys.argv[1:] if argv is None else argv)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without "≥" shows a "?" instead of a traceback
    try:
        arguments = make_parser().parse_args(given)
        arguments.given = given
        code = arguments.run(arguments)
        sys.stdout.flush()
        return code
    except InputError as error:
        return _say(error, BAD_INPUT)
    except OmnimjError as error:
        return _say(error, FAILED)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # the reader of a pipe has had enough; keep Python from complaining when it flushes at the end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except OSError as error:  # a file that may not be read, a disk that is full
        return _say(InputError(error.filename or "omnimj", error.strerror or str(error)), BAD_INPUT)


def _say(error: Exception, code: int) -> int:
    print(f"omnimj: {' '.join(str(error).split())}", file=sys.stderr)
    return code
