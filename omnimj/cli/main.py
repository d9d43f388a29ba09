"""Entry point `omnimj`: sub-commands, exit codes, errors in one line."""

from __future__ import annotations

import argparse
import errno
import logging
import os
import re
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

from omnimj import __version__
from omnimj.cli.arguments import FAILED, INTERRUPTED, NO_ANSWER, Command, command_line
from omnimj.cli.bench import BENCH
from omnimj.cli.compare import COMPARE
from omnimj.cli.completion import COMPLETION
from omnimj.cli.device import DEVICE
from omnimj.cli.diagnose import CALIBRATE, DIAGNOSE
from omnimj.cli.docs import DOCS
from omnimj.cli.export import EXPORT
from omnimj.cli.gap import GAP
from omnimj.cli.identify import IDENTIFY, VALIDATE
from omnimj.cli.import_logs import IMPORT
from omnimj.cli.link import LINK
from omnimj.cli.progress import logging_to, start_notice
from omnimj.cli.record import RECORD
from omnimj.cli.report_bug import REPORT_BUG, store_last_command
from omnimj.cli.run import RUN, SCENARIOS
from omnimj.cli.studies import EVALUATE, SENSITIVITY
from omnimj.cli.teleop import TELEOP
from omnimj.cli.terminal import drop_output, ended_by_signals, flush_output, prepare_streams
from omnimj.cli.tune import TUNE
from omnimj.cli.wheels import ROBOT, WHEEL
from omnimj.errors import InputError, NoAnswer, OmnimjError, UnknownNameError

_LOG = logging.getLogger(__name__)
WELCOME = f"""omnimj {__version__}: a MuJoCo twin of a four-wheel omni robot and of its test rig,
with faults and their diagnosis, and a search for the physics that the model
lacks compared with measured runs.

  omnimj run nylon_patch --out out/nylon
      drives a scenario and judges it; open out/nylon/report.html, or add --view
      to watch it live
  omnimj scenarios
      lists what else can be driven
  omnimj gap DATASET --out out/gap
      finds where model and measurement disagree, and which effect explains it;
      without a robot, `omnimj record rig_mixed --out DATASET` makes such runs

All commands: omnimj --help. One of them, with examples: omnimj run --help.
"""

BAD_INPUT, NO_READER = 2, 141
_REFUSED_BY_SYSTEM = (
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EIO,
    errno.EROFS,
    errno.EACCES,
    errno.EPERM,
)
"""Full disk, quota, size limit, failing disk, missing right."""
GROUPS: Mapping[str, tuple[Command, ...]] = {
    "Simulate": (SCENARIOS, RUN, COMPARE, TELEOP),
    "Bring model and measurement together": (RECORD, IMPORT, EXPORT, IDENTIFY, VALIDATE, GAP, SENSITIVITY),
    "Diagnose and judge": (DIAGNOSE, CALIBRATE, EVALUATE, TUNE),
    "Wheels for plain MuJoCo": (WHEEL, ROBOT),
    "Robot on a wire": (LINK, DEVICE),
    "This machine": (BENCH, COMPLETION, DOCS, REPORT_BUG),
}
"""Sub-commands by purpose, as the help lists them."""


class GroupedHelp(argparse.RawDescriptionHelpFormatter):
    """Help that lists the sub-commands under the headings of `GROUPS`."""

    def _format_action(self, action: argparse.Action) -> str:
        if not isinstance(action, argparse._SubParsersAction):
            return super()._format_action(action)
        self._action_max_length += self._indent_increment  # the headings add one level of indentation
        listed = {one.dest: one for one in action._get_subactions()}
        return "\n".join(
            self._block(title, [listed[one.name] for one in group]) for title, group in GROUPS.items()
        )

    def _block(self, title: str, listed: Sequence[argparse.Action]) -> str:
        self._indent()
        lines = "".join(super(GroupedHelp, self)._format_action(one) for one in listed)
        self._dedent()
        return f"{' ' * self._current_indent}{title}\n{lines}"


