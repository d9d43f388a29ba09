"""What a run comes to, in words for the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.compared import told_comparison
from omnimj.cli.tables import shown, table
from omnimj.cli.wire_arguments import told_link
from omnimj.resources import model_words

if TYPE_CHECKING:
    from omnimj.scenario.running import Run

_RESULTS = ("path_error_max", "tracking_error_max", "max_yaw_excursion", "final_speed", "travel")


def _verdict(checks: Sequence[Mapping[str, Any]]) -> str:
    unjudged = sum(not check.get("judged", True) for check in checks)
    if not checks:
        return "not judged: there is nothing to check"
    failed = sum(not check["ok"] for check in checks) - unjudged
    beside = f"; {unjudged} not judged, since they need a truth that nobody knows" if unjudged else ""
    if failed:
        return f"failed: {failed} of {len(checks)} checks{beside}"
    if unjudged == len(checks) > 0:
        return f"not judged: all {unjudged} checks need a truth that nobody knows"
    return f"passed{beside}"


def _unchecked(metrics: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """What a run without checks comes to all the same."""
    found = [(name, shown(metrics[name], units[name])) for name in _RESULTS if metrics.get(name) is not None]
    return "\n".join(("no checks", *([table(("result", "value"), found)] if found else [])))


def told_run(finished: Run, out: Path | None) -> str:
    """What was driven, the table of checks, what was diagnosed, the verdict."""
    from omnimj.cli.diagnosed import told_diagnoses, told_recovery

    metrics, units = finished.metrics, finished.scenario.metric_units
    scenario = finished.scenario
    set_ = f", with {', '.join(scenario.overrides)}" if scenario.overrides else ""
    lines = [
        f"{metrics['scenario']}: {scenario.description}{set_}",
        f"{model_words(scenario.constants.file)} on {metrics['floor']}, plant {metrics['plant']}, "
        f"method {metrics['method']}, seed {metrics['seed']}, "
        f"{metrics['duration']:g} s at {metrics['realtime_factor']:.3g} × real time",
        "",
    ]
    rows = []
    for check in metrics["checks"]:
        unit, sign = units[check["name"]], "≥" if check["bound"] == "min" else "≤"
        limit = f"{sign} {shown(check['limit'], unit)}"
        verdict = "ok" if check["ok"] else "FAILED" if check.get("judged", True) else "not judged"
        rows.append((check["name"], shown(check["value"], unit), limit, verdict))
    lines.append(table(("check", "value", "limit", ""), rows) if rows else _unchecked(metrics, units))
    diagnosed = told_diagnoses(metrics, len(finished.scenario.wheel_positions))
    recovery = told_recovery(finished.trace, metrics, finished.scenario.constants)
    comparison = told_comparison(units, metrics)
    link = told_link(metrics["link"]) if "link" in metrics else ""
    lines += [part for words in (diagnosed, recovery, comparison, link) if words for part in ("", words)] + [
        ""
    ]
    if finished.interrupted:
        lines.append("interrupted")
    else:
        lines.append(_verdict(metrics["checks"]))
    if out is not None:
        lines.append(f"written to {out}")
    return "\n".join(lines)
