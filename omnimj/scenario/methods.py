"""Which way to diagnose a run."""

from __future__ import annotations

from omnimj.control.method import Method
from omnimj.errors import InputError
from omnimj.parameters import Rig, Robot

METHODS = ("off",)
"""Ways to diagnose: in this version there is none."""


def require_method(method: str) -> None:
    """Refuses what this version cannot do.

    Raises:
      InputError: A method that this version does not have.
    """
    if method not in METHODS:
        raise InputError("--method", f"found {method!r}", "this version has no diagnosis yet", METHODS)


def make_method(name: str, machine: Robot | Rig, period: float) -> Method | None:
    """The method of that name for robot or rig; None for `off`.

    Args:
      name: Of `METHODS`.
      machine: What the controller believes the plant to be.
      period: Control period [s].

    Raises:
      InputError: A method that this version does not have.
    """
    require_method(name)
    return None
