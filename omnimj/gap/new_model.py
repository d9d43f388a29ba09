"""The new model file: the old text with named effects and refitted values. And the refitted floors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import omnimj
from omnimj.effects.model_file import Estimate, model_text
from omnimj.gap.records import Finding, NamedEffect, Refitted
from omnimj.gap.uncertain import FLOOR_LETTERS, scaled
from omnimj.parameters import Axis, Floor, Rig, Robot, read_axis, read_rig, read_robot
from omnimj.parameters.floor_text import UNITS, floor_text

_READERS: Mapping[str, Callable[[Path | None], Rig | Robot | Axis]] = {
    "quarter_rig": read_rig,
    "uto_robot": read_robot,
    "linear_axis": read_axis,
}
_UNCHANGED = 1e-9  # of the box


def new_model_text(finding: Finding, file: Path | None = None) -> str | None:
    """The text of the model file with what was found in it.

    What belongs to no quantity of the model file stays out: the numbers of a floor (see `new_floors_text`),
    the lag of a channel, the scale of the masses that the runs tell.

    Args:
      finding: What was found.
      file: The model file that the search began with; the shipped one when None.

    Returns:
      None where no effect was named.

    Raises:
      InputError: The file's text cannot be changed.
    """
    if not finding.effects:
        return None
    machine = _READERS[finding.plant](file)
    return model_text(machine.file, written(finding.effects, machine.effects), _changed(finding, machine))


def new_floors_text(finding: Finding, floors: Mapping[str, Floor]) -> str | None:
    """The text of a floors file with the floors that were refitted; None where nothing was named or changed.

    Args:
      finding: What was found.
      floors: Those that the search began with, by name.
    """
    scales: dict[str, dict[str, float]] = {}
    for parameter in finding.refitted if finding.effects else ():
        name, _, letter = parameter.name.rpartition(".")
        if name in floors and letter in FLOOR_LETTERS and _is_changed(parameter):
            scales.setdefault(name, {})[letter] = parameter.fitted
    if not scales:
        return None
    source = f"identified: refitted to {finding.dataset}"
    new = [replace(scaled(floors[name], own), source=source) for name, own in scales.items()]
    return "\n".join([f"# Floors refitted by omnimj {omnimj.__version__}.\n{UNITS}\n", *map(floor_text, new)])


def written(
    effects: Iterable[NamedEffect], present: Iterable[str] = ()
) -> dict[str, dict[str, float | int | str | Estimate]]:
    """Effects by the names of their tables: a second instance is called `sensor_delay_2`.

    Args:
      effects: Named ones.
      present: Tables that the file has already; what was found comes on top of them.
    """
    tables: dict[str, dict[str, float | int | str | Estimate]] = {}
    taken = set(present)
    for effect in effects:
        name, k = effect.effect, 2
        while name in taken:
            name, k = f"{effect.effect}_{k}", k + 1
        taken.add(name)
        values = {key: Estimate(v.value, v.low, v.high) for key, v in effect.parameters.items()}
        tables[name] = {**effect.selectors, **values}
    return tables


def _changed(finding: Finding, machine: Rig | Robot | Axis) -> dict[str, float]:
    """Refitted quantities under the names `table.key` of the model file."""
    changed = {}
    for parameter in finding.refitted:
        name = _quantity(parameter, machine)
        if name is not None and _is_changed(parameter):
            changed[name] = parameter.fitted
    return changed


def _is_changed(parameter: Refitted) -> bool:
    return abs(parameter.fitted - parameter.nominal) > _UNCHANGED * (parameter.high - parameter.low)


def _quantity(parameter: Refitted, machine: Rig | Robot | Axis) -> str | None:
    """`coulomb` of an axis is `axis.coulomb` in its file; None where the file has no such single number."""
    for name in (parameter.name, f"axis.{parameter.name}"):
        table, _, key = name.partition(".")
        if name in machine.provenance and table != "effects":
            value: Any = getattr(getattr(machine, table, None), key, None)
            return name if isinstance(value, float) else None
    return None
