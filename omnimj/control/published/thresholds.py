"""Thresholds of the residuals, Eqs. 5.3, 5.8, 5.13 and 5.21: printed, or from runs of the twin.

Each is the largest value of a few runs: the next run exceeds it with probability 1/(n + 1).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from omnimj.control.published.choice import Choice
from omnimj.errors import InputError
from omnimj.parameters.reading import positive, read_table
from omnimj.parameters.toml_file import read_toml
from omnimj.resources import models_folder


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Above it a residual counts as 1 in Tables 5.1 and 5.2."""

    rig_wheel_speed: float = positive("rad/s")
    """Threshold 1, of R1: fault-free runs of the rig, Eq. 5.3."""
    rig_force: float = positive("N")
    """Threshold 2, of R2: fault-free runs and slip on the rig, Eq. 5.8."""
    wheel_speed: float = positive("rad/s")
    """Threshold 3, of r3 … r6: fault-free runs of the robot, Eq. 5.13."""
    force: float = positive("N")
    """Threshold 4, of R7 and R8: fault-free runs and slip of the robot, Eq. 5.21."""


PRINTED = Thresholds(2.07, 1.32, 3.9, 3.5)
"""Of the author's machines."""


def thresholds_file() -> Path:
    """The shipped thresholds from runs of the twin."""
    return models_folder() / "published_thresholds.toml"


def chosen_thresholds(choice: Choice, path: Path | None = None) -> Thresholds:
    """The thresholds of a choice.

    Args:
      choice: The printed ones need no file; those from runs belong to the variant.
      path: Of another file than the shipped one.

    Raises:
      InputError: The file lacks the variant, or a value breaks its rule.
    """
    if choice.thresholds == "printed":
        return PRINTED
    path = thresholds_file() if path is None else path
    tree = read_toml(path)
    if choice.variant not in tree:
        raise InputError(path, f"[{choice.variant}] is missing")
    return read_table(Thresholds, tree[choice.variant], lambda _: path, {}, choice.variant)
