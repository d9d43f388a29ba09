"""Results of one scenario driven with several methods, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omnimj.simulate.metrics import DIAGNOSIS_UNITS
from omnimj.view import wording

_FIRST = ("max_yaw_excursion", "path_error_max", "path_error_rms", "tracking_error_max")


@dataclass(frozen=True)
class Comparison:
    """Table of results: a row per result, a column per method."""

    methods: tuple[str, ...]
    """Methods, that of the main run first."""
    rows: tuple[tuple[str, ...], ...]
    """Rows: name of a result, then its value with each method."""


def runs_by_method(metrics: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the metrics of a run and its comparison runs by method; empty without comparison runs."""
    others = metrics.get("compared") or {}
    return {str(metrics["method"]): metrics, **others} if others else {}


def compare(units: Mapping[str, str], metrics: Mapping[str, Any]) -> Comparison:
    """Compare the results of the methods.

    Args:
      units: Units of the scenario's metrics.
      metrics: Content of `metrics.json`, with `compared`.
    """
    runs = runs_by_method(metrics)
    own = list(runs.values())
    rows = [("checks passed", *map(_checks, own))]
    if any(run.get("interrupted") for run in own):
        rows.append(("ended early", *(_ended(run) for run in own)))
    rows += [
        ("first alarm after onset", *(_if_diagnosed(run, _delay) for run in own)),
        ("every fault isolated", *(_if_diagnosed(run, _isolated) for run in own)),
        ("false alarms", *(_if_diagnosed(run, _false_alarms) for run in own)),
    ]
    judged = [check["name"] for check in metrics.get("checks") or ()]
    for name in dict.fromkeys((*_FIRST, *judged)):
        if name not in DIAGNOSIS_UNITS and any(run.get(name) is not None for run in own):
            texts = (wording.measure(_rounded(run.get(name)), units.get(name, "")) for run in own)
            rows.append((name.replace("_", " "), *texts))
    return Comparison(tuple(runs), tuple(rows))


def _rounded(value: Any) -> Any:
    return float(f"{value:.3g}") if isinstance(value, float) else value


def _checks(run: Mapping[str, Any]) -> str:
    checks: Sequence[Mapping[str, Any]] = run.get("checks") or ()
    return f"{sum(bool(check['ok']) for check in checks)} of {len(checks)}" if checks else "–"


def _ended(run: Mapping[str, Any]) -> str:
    return f"at {wording.number(run.get('duration'))} s" if run.get("interrupted") else "no"


def _if_diagnosed(run: Mapping[str, Any], format_result: Any) -> str:
    return format_result(run) if wording.is_diagnosed(run) else "–"


def _delay(run: Mapping[str, Any]) -> str:
    delay = run.get("detection_delay")
    if delay is None:
        return "no alarm" if run.get("faults") else "–"
    return f"{wording.number(delay, 3)} s"


def _isolated(run: Mapping[str, Any]) -> str:
    isolated = run.get("isolated")
    return "–" if isolated is None else "yes" if isolated else "no"


def _false_alarms(run: Mapping[str, Any]) -> str:
    return str(run.get("false_alarms", "–"))
