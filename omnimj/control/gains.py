"""Gains of cascade, recovery and observer as one set, and the TOML file that keeps one.

```
[control]
speed_proportional = { value = 0.31, unit = "A.s/rad", source = "tuned" }
[recovery]
place_proportional = { value = 2.7, unit = "1/s", source = "tuned" }
[tuned]  # where it comes from; not read
```
What a file leaves out stays as it is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from omnimj.control.recovery.gains import RecoveryGains
from omnimj.control.robust.gains import ObserverGains
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Control
from omnimj.parameters.reading import Rule, read_quantity
from omnimj.parameters.toml_file import read_toml

CASCADE = ("speed_proportional", "speed_integral", "yaw_rate_proportional", "heading_proportional")
"""The gains among the numbers of `Control`; its limits are none."""
TUNED = "tuned"
"""Table of a gains file that says where it comes from."""


def _fields() -> dict[str, dataclasses.Field]:
    kinds = {"control": Control, "recovery": RecoveryGains, "observer": ObserverGains}
    return {
        f"{table}.{one.name}": one
        for table, kind in kinds.items()
        for one in dataclasses.fields(kind)
        if table != "control" or one.name in CASCADE
    }


_FIELDS: Mapping[str, dataclasses.Field] = MappingProxyType(_fields())
NAMES = tuple(_FIELDS)
"""Every gain as `table.name`: `control.speed_proportional`, `recovery.slip_cap`, …"""
TABLES = tuple(dict.fromkeys(name.partition(".")[0] for name in NAMES))
"""`control`, `recovery`, `observer`."""


def unit_of(name: str) -> str:
    """Unit of a gain."""
    return _FIELDS[name].metadata["unit"]


def rule_of(name: str) -> Rule:
    """Bounds of a gain."""
    return _FIELDS[name].metadata["rule"]


@dataclass(frozen=True)
class Gains:
    """Everything that feeds back."""

    control: Control
    """Of the cascade; its limits are not gains."""
    recovery: RecoveryGains = field(default_factory=RecoveryGains)
    observer: ObserverGains = field(default_factory=ObserverGains)

    def value(self, name: str) -> float:
        """The gain of that name, one of `NAMES`."""
        table, _, key = name.partition(".")
        return float(getattr(getattr(self, table), key))

    def changed(self, values: Mapping[str, float]) -> Gains:
        """The same with other values of some gains, by their names."""
        tables = {
            table: dataclasses.replace(
                getattr(self, table),
                **{name.partition(".")[2]: v for name, v in values.items() if name.startswith(f"{table}.")},
            )
            for table in TABLES
        }
        return Gains(**tables)


def read_gains(path: Path, control: Control) -> Gains:
    """Reads a gains file.

    Args:
      path: The file.
      control: The cascade's numbers as the robot has them; the file's take their place.

    Raises:
      InputError: The file cannot be read, or a gain breaks its rule.
      UnknownNameError: A table or gain that does not exist; the message lists the known ones.
    """
    tree = read_toml(path)
    for table in tree:
        if table not in (*TABLES, TUNED):
            raise UnknownNameError(path, "table", table, (*TABLES, TUNED))
    values = {}
    for table in TABLES:
        entries = tree.get(table, {})
        if not isinstance(entries, Mapping):
            raise InputError(path, f"[{table}] is not a table")
        for key, entry in entries.items():
            name = f"{table}.{key}"
            if name not in _FIELDS:
                known = [n.partition(".")[2] for n in NAMES if n.startswith(f"{table}.")]
                raise UnknownNameError(f"{path}: [{table}]", "gain", key, known)
            values[name], _ = read_quantity(f"{path}: {name}", entry, _FIELDS[name])
    if not values:
        raise InputError(path, "has no gains", "omnimj tune writes such a file", NAMES)
    return Gains(control).changed(values)
