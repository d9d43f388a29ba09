"""Truths of a benchmark for tests."""

from __future__ import annotations

from collections.abc import Mapping

from omnimj.studies.gap_benchmark.cases import Case, HiddenEffect, draw_cases
from omnimj.studies.gap_benchmark.unmodelled import UnmodelledEffect

CASES = draw_cases(3)
BASE = CASES[0].base
VISCOUS = HiddenEffect("rail_viscous", {"coefficient": 3.0}, "obvious")
LATE = HiddenEffect("sensor_delay", {"delay": 0.014, "channel": "wheel_speed"}, "clear")


def hiding(
    *hidden: HiddenEffect,
    outside: UnmodelledEffect | None = None,
    structure: UnmodelledEffect | None = None,
    base: Mapping[str, float] = BASE,
) -> Case:
    kind = ("null", "single", "pair", "triple")[len(hidden)] if outside is None else "outside"
    return Case("case_000", kind, hidden, outside, structure, base, 11)
