"""Which form of a method: equations and thresholds of the published one, what the robust one may do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from omnimj.errors import InputError, UnknownNameError

VARIANTS = ("repaired", "printed")
THRESHOLD_SETS = ("fault_free", "printed")


@dataclass(frozen=True, slots=True)
class Choice:
    """The form of a method."""

    variant: str = VARIANTS[0]
    """`repaired`, or `printed`: with the signs as in the text."""
    thresholds: str = THRESHOLD_SETS[0]
    """`fault_free`, from runs of the twin, or `printed`: those of the author's machines."""

    recovery: bool = True
    """Whether anything is done about a fault: the weights of chapter 6, or `control.recovery`. Without it the
    method only watches, as in the tests of chapter 5."""
    self_test: bool = False
    """Robust: wheels are driven against each other before the plan begins, which waits for it."""
    dither: bool = True
    """Robust: the same, less, while a slow robot tells nothing about its motors."""

    @property
    def printed(self) -> bool:
        """Whether the equations are as printed."""
        return self.variant == "printed"


FLAGS = ("recovery", "self_test", "dither")
"""Keys that are true or false."""


def checked_choice(variant: object, thresholds: object, flags: Mapping[str, object], place: str) -> Choice:
    """A choice as a file has it.

    Args:
      variant: Of `VARIANTS`.
      thresholds: Of `THRESHOLD_SETS`.
      flags: Some of `FLAGS`.
      place: Where they stand, for messages.

    Raises:
      UnknownNameError: No such variant or set of thresholds.
      InputError: A flag is neither true nor false.
    """
    if variant not in VARIANTS:
        raise UnknownNameError(f"{place}.variant", "variant", variant, VARIANTS)
    if thresholds not in THRESHOLD_SETS:
        raise UnknownNameError(f"{place}.thresholds", "set of thresholds", thresholds, THRESHOLD_SETS)
    for name, value in flags.items():
        if not isinstance(value, bool):
            raise InputError(f"{place}.{name}", f"found {value!r}", "must be true or false")
    return Choice(str(variant), str(thresholds), **{name: bool(value) for name, value in flags.items()})
