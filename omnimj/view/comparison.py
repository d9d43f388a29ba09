"""Results of several runs side by side: one scenario with several methods, or any runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omnimj.simulate.metrics import DIAGNOSIS_UNITS, metric_units
from omnimj.view import wording

_FIRST = ("max_yaw_excursion", "path_error_max", "path_error_rms", "tracking_error_max")


_SETUP = ("scenario", "plant", "robot", "method", "floor", "seed")
_UNITS = {
    **metric_units("quarter_rig", 1, has_path=False, kinematic=False),
    **metric_units("uto_robot", 8, has_path=True, kinematic=False),
}


@dataclass(frozen=True)
class Comparison:
    """Tables of results: a row per result, a column per run."""

    names: tuple[str, ...]
    """Names of the runs, such as the methods, the main run first."""
    rows: tuple[tuple[str, ...], ...]
    """Rows: name of a result, then its value in each run."""
    setup: tuple[tuple[str, ...], ...] = ()
    """Rows: what was driven, then its value in each run."""
    checks: tuple[tuple[str, ...], ...] = ()
    """Rows: name of a check, then value, verdict and limit in each run."""

    @property
    def differing(self) -> tuple[str, ...]:
        """Names of the rows of `setup` that are not the same in all runs."""
        return tuple(name for name, *texts in self.setup if len(set(texts)) > 1)


def runs_by_method(metrics: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the metrics of a run and its comparison runs by method; empty without comparison runs."""
    others = metrics.get("compared") or {}
    return {str(metrics["method"]): metrics, **others} if others else {}


def compare(units: Mapping[str, str], metrics: Mapping[str, Any]) -> Comparison:
    """Compare the results of the methods."""
    runs = runs_by_method(metrics)
    judged = [check["name"] for check in metrics.get("checks") or ()]
    return Comparison(tuple(runs), _results(units, list(runs.values()), dict.fromkeys((*_FIRST, *judged))))


def compare_runs(runs: Mapping[str, Mapping[str, Any]]) -> Comparison:
    """Compare any runs: setup, checks, and all results that at least one of them has."""
    own = list(runs.values())
    setup = [(name, *(str(run.get(name, "–")).replace("_", " ") for run in own)) for name in _SETUP]
    setup.append(("duration", *(wording.measure(run.get("duration"), "s") for run in own)))
    changed = [", ".join(map(str, run.get("overrides") or ())) or "–" for run in own]
    setup += [("changed values", *changed), ("faults", *(_faults(run) for run in own))]
    judged = dict.fromkeys(check["name"] for run in own for check in run.get("checks") or ())
    checks = [(name.replace("_", " "), *(_check(run, name) for run in own)) for name in judged]
    results = [name for name in dict.fromkeys((*_FIRST, *_UNITS)) if name not in judged]
    return Comparison(tuple(runs), _results(_UNITS, own, results), tuple(setup), tuple(checks))


def _results(
    units: Mapping[str, str], own: Sequence[Mapping[str, Any]], names: Iterable[str]
) -> tuple[tuple[str, ...], ...]:
    """Tabulate verdict, diagnosis and the named metrics, a column per run."""
    rows = [("checks passed", *map(checks_passed, own))]
    if any(run.get("interrupted") for run in own):
        rows.append(("ended early", *(_ended(run) for run in own)))
    if any(wording.is_diagnosed(run) for run in own):
        rows += [
            ("first alarm after onset", *(_if_diagnosed(run, first_alarm) for run in own)),
            ("every fault isolated", *(_if_diagnosed(run, _isolated) for run in own)),
            ("false alarms", *(_if_diagnosed(run, _false_alarms) for run in own)),
        ]
    for name in names:
        if name not in DIAGNOSIS_UNITS and any(run.get(name) is not None for run in own):
            texts = (wording.measure(_rounded(run.get(name)), units.get(name, "")) for run in own)
            rows.append((name.replace("_", " "), *texts))
    return tuple(rows)


def _check(run: Mapping[str, Any], name: str) -> str:
    """Format value, verdict and limit of a check; a dash for a run without it."""
    for check in run.get("checks") or ():
        if check["name"] == name:
            unit, limit = _UNITS.get(name, ""), check.get("limit")
            sign = "✓" if check["ok"] else "✗" if check.get("judged", True) else "not judged"
            bound = "≥" if check.get("bound") == "min" else "≤"
            words = f"{sign} {wording.measure(_rounded(check.get('value')), unit)}"
            return words if limit is None else f"{words}, {bound} {wording.number(limit)}"
    return "–"


def _faults(run: Mapping[str, Any]) -> str:
    names = [wording.fault_name(fault) for fault in run.get("faults") or () if "kind" in fault]
    return "; ".join(names) or "none"


def _rounded(value: Any) -> Any:
    return float(f"{value:.3g}") if isinstance(value, float) else value


def checks_passed(run: Mapping[str, Any]) -> str:
    """Count the checks that hold: `5 of 6`; a dash for a run without checks."""
    checks: Sequence[Mapping[str, Any]] = run.get("checks") or ()
    return f"{sum(bool(check['ok']) for check in checks)} of {len(checks)}" if checks else "–"


def _ended(run: Mapping[str, Any]) -> str:
    return f"at {wording.number(run.get('duration'))} s" if run.get("interrupted") else "no"


def _if_diagnosed(run: Mapping[str, Any], format_result: Any) -> str:
    return format_result(run) if wording.is_diagnosed(run) else "–"


def first_alarm(run: Mapping[str, Any]) -> str:
    """Format the delay from the onset of the first fault to an alarm."""
    delay = run.get("detection_delay")
    if delay is None:
        return "no alarm" if run.get("faults") else "–"
    return f"{wording.number(delay, 3)} s"


def _isolated(run: Mapping[str, Any]) -> str:
    isolated = run.get("isolated")
    return "–" if isolated is None else "yes" if isolated else "no"


def _false_alarms(run: Mapping[str, Any]) -> str:
    return str(run.get("false_alarms", "–"))
