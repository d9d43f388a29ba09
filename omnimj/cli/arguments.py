"""Building blocks of the commands: the `Command` record, and arguments shared by several commands."""

from __future__ import annotations

import argparse
import math
import os
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.errors import InputError, OutputError

if TYPE_CHECKING:
    from omnimj.control.gains import Gains, ObserverGains
    from omnimj.simulate.plants import LinkOptions


@dataclass(frozen=True)
class Command:
    """Sub-command of `omnimj`."""

    name: str
    help: str
    """Help text: one line in lower case, without a full stop."""
    epilog: str
    """Text below the options in the help: examples, then notes."""
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[Any], int]
    """Function of the parsed arguments that does the work and returns the exit code: 0; 130 after Ctrl-C,
    with all that was finished kept; 1 as its docstring says. `main` turns errors into one line and a code."""
    resumes: bool = False
    """True if the command continues what it has left in `--out` when it is given again."""

    def add_to(self, commands: Any, key: str = "run") -> None:
        """Add the command to sub-commands of a parser; attribute `key` of its arguments holds `run`."""
        parser = commands.add_parser(
            self.name,
            help=self.help,
            description=self.help[0].upper() + self.help[1:] + ".",
            epilog=self.epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        self.add_arguments(parser)
        _add_output_options(parser)
        options = [name for action in parser._actions for name in action.option_strings]
        parser.set_defaults(**{key: self.run}, options=options, resumes=self.resumes)


def _add_output_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of every command on its messages."""
    group = parser.add_argument_group("messages")
    amount = group.add_mutually_exclusive_group()
    amount.add_argument("-q", "--quiet", action="store_true", help="no progress, only results and errors")
    amount.add_argument("-v", "--verbose", action="store_true", help="also say on stderr what is done")
    group.add_argument("--log", metavar="FILE", type=Path, help="append what is done to FILE, with times")


ADDRESS = "serial:DEVICE?baud=N or udp:HOST:PORT"
ROBOT_MODEL = "a shipped robot by name (three_wheel), or a copy of robot.toml with changed values"
MODEL = "a shipped robot by name (three_wheel), or a copy of robot.toml or rig.toml with changed values"
"""Help texts of `--model`, without and with the test rig."""


FAILED, NO_ANSWER, INTERRUPTED = 1, 3, 130
"""Exit codes after a failed check or simulation, without an answer of a machine, and after Ctrl-C."""


def exit_code(interrupted: object, failed: object = False) -> int:
    """Return the exit code of finished work; an interruption takes precedence over a failure."""
    return INTERRUPTED if interrupted else FAILED if failed else 0


def command_line(arguments: Any) -> str:
    """Return the command line that repeats the work, as quoted in reports and files."""
    return shlex.join(["omnimj", *arguments.given])


def add_floors(parser: argparse.ArgumentParser) -> None:
    """Add `--floors FILE`."""
    words = "floors beside the shipped ones, or in their place, e.g. from omnimj identify"
    parser.add_argument("--floors", metavar="FILE", type=Path, help=words)


def add_thresholds(parser: argparse.ArgumentParser) -> None:
    """Add `--thresholds FILE`."""
    words = "thresholds of the robust method, from omnimj calibrate (default: the shipped ones)"
    parser.add_argument("--thresholds", metavar="FILE", type=Path, help=words)


def read_thresholds(file: Path | None, method: str) -> Any:
    """Read the file given by `--thresholds`; return None without the option."""
    if file is None:
        return None
    from omnimj.control.detection.robust.thresholds import read_thresholds

    if method != "robust":
        raise InputError(f"--thresholds {file}", f"the method is {method!r}", "they are those of 'robust'")
    return read_thresholds(file)


def add_accept(parser: argparse.ArgumentParser, also: str = "") -> None:
    """Add `--accept`, which may do something else as well."""
    words = (
        "go on with data that a check holds back (wrong time base, unit, sign or delay); units are corrected"
    )
    parser.add_argument("--accept", action="store_true", help=f"{words}; {also}" if also else words)


def add_gains(parser: argparse.ArgumentParser) -> None:
    """Add `--gains FILE`."""
    words = "gains of cascade, recovery and observer, from omnimj tune (default: model and shipped ones)"
    parser.add_argument("--gains", metavar="FILE", type=Path, help=words)


def read_gains_file(file: Path | None, model: Path | None = None) -> Gains | None:
    """Read the gains in a file, completed by the model's; return None without a file."""
    if file is None:
        return None
    from omnimj.control.gains import read_gains
    from omnimj.parameters import read_robot

    return read_gains(file, read_robot(model).control)


def add_observer_gains(parser: argparse.ArgumentParser) -> None:
    """Add `--gains FILE` to a command that drives nothing."""
    words = "gains of the robust method's observer, from omnimj tune (default: the shipped ones)"
    parser.add_argument("--gains", metavar="FILE", type=Path, help=words)


def read_observer_gains(file: Path | None, method: str) -> ObserverGains | None:
    """Read the observer's gains in a file; return None without a file."""
    if file is None:
        return None
    if method != "robust":
        raise InputError(f"--gains {file}", f"the method is {method!r}", "only 'robust' has an observer")
    gains = read_gains_file(file)
    return None if gains is None else gains.observer


def add_workers(parser: argparse._ActionsContainer) -> None:
    """Add `--workers N` and `--executor URL`."""
    words = "number of processes, or of threads (default 1)"
    parser.add_argument("--workers", metavar="N", type=whole_number(1, 256), default=1, help=words)
    words = "threads (of this process), dask:tcp://HOST:PORT (needs omnimj[dask]) or "
    words += "slurm:jobs=N,cores=N,memory=8GB,walltime=HH:MM:SS,queue=Q,account=A (needs omnimj[slurm])"
    parser.add_argument("--executor", metavar="URL", help=words)


def parse_names(text: str) -> tuple[str, ...]:
    """Parse names separated by commas, for argparse."""
    found = tuple(name.strip() for name in text.split(","))
    if not all(found):
        raise argparse.ArgumentTypeError(f"found {text[:40]!r}; names with commas between them are needed")
    return found


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """Make an argparse type for whole numbers in plain digits from `low` to `high`."""

    def read(text: str) -> int:
        plain = text.isascii() and text.isdigit() and len(text) < 20
        if not (plain and low <= int(text) <= high):
            rule = f"must be a whole number, at least {low} and at most {high}"
            raise argparse.ArgumentTypeError(f"found {text[:40]!r}; {rule}")
        return int(text)

    return read


def positive_number(most: float) -> Callable[[str], float]:
    """Make an argparse type for numbers above 0 and up to `most`."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0.0 < value <= most:
            raise argparse.ArgumentTypeError(f"found {text[:40]!r}; must be above 0 and at most {most:g}")
        return value

    return read


def add_seed(parser: argparse.ArgumentParser, words: str, most: int = 2**63 - 1, default: int = 0) -> None:
    """Add `--seed N`, from 0 to `most`; `words` describes what is drawn from it.

    Seeds are stored in files whose readers have 64-bit integers.
    """
    parser.add_argument(
        "--seed",
        metavar="N",
        type=whole_number(0, most),
        default=default,
        help=f"{words} (default {default})",
    )


def add_overrides(parser: argparse.ArgumentParser, example: str) -> None:
    """Add `--set KEY=VALUE` as `overrides`."""
    words = f"change a value of the scenario file, e.g. {example}; repeatable"
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], dest="overrides", help=words
    )


def add_results(
    parser: argparse.ArgumentParser, json_file: str, replaced: str = "", required: bool = True
) -> None:
    """Add `--out DIR`, `--force` and `--json` to a command that writes a folder.

    `--force` replaces the kind of work `replaced`, and `--json` prints the file `json_file` of the folder.
    """
    parser.add_argument("--out", metavar="DIR", type=Path, required=required, help="folder for the results")
    words = "write into --out although it is not empty"
    if replaced:
        words += f"; another {replaced} there is replaced"
    parser.add_argument("--force", action="store_true", help=words)
    parser.add_argument("--json", action="store_true", help=f"print {json_file} instead of tables")


def has_out(arguments: Any, kind: str = "DIR") -> bool:
    """Return whether the optional `--out` is given.

    Raises:
      InputError: `--force` is given without it.
    """
    if arguments.force and arguments.out is None:
        raise InputError("--force", "there is no --out", f"it belongs to --out {kind}")
    return arguments.out is not None


def require_writable(file: Path, force: bool, option: str = "--out") -> None:
    """Check before the work that the file of an option can be written; missing folders are created later.

    Raises:
      InputError: The file exists and `force` is false, or it is a folder.
      OutputError: Its folder is read-only.
    """
    place = f"{option} {file}"
    if file.is_dir() or not file.name:
        raise InputError(place, "is a folder", "a file is needed")
    if os.path.lexists(file) and not force:
        raise InputError(place, "exists already", "choose another file, or --force to replace it")
    nearest = next(one for one in file.absolute().parents if os.path.lexists(one))
    if not nearest.is_dir():
        raise InputError(place, f"cannot be made, {nearest} is a file", "a folder is needed")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise OutputError(place, f"{nearest} is read-only", "choose another folder")


def add_key(parser: argparse.ArgumentParser) -> None:
    """Add `--key-file FILE`."""
    words = "key of the link, 64 hexadecimal digits, mode 0600; needed off this machine"
    parser.add_argument("--key-file", metavar="FILE", type=Path, help=words)


def add_clock(parser: argparse.ArgumentParser) -> None:
    """Add `--lock-step` and `--real-time`."""
    clock = parser.add_mutually_exclusive_group()
    words = "simulated time, one period per command: fast and reproducible, never for real motors"
    clock.add_argument("--lock-step", action="store_true", help=words)
    clock.add_argument("--real-time", action="store_true", help="wall-clock time (default)")


def add_wire(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj run` for a plant connected by a link."""
    add_key(parser)
    add_clock(parser)
    mode = parser.add_mutually_exclusive_group()
    words = "with a wire: send nothing, listen at the own address to what a device sends to its --monitor"
    mode.add_argument("--readonly", action="store_true", help=words)
    words = "with a wire: send zero commands and never arm; the controller's commands are only logged"
    mode.add_argument("--dry-run", action="store_true", help=words)
    add_reset_fault(parser)


def add_reset_fault(parser: argparse.ArgumentParser) -> None:
    """Add `--reset-fault`."""
    words = "with a wire: reset a latched fault of the device, once its cause has been found"
    parser.add_argument("--reset-fault", action="store_true", help=words)


def read_wire(arguments: Any, log_to: Path | None) -> LinkOptions | None:
    """Read the options of the link; return None for a plant without one."""
    names = ("key_file", "lock_step", "real_time", "readonly", "dry_run", "reset_fault")
    given = [f"--{name.replace('_', '-')}" for name in names if getattr(arguments, name)]
    from omnimj.simulate.plants import LinkOptions, is_link_address

    if not is_link_address(arguments.plant):
        if given:
            raise InputError(given[0], "there is no wire", f"it belongs to --plant {ADDRESS}")
        return None
    from omnimj.link.host.link import LinkMode
    from omnimj.link.transport.address import SerialAddress, parse_address
    from omnimj.link.transport.serial_port import require_library

    if isinstance(address := parse_address(arguments.plant, "--plant"), SerialAddress):
        require_library(address)
    mode = (
        LinkMode.READONLY if arguments.readonly else LinkMode.DRY_RUN if arguments.dry_run else LinkMode.DRIVE
    )
    return LinkOptions(arguments.key_file, arguments.lock_step, mode, arguments.reset_fault, log_to)
