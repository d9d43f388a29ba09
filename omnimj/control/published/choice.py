"""Which form of the published method: its equations and its thresholds."""

from __future__ import annotations

from dataclasses import dataclass

from omnimj.errors import InputError, UnknownNameError

VARIANTS = ("repaired", "printed")
THRESHOLD_SETS = ("fault_free", "printed")


@dataclass(frozen=True, slots=True)
class Choice:
    """The form of the method."""

    variant: str = VARIANTS[0]
    """`repaired`, or `printed`: with the signs as in the text."""
    thresholds: str = THRESHOLD_SETS[0]
    """`fault_free`, from runs of the twin, or `printed`: those of the author's machines."""

    recovery: bool = True
    """Whether the weights of chapter 6 reach the cascade; without it the method only watches, as in the tests
    of chapter 5."""

    @property
    def printed(self) -> bool:
        """Whether the equations are as printed."""
        return self.variant == "printed"


def checked_choice(variant: object, thresholds: object, recovery: object, place: str) -> Choice:
    """A choice as a file has it.

    Raises:
      UnknownNameError: No such variant or set of thresholds.
      InputError: `recovery` is neither true nor false.
    """
    if variant not in VARIANTS:
        raise UnknownNameError(f"{place}.variant", "variant", variant, VARIANTS)
    if thresholds not in THRESHOLD_SETS:
        raise UnknownNameError(f"{place}.thresholds", "set of thresholds", thresholds, THRESHOLD_SETS)
    if not isinstance(recovery, bool):
        raise InputError(f"{place}.recovery", f"found {recovery!r}", "must be true or false")
    return Choice(str(variant), str(thresholds), recovery)
