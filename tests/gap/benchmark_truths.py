"""Truths of a benchmark for tests."""

from __future__ import annotations

from collections.abc import Mapping

from omnimj.gap.benchmark_cases import Case, Hidden, draw_cases
from omnimj.gap.benchmark_outside import Outside

CASES = draw_cases(3)
BASE = CASES[0].base
VISCOUS = Hidden("rail_viscous", {"coefficient": 3.0}, "obvious")
LATE = Hidden("sensor_delay", {"delay": 0.014, "channel": "wheel_speed"}, "clear")


def hiding(*hidden: Hidden, outside: Outside | None = None, base: Mapping[str, float] = BASE) -> Case:
    kind = ("null", "single", "pair", "triple")[len(hidden)] if outside is None else "outside"
    return Case("case_000", kind, hidden, outside, base, 11)
