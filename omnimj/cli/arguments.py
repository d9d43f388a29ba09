"""Kinds of arguments that several sub-commands take."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.control.gains import Gains
    from omnimj.control.robust.gains import ObserverGains


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
    from omnimj.control.robust.thresholds_file import read_thresholds

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


def add_observer(parser: argparse.ArgumentParser) -> None:
    """`--gains FILE` of commands that drive nothing."""
    words = "what the robust method's observer weighs with, from omnimj tune (default: as shipped)"
    parser.add_argument("--gains", metavar="FILE", type=Path, help=words)


def read_observer(file: Path | None, method: str) -> ObserverGains | None:
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


def names(text: str) -> tuple[str, ...]:
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
