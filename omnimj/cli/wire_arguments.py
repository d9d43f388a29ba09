"""Arguments of the sub-commands that use a link, and what they say about it."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.scenario.wires import Wire

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


def read_wire(arguments: Any, log_to: Path | None) -> Wire | None:
    """How the link is to be used; None for a plant that has none.

    Raises:
      InputError: An option of links, and no wire.
    """
    names = ("key_file", "lock_step", "real_time", "readonly", "dry_run", "reset_fault")
    given = [f"--{name.replace('_', '-')}" for name in names if getattr(arguments, name)]
    from omnimj.scenario.wires import Wire, is_wire

    if not is_wire(arguments.plant):
        if given:
            raise InputError(given[0], "there is no wire", f"it belongs to --plant {ADDRESS}")
        return None
    from omnimj.hardware.link_mode import Mode

    mode = Mode.READONLY if arguments.readonly else Mode.DRY_RUN if arguments.dry_run else Mode.DRIVE
    return Wire(arguments.key_file, arguments.lock_step, mode, arguments.reset_fault, log_to)


def told_link(link: Mapping[str, Any]) -> str:
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
    spreads = (f"{words[name]} {_spread(kept[name])}" for name in words if kept[name]["max"] > 0.0)
    lines.append("; ".join(spreads) + " (p50 / p99 / max)")
    return "\n".join(lines)


def _spread(record: Mapping[str, float]) -> str:
    return " / ".join(f"{1e3 * record[name]:.3g}" for name in ("p50", "p99", "max")) + " ms"
