"""Checks of a scenario: bounds on its metrics, read from `[checks]` and evaluated after the run."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import Rule, check_number, require_keys

BOUNDS = ("min", "max")
METHODS = ("robust", "published", "off")
"""Diagnosis methods; each may have its own checks."""

_ANY = Rule(-math.inf, math.inf, False)


@dataclass(frozen=True)
class Check:
    """One bound on one metric."""

    name: str
    """Name of the metric."""
    bound: str
    """`max`: the metric may not be above the limit; `min`: not below."""
    limit: float
    """Limit in the metric's SI unit."""
    method: str | None = None
    """Method to which the check is limited; any when None."""


@dataclass(frozen=True)
class CheckResult:
    """A check evaluated for a run."""

    check: Check
    value: float | None
    """Value of the metric; None where the run has none."""
    judged: bool = True
    """False if the metric needs the truth and the truth is unknown."""

    @property
    def ok(self) -> bool:
        """True if the bound holds; a metric that is missing, not judged or not finite never passes."""
        if self.value is None or not self.judged or not math.isfinite(self.value):
            return False
        if self.check.bound == "min":
            return self.value >= self.check.limit
        return self.value <= self.check.limit


def _read_bounds(place: str, name: str, entry: Any, method: str | None) -> list[Check]:
    if not isinstance(entry, Mapping):
        return [Check(name, "max", float(check_number(place, entry, _ANY)), method)]
    require_keys(place, entry, BOUNDS)
    if not entry:
        raise InputError(place, "has no bound", "give min, max or both")
    limits = {bound: float(check_number(f"{place}.{bound}", value, _ANY)) for bound, value in entry.items()}
    if limits.get("min", -math.inf) > limits.get("max", math.inf):
        raise InputError(place, f"min {limits['min']:g} is above max {limits['max']:g}", "nothing could pass")
    return [Check(name, bound, limits[bound], method) for bound in BOUNDS if bound in limits]


def read_checks(
    table: Any, place: str, metrics: tuple[str, ...], method: str | None = None
) -> tuple[Check, ...]:
    """Read the `[checks]` table: `metric = limit` (largest value), or `metric = { min = …, max = … }`.

    A table `[checks.robust]` has further checks for that method.

    Args:
      table: The parsed TOML table.
      place: File and table, for messages.
      metrics: Names of the metrics of this scenario.
      method: Method of the table; any when None.

    Raises:
      InputError: A limit that is not a number, or bounds that exclude each other.
      UnknownNameError: A metric that the scenario does not have.
    """
    if not isinstance(table, Mapping):
        raise InputError(place, f"found {table!r}", "a table is needed, e.g. max_yaw_excursion = 0.1")
    checks: list[Check] = []
    for name, entry in table.items():
        if name in METHODS and method is None:
            checks.extend(read_checks(entry, f"{place}.{name}", metrics, name))
            continue
        if name not in metrics:
            raise UnknownNameError(place, "metric", name, metrics)
        checks.extend(_read_bounds(f"{place}.{name}", name, entry, method))
    return tuple(checks)


def evaluate_checks(
    checks: tuple[Check, ...],
    metrics: Mapping[str, float | None],
    method: str = "off",
    unknown: Collection[str] = (),
) -> tuple[CheckResult, ...]:
    """Evaluate the checks of a method for the metrics of a run, in the order of the scenario file.

    Args:
      checks: Checks of the scenario.
      metrics: Metrics of the run by name.
      method: Diagnosis method of the run.
      unknown: Names of metrics that need the unknown truth; they are not judged.
    """
    own = (check for check in checks if check.method in (None, method))
    return tuple(
        CheckResult(check, metrics.get(check.name), judged=check.name not in unknown) for check in own
    )
