"""Gains of cascade, recovery and observer as one set, and the TOML file that keeps one.

```
[control]
speed_proportional = { value = 0.31, unit = "A.s/rad", source = "tuned" }
[recovery]
place_proportional = { value = 2.7, unit = "1/s", source = "tuned" }
[tuned]  # provenance; not read
```
A gain that a file leaves out keeps its value.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Control
from omnimj.parameters.reading import Rule, positive, read_quantity, read_toml

CASCADE_GAINS = ("speed_proportional", "speed_integral", "yaw_rate_proportional", "heading_proportional")
"""The gains among the fields of `Control`; the others are limits."""
PROVENANCE_TABLE = "tuned"
"""Table of a gains file that records the provenance."""


@dataclass(frozen=True)
class RecoveryGains:
    """Gains of recovery; `omnimj tune` changes them together with those of cascade and observer."""

    place_proportional: float = positive("1/s", 100.0, default=3.0)
    """Proportional gain on the position error."""
    place_speed: float = positive("m/s", 2.0, default=0.2)
    """Largest speed of the position correction."""
    slip_cap: float = positive("m/s", 5.0, default=0.2)
    """Largest slip velocity of a slipping wheel. Its wheel speed fits those of the others and does not run
    away. A tighter bound gives away traction on floors whose force rises with slip: with 0.05 the heading
    error is a fifth larger than with 0.2, and the path error 6 % larger."""
    grip_share: float = positive("1", 1.0, default=0.5)
    """Share of the grip that the plan may use on a floor that gives way under all wheels; the rest holds the
    robot on its path."""


@dataclass(frozen=True)
class ObserverGains:
    """Gains of the observer: standard deviations of its filters' noise, and their memory.

    The thresholds of the decisions (`thresholds.Thresholds`) are calibrated against false alarms, not tuned.
    """

    wheel_noise: float = positive("m/s", 1.0, default=0.004)
    """Noise of the velocity measured by a rolling wheel."""
    creep_noise: float = positive("1", 10.0, default=0.35)
    """The same per m/s of the wheel's creep."""
    acceleration_noise: float = positive("m/s2", 10.0, default=0.04)
    """Noise of the accelerometer's mean over a block, and gravity while the body pitches on its springs."""
    memory: float = positive("s", 1e5, default=120.0)
    """Time in which a parameter of the healthy robot may wander by its own prior deviation."""


def _fields() -> dict[str, dataclasses.Field]:
    kinds = {"control": Control, "recovery": RecoveryGains, "observer": ObserverGains}
    return {
        f"{table}.{one.name}": one
        for table, kind in kinds.items()
        for one in dataclasses.fields(kind)
        if table != "control" or one.name in CASCADE_GAINS
    }


_FIELDS: Mapping[str, dataclasses.Field] = MappingProxyType(_fields())
GAIN_NAMES = tuple(_FIELDS)
"""Every gain as `table.name`: `control.speed_proportional`, `recovery.slip_cap`, …"""
GAIN_TABLES = tuple(dict.fromkeys(name.partition(".")[0] for name in GAIN_NAMES))
"""`control`, `recovery`, `observer`."""


def unit_of(name: str) -> str:
    """Unit of a gain."""
    return _FIELDS[name].metadata["unit"]


def rule_of(name: str) -> Rule:
    """Bounds of a gain."""
    return _FIELDS[name].metadata["rule"]


@dataclass(frozen=True)
class Gains:
    """Gains of cascade, recovery and observer."""

    control: Control
    """Gains of the cascade, and its limits."""
    recovery: RecoveryGains = field(default_factory=RecoveryGains)
    observer: ObserverGains = field(default_factory=ObserverGains)

    def value(self, name: str) -> float:
        """Value of the gain with a name of `GAIN_NAMES`."""
        table, _, key = name.partition(".")
        return float(getattr(getattr(self, table), key))

    def changed(self, values: Mapping[str, float]) -> Gains:
        """Copy with other values of some gains.

        Args:
          values: New values by names of `GAIN_NAMES`.
        """
        tables = {
            table: dataclasses.replace(
                getattr(self, table),
                **{name.partition(".")[2]: v for name, v in values.items() if name.startswith(f"{table}.")},
            )
            for table in GAIN_TABLES
        }
        return Gains(**tables)


def read_gains(path: Path, control: Control) -> Gains:
    """Read a gains file.

    Args:
      path: The file.
      control: Gains and limits of the robot; the gains in the file replace its own.

    Raises:
      InputError: The file cannot be read, or a gain breaks its rule.
      UnknownNameError: A table or gain that does not exist; the message lists the known ones.
    """
    tree = read_toml(path)
    for table in tree:
        if table not in (*GAIN_TABLES, PROVENANCE_TABLE):
            raise UnknownNameError(path, "table", table, (*GAIN_TABLES, PROVENANCE_TABLE))
    values = {}
    for table in GAIN_TABLES:
        entries = tree.get(table, {})
        if not isinstance(entries, Mapping):
            raise InputError(path, f"[{table}] is not a table")
        for key, entry in entries.items():
            name = f"{table}.{key}"
            if name not in _FIELDS:
                known = [n.partition(".")[2] for n in GAIN_NAMES if n.startswith(f"{table}.")]
                raise UnknownNameError(f"{path}: [{table}]", "gain", key, known)
            values[name], _ = read_quantity(f"{path}: {name}", entry, _FIELDS[name])
    if not values:
        raise InputError(path, "has no gains", "omnimj tune writes such a file", GAIN_NAMES)
    return Gains(control).changed(values)
