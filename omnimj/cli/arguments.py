"""Kinds of arguments that several sub-commands take."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.control.gains import Gains, ObserverGains


ROBOT_MODEL = "a shipped robot by name (three_wheel), or a copy of robot.toml with changed values"
MODEL = "a shipped robot by name (three_wheel), or a copy of robot.toml or rig.toml with changed values"
"""What `--model` takes, without and with the test rig."""


def add_floors(parser: argparse.ArgumentParser) -> None:
    """`--floors FILE`."""
    words = "floors beside the shipped ones, or in their place, e.g. from omnimj identify"
    parser.add_argument("--floors", metavar="FILE", type=Path, help=words)


def add_thresholds(parser: argparse.ArgumentParser) -> None:
    """`--thresholds FILE`."""
    words = "of the robust method, from omnimj calibrate (default: the shipped ones)"
    parser.add_argument("--thresholds", metavar="FILE", type=Path, help=words)


def read_thresholds(file: Path | None, method: str) -> Any:
    """What `--thresholds` names; None without it.

    Raises:
      InputError: It is for another method, or the file is wrong.
    """
    if file is None:
        return None
    from omnimj.control.detection.robust.thresholds import read_thresholds

    if method != "robust":
        raise InputError(f"--thresholds {file}", f"the method is {method!r}", "they are those of 'robust'")
    return read_thresholds(file)


def add_gains(parser: argparse.ArgumentParser) -> None:
    """`--gains FILE`."""
    words = "of cascade, recovery and observer, from omnimj tune (default: the model's and the shipped ones)"
    parser.add_argument("--gains", metavar="FILE", type=Path, help=words)


def read_gains_file(file: Path | None, model: Path | None = None) -> Gains | None:
    """The gains in a file, over those of a model; None without one.

    Raises:
      InputError, UnknownNameError: As `control.gains.read_gains` and `read_robot`.
    """
    if file is None:
        return None
    from omnimj.control.gains import read_gains
    from omnimj.parameters import read_robot

    return read_gains(file, read_robot(model).control)


def add_observer_gains(parser: argparse.ArgumentParser) -> None:
    """`--gains FILE` of commands that drive nothing."""
    words = "what the robust method's observer weighs with, from omnimj tune (default: as shipped)"
    parser.add_argument("--gains", metavar="FILE", type=Path, help=words)


def read_observer_gains(file: Path | None, method: str) -> ObserverGains | None:
    """The observer's gains in a file; None without one.

    Raises:
      InputError: It is for another method, or as `control.gains.read_gains`.
    """
    if file is None:
        return None
    if method != "robust":
        raise InputError(f"--gains {file}", f"the method is {method!r}", "only 'robust' has an observer")
    gains = read_gains_file(file)
    return None if gains is None else gains.observer


def add_executor(parser: argparse.ArgumentParser) -> None:
    """`--executor URL`."""
    words = "hand the work to a Dask cluster: dask:tcp://HOST:PORT of its scheduler (needs omnimj[dask])"
    parser.add_argument("--executor", metavar="URL", help=words)


def parse_names(text: str) -> tuple[str, ...]:
    """A kind for argparse: names with commas between them."""
    found = tuple(name.strip() for name in text.split(","))
    if not all(found):
        raise argparse.ArgumentTypeError(f"found {text[:40]!r}; names with commas between them are needed")
    return found


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """A kind for argparse: a whole number in plain digits, low … high."""

    def read(text: str) -> int:
        plain = text.isascii() and text.isdigit() and len(text) < 20
        if not (plain and low <= int(text) <= high):
            rule = f"must be a whole number, at least {low} and at most {high}"
            raise argparse.ArgumentTypeError(f"found {text[:40]!r}; {rule}")
        return int(text)

    return read


# Arguments of the sub-commands that use a link, and what they say about it.

if TYPE_CHECKING:
    from omnimj.simulate.plants import LinkOptions

ADDRESS = "serial:DEVICE?baud=N or udp:HOST:PORT"


def add_key(parser: argparse.ArgumentParser) -> None:
    """`--key-file FILE`."""
    words = "key of the link, 64 hexadecimal digits, mode 0600; needed off this machine"
    parser.add_argument("--key-file", metavar="FILE", type=Path, help=words)


def add_clock(parser: argparse.ArgumentParser) -> None:
    """`--lock-step` and `--real-time`."""
    clock = parser.add_mutually_exclusive_group()
    words = "simulated time, which goes on by one period per command: fast and reproducible, never for motors"
    clock.add_argument("--lock-step", action="store_true", help=words)
    clock.add_argument("--real-time", action="store_true", help="by the clock (default)")


def add_wire(parser: argparse.ArgumentParser) -> None:
    """What `omnimj run` takes for a plant behind a wire."""
    add_key(parser)
    add_clock(parser)
    mode = parser.add_mutually_exclusive_group()
    words = "with a wire: send nothing but hello and ping; what the controller would do is logged"
    mode.add_argument("--readonly", action="store_true", help=words)
    words = "with a wire: send commands of zero and never arm; what the controller would do is logged"
    mode.add_argument("--dry-run", action="store_true", help=words)
    words = "with a wire: the fault that the device has latched has been seen and may be reset"
    parser.add_argument("--reset-fault", action="store_true", help=words)


def read_wire(arguments: Any, log_to: Path | None) -> LinkOptions | None:
    """How the link is to be used; None for a plant that has none.

    Raises:
      InputError: An option of links, and no wire.
    """
    names = ("key_file", "lock_step", "real_time", "readonly", "dry_run", "reset_fault")
    given = [f"--{name.replace('_', '-')}" for name in names if getattr(arguments, name)]
    from omnimj.simulate.plants import LinkOptions, is_link_address

    if not is_link_address(arguments.plant):
        if given:
            raise InputError(given[0], "there is no wire", f"it belongs to --plant {ADDRESS}")
        return None
    from omnimj.link.host.link import LinkMode

    mode = (
        LinkMode.READONLY if arguments.readonly else LinkMode.DRY_RUN if arguments.dry_run else LinkMode.DRIVE
    )
    return LinkOptions(arguments.key_file, arguments.lock_step, mode, arguments.reset_fault, log_to)


def format_link(link: Mapping[str, Any]) -> str:
    """A link's record of `metrics.json` in a few lines."""
    kept, keyed = link["deadlines"], ", keyed" if link["is_keyed"] else ""
    lines = [
        f"link: {link['address']}, {link['mode']}{keyed}; {link['sent']} frames "
        f"sent, {link['received']} received, {link['lost']} lost, {link['dropped']} dropped; "
        f"the device dropped {link['device_dropped']} and refused {link['device_refused']}"
    ]
    if link["mode"] == "lock-step":
        return f"{lines[0]}; {link['resent']} asked again"
    lines.append(
        f"deadlines: {kept['missed']} of {kept['periods']} missed, "
        f"{kept['held']} readings not there in time, {kept['skipped']} not used"
    )
    words = {"response": "command after reading", "late": "reading late by", "command_age": "command's age"}
    spreads = (f"{words[name]} {_format_spread(kept[name])}" for name in words if kept[name]["max"] > 0.0)
    lines.append("; ".join(spreads) + " (p50 / p99 / max)")
    return "\n".join(lines)


def _format_spread(record: Mapping[str, float]) -> str:
    return " / ".join(f"{1e3 * record[name]:.3g}" for name in ("p50", "p99", "max")) + " ms"