class Parser(argparse.ArgumentParser):
    """Parser that reports an error in one line, without the usage text."""

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Report an unknown name with all choices; argparse would abridge the list."""
        if action.choices is not None and value not in action.choices:
            kind = str(action.metavar or action.dest).lower()
            raise UnknownNameError(self.prog, kind, value, map(str, action.choices))

    def error(self, message: str) -> NoReturn:
        """Raise instead of exiting, so that the exit code is that of invalid input."""
        raise InputError(self.prog, message, f"see {self.prog} --help")


def make_parser() -> Parser:
    """Make the parser of `omnimj` with all sub-commands, without slow imports."""
    parser = Parser(
        prog="omnimj",
        description="A MuJoCo twin of a four-wheel omni robot and of its one-wheel test rig.",
        epilog="example:\n  omnimj run nylon_patch --out out/nylon\n\nmore: omnimj COMMAND --help",
        formatter_class=GroupedHelp,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"omnimj {__version__}")
    commands = parser.add_subparsers(title="commands", dest="command", metavar="COMMAND", required=True)

    for group in GROUPS.values():
        for command in group:
            command.add_to(commands)
    return parser


def _parse(parser: Parser, given: list[str]) -> argparse.Namespace:
    """Parse the arguments of one sub-command."""
    arguments, unknown = parser.parse_known_args(given)
    if unknown:
        place = f"omnimj {arguments.command}"
        if unknown[0].startswith("-"):
            raise UnknownNameError(place, "option", unknown[0].partition("=")[0], arguments.options)
        raise InputError(place, f"found {unknown[0]!r}, one argument too many", f"see {place} --help")
    return arguments


def main(argv: Sequence[str] | None = None) -> int:
    """Run the sub-command of `argv`, or of the process; without arguments, print how to begin.

    Returns:
      0 on success; 1 if a check or a simulation failed, or a file cannot be written; 2 on invalid input; 3 if
      a robot behind a link does not answer; 130 on Ctrl-C or SIGTERM; 141 if the reader of the output closed
      the pipe.
    """
    given = list(sys.argv[1:] if argv is None else argv)
    prepare_streams()
    try:
        code = _end(given)
    except Exception as error:
        _store(given, FAILED, f"{type(error).__name__}: {error}")
        print(
            "omnimj: this is a fault of omnimj; `omnimj report-bug` prints what a report needs",
            file=sys.stderr,
        )
        raise
    return code


def _end(given: list[str]) -> int:
    """Run a sub-command, and end every expected failure with one line and its exit code."""
    code = NO_READER
    try:
        with ended_by_signals():
            code = _run(given)
        flush_output()
        _store(given, code)
        return code
    except NoAnswer as error:
        return _end_by(given, error, NO_ANSWER)
    except InputError as error:
        return _end_by(given, error, BAD_INPUT)
    except OmnimjError as error:
        return _end_by(given, error, FAILED)
    except KeyboardInterrupt:
        print("omnimj: interrupted before the work began", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of the pipe, such as head, has closed it
        drop_output()
        return code
    except OSError as error:  # for example an impossible file name, or standard output on a full disk
        drop_output()
        code = FAILED if error.errno in _REFUSED_BY_SYSTEM else BAD_INPUT
        return _end_by(given, InputError(error.filename or "omnimj", error.strerror or str(error)), code)


def _run(given: list[str]) -> int:
    if not given:
        print(WELCOME, end="")
        return 0
    arguments = _parse(make_parser(), given)
    arguments.given = given
    # the matrices are too small to benefit from multithreaded linear algebra; numpy is not imported yet
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with logging_to(arguments), start_notice(arguments):
        _LOG.info("omnimj %s: %s", __version__, command_line(arguments))
        try:
            code = arguments.run(arguments)
        except KeyboardInterrupt:
            _LOG.info("interrupted")
            _store(given, INTERRUPTED)
            print(f"omnimj: interrupted; {_kept(arguments)}", file=sys.stderr)
            return INTERRUPTED
        except Exception as error:
            _LOG.debug("ended by %s", type(error).__name__, exc_info=True)
            raise
        _LOG.info("exit code %d", code)
        return code


def _kept(arguments: argparse.Namespace) -> str:
    """Describe what an interrupted command leaves behind, and how to go on."""
    out = getattr(arguments, "out", None)
    if arguments.resumes:
        return "what was finished is kept, and the same command continues"
    if out is None:
        return "nothing was to be written; the same command begins again"
    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return f"nothing is in {out} yet; the same command begins again"
    return f"every file in {out} is complete; the same command with --force begins again"


def _end_by(given: list[str], error: Exception, code: int) -> int:
    """Print an error in one line and return the exit code."""
    text = " ".join(str(error).split())
    text = text if re.match(r"omnimj[ a-z-]*: ", text) else f"omnimj: {text}"
    _store(given, code, text)
    print(text, file=sys.stderr)
    return code


def _store(given: list[str], code: int, error: str = "") -> None:
    store_last_command(["omnimj", *given], code, error)
