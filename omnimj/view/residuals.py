"""Residual columns grouped by quantity, with thresholds, units and explanations."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from omnimj.view import palette

_PREFIX = "residual_"
_PLACE = re.compile(r"(.+)_(\d+|x|y)$")
_AXES: Mapping[str, str] = {"x": palette.MEASURED, "y": palette.ACCENT}


@dataclass(frozen=True)
class Residual:
    """Column of a residual with its threshold."""

    column: str
    threshold: str | None
    """Column of the threshold; None for a residual that is not tested against one."""
    label: str
    color: str
    wheel: int | None
    """Index of the wheel, 0 … n−1; None for a residual of the whole robot."""


@dataclass(frozen=True)
class Family:
    """Residuals of one quantity, shown in one plot."""

    heading: str
    quantity: str
    """Axis label without the unit."""
    unit: str = ""
    """Unit; empty for an unknown quantity."""
    words: str = ""
    """Explanation for the caption."""
    is_signed: bool = False
    """True if the threshold applies to both signs."""
    name: str = ""
    """Name of the family, such as `motor`, `slip` or `wheel_speed`."""
    residuals: tuple[Residual, ...] = ()

    @property
    def label(self) -> str:
        """Axis label: quantity and unit."""
        return f"{self.quantity} [{self.unit}]" if self.unit else self.quantity

    @property
    def thresholds(self) -> tuple[str, ...]:
        """Columns of the thresholds."""
        return tuple(r.threshold for r in self.residuals if r.threshold is not None)


_BALANCE = (
    "Motor forces less inertial forces from accelerometer and gyro. "
    "Model errors remain in it: payload, friction, holding forces at rest."
)
_ROBUST: Mapping[str, Family] = {
    "force": Family("Balance of forces", "unexplained force", "N", _BALANCE, True),
    "moment": Family("Balance of moments", "unexplained moment", "N·m", _BALANCE, True),
    "motor": Family(
        "Evidence for a weak motor",
        "log likelihood ratio",
        "nat",
        "Likelihood of a weak motor of this wheel, given the balance, against a healthy robot.",
    ),
    "slip": Family(
        "Evidence for slip",
        "slip distance",
        "m",
        "Travel of the rim less travel of the wheel over the floor, counted up to 2 mm.",
    ),
}
_PUBLISHED: Mapping[str, Family] = {
    "wheel_speed": Family(
        "Wheel speeds against the model",
        "measured − model",
        "rad/s",
        "The model is driven by the measured currents, open loop (r3 to r6).",
        True,
    ),
    "force": Family(
        "Two ways to compute the force",
        "RMS difference",
        "N",
        "From the motor currents and from the acceleration; RMS since the start (R7 and R8).",
    ),
}
_PUBLISHED_RIG: Mapping[str, Family] = {
    "wheel_speed": Family(
        "Wheel speed against the model",
        "RMS difference",
        "rad/s",
        "The model is driven by the measured current, open loop; RMS since the start (R1).",
    ),
    "force": Family(
        "Two ways to compute the force",
        "RMS difference",
        "N",
        "From the motor current and from the acceleration; RMS since the start (R2).",
    ),
}
_MEANINGS: Mapping[str, Mapping[str, Family]] = {"robust": _ROBUST, "published": _PUBLISHED}


def families(columns: Collection[str], method: str, printed: bool = False) -> list[Family]:
    """Group the residual columns of a trace, or of a method's `log_names`, into families, in their order.

    A residual without an explanation in this module is shown under the name of its column. The published
    method `printed` as in its source has positive thresholds only.
    """
    meanings = _MEANINGS.get(method, {})
    if meanings is _PUBLISHED and "residual_wheel_speed" in columns:  # a rig has one wheel, without a number
        meanings = _PUBLISHED_RIG
    found: dict[str, list[Residual]] = {}
    for column in columns:
        if column.startswith(_PREFIX):
            ending = column[len(_PREFIX) :]
            parted = _PLACE.match(ending)
            name, place = (parted[1], parted[2]) if parted else (ending, "")
            threshold = f"threshold_{ending}"
            found.setdefault(name, []).append(
                _residual(column, threshold if threshold in columns else None, place)
            )
    return [_family(meanings.get(name), name, tuple(found[name]), printed) for name in found]


def _family(known: Family | None, name: str, residuals: tuple[Residual, ...], printed: bool) -> Family:
    words = name.replace("_", " ")
    family = Family(f"Residual: {words}", words) if known is None else known
    signed = family.is_signed and not printed
    return dataclasses.replace(family, name=name, residuals=residuals, is_signed=signed)


def _residual(column: str, threshold: str | None, place: str) -> Residual:
    if place.isdigit():
        i = int(place) - 1
        return Residual(column, threshold, f"wheel {place}", palette.wheel_color(i), i)
    if place:
        return Residual(column, threshold, f"along {place}", _AXES[place], None)
    return Residual(column, threshold, "residual", palette.MEASURED, None)
