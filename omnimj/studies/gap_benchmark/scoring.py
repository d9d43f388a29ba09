"""Scores of single cases: hidden effects compared with the reported ones."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omnimj.effects import EffectParameter, effects_of
from omnimj.effects.mjcf import NO_LIMIT
from omnimj.studies.gap_benchmark.cases import SIZES, Case
from omnimj.studies.gap_benchmark.plants import benchmark_plant
from omnimj.studies.gap_benchmark.unmodelled import KINDS

VISIBLE = 1.2
"""Mismatch without an effect, in units of what the true model leaves (at least the noise), from which it
counts as visible."""


@dataclass(frozen=True)
class ParameterScore:
    """Score of one fitted parameter of a correctly named effect."""

    name: str
    true: float
    """True value relative to the nominal model, whose own parameters have errors."""
    planted: float
    """Hidden value."""
    value: float
    low: float | None
    high: float | None
    error: float | None
    """|value − true| over the hidden amplitude; None for a shape and for an amplitude that was not hidden."""
    inside: bool | None
    """True if the true value lies in the stated 90 % interval; None without one."""


@dataclass(frozen=True)
class MethodScore:
    """Score of one method on one case."""

    named: tuple[str, ...]
    """Labels of the named effects, in order."""
    covered: tuple[bool, ...]
    """Per hidden effect: True if a reported set contains it."""
    first: tuple[bool, ...]
    """Per hidden effect: True if it is among the first names, as many as effects are hidden."""
    set_sizes: tuple[int, ...]
    """Per reported effect: size of its ambiguity set; for a baseline the number of its names."""
    wrong: int
    """Number of reported sets without a hidden effect; for a baseline that of wrong names."""
    exclusive_wrong: int
    """Number of wrong names that are reported without an alternative."""
    ratio: float | None
    """Held-out mismatch over that of the true model; None without a true model, or if the workflow names no
    effect."""


@dataclass(frozen=True)
class CaseScore:
    """Score of one case."""

    name: str
    kind: str
    hidden: tuple[str, ...]
    """Labels of the hidden effects; for an effect outside the library its kind."""
    sizes: tuple[str, ...]
    structure: str
    """Deviation of the machine from the equations of the library; empty: none."""
    visibility: float
    """RMS mismatch of the refitted base in units of what the true model leaves, at least the noise."""
    visibilities: tuple[float, ...]
    """Per hidden effect: the same of the true model without it."""
    verdict: str
    seconds: float
    workflow: MethodScore
    parameters: tuple[ParameterScore, ...]
    baselines: Mapping[str, MethodScore]

    @property
    def shows_gap(self) -> bool:
        """True if the refitted base does not explain the data."""
        return self.visibility >= VISIBLE

    @property
    def visible(self) -> tuple[bool, ...]:
        """Per hidden effect: True if the data show it, the others being known."""
        return tuple(value >= VISIBLE for value in self.visibilities)


def score_case(case: Case, result: Mapping[str, Any], truth: Mapping[str, Any] | None) -> CaseScore:
    """Score one case by the results of `trial.search_case` and, with hidden effects, `trial.fit_truth`."""
    gap = result["gap"]
    labels = tuple(one.label for one in case.hidden)
    reported = [(_label(e), tuple(e["indistinguishable_from"])) for e in gap["effects"]]
    noise = gap["noise"]
    best = None if not truth or "heldout" not in truth else rms_over_noise(truth["heldout"], noise)
    after = (
        rms_over_noise({c: g["after"] for c, g in gap["gap"]["heldout"].items()}, noise) if reported else None
    )
    baselines = {}
    for name, picked in result["baselines"].items():
        baselines[name] = _of_baseline(
            labels, picked["names"], _ratio(rms_over_noise(picked["heldout"], noise), best)
        )
    return CaseScore(
        case.name,
        case.kind,
        labels or ((case.outside.kind,) if case.outside else ()),
        tuple(one.size for one in case.hidden) or _size_of_outside(case),
        case.structure.kind if case.structure else "",
        visibility(gap) / max(1.0, best or 1.0),
        _visibilities(labels, gap, truth or {}, max(1.0, best or 1.0)),
        gap["verdict"],
        float(result["seconds"]),
        _method(labels, reported, _ratio(after, best)),
        tuple(_parameters(case, gap["effects"])),
        baselines,
    )


def rms_over_noise(by_channel: Mapping[str, float | None], noise: Mapping[str, float]) -> float:
    """Return the RMS over channels in units of noise: √(mean (rms/noise)²)."""
    squares = [(value / noise[c]) ** 2 for c, value in by_channel.items() if value is not None]
    return math.sqrt(sum(squares) / len(squares)) if squares else math.nan


def visibility(gap: Mapping[str, Any]) -> float:
    """Return the RMS mismatch of the refitted base in units of noise; all runs have equal weight."""
    runs = gap.get("runs") or []
    if runs:
        return math.sqrt(sum(run["total_before"] ** 2 for run in runs) / len(runs))
    return rms_over_noise({c: g["before"] for c, g in gap["gap"]["heldout"].items()}, gap["noise"])


def _visibilities(
    labels: Sequence[str], gap: Mapping[str, Any], truth: Mapping[str, Any], best: float
) -> tuple[float, ...]:
    without = truth.get("without") or {}
    if set(without) != set(labels):
        return (visibility(gap) / best,) * len(labels)
    return tuple(rms_over_noise(without[label], gap["noise"]) / best for label in labels)


def _label(effect: Mapping[str, Any]) -> str:
    chosen = [str(v) for v in effect.get("selectors", {}).values()]
    return f"{effect['effect']} ({', '.join(chosen)})" if chosen else effect["effect"]


def _ratio(value: float | None, best: float | None) -> float | None:
    return None if value is None or not best else value / best


def _method(
    labels: Sequence[str], reported: Sequence[tuple[str, tuple[str, ...]]], ratio: float | None
) -> MethodScore:
    sets = [(label, *rivals) for label, rivals in reported]
    return MethodScore(
        tuple(label for label, _ in reported),
        tuple(any(_has(names, label) for names in sets) for label in labels),
        tuple(any(_has(names[:1], label) for names in sets[: len(labels)]) for label in labels),
        tuple(len(names) for names in sets),
        sum(not any(_has(names, label) for label in labels) for names in sets),
        sum(len(names) == 1 and not any(_has(names, label) for label in labels) for names in sets),
        ratio if reported else None,
    )


def _of_baseline(labels: Sequence[str], names: Sequence[str], ratio: float | None) -> MethodScore:
    """Score a baseline, whose only set is all its names; as many as effects are hidden count as first."""
    return MethodScore(
        tuple(names),
        tuple(_has(names, label) for label in labels),
        tuple(_has(names[: len(labels)], label) for label in labels),
        (len(names),) if names else (),
        sum(name not in labels for name in names),
        sum(name not in labels for name in names) if len(names) == 1 else 0,
        ratio,
    )


def _has(names: Iterable[str], label: str) -> bool:
    """Return whether a set contains an effect; a name without a selector matches every selector."""
    return any(name in (label, label.partition(" (")[0]) for name in names)


def _size_of_outside(case: Case) -> tuple[str, ...]:
    if case.outside is None:
        return ()
    share = abs(case.outside.amplitude) / KINDS[case.outside.kind].amplitude
    return (min(SIZES, key=lambda name: abs(SIZES[name] - share)),)


def _parameters(case: Case, effects: Sequence[Mapping[str, Any]]) -> Iterable[ParameterScore]:
    """Yield the parameter scores of every hidden effect that is named."""
    plant = benchmark_plant(case.plant)
    for one in case.hidden:
        found = next((e for e in effects if _label(e) == one.label), None)
        if found is None:
            continue
        true = plant.true_values(one, case)
        for p in effects_of(plant.library)[one.effect].parameters:
            fitted, planted = found["parameters"][p.name], float(one.values[p.name])
            low, high = fitted["low"], fitted["high"]
            inside = None if low is None or high is None else bool(low <= true[p.name] <= high)
            size = 0.0 if p.null_value is None else _amplitude(planted, p)
            error = abs(fitted["value"] - true[p.name]) / size if size else None
            yield ParameterScore(p.name, true[p.name], planted, fitted["value"], low, high, error, inside)


def _amplitude(planted: float, parameter: EffectParameter) -> float:
    """Return the hidden size of an amplitude; that of a limit is its own value."""
    null = parameter.null_value or 0.0
    return abs(planted) if null >= NO_LIMIT else abs(planted - null)
