"""What was diagnosed in a run, in a few lines for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omnimj.cli.tables import table
from omnimj.parameters import Rig, Robot
from omnimj.scenario.pairing import Naming, Pair, pair
from omnimj.signals import Trace
from omnimj.view.recovered import layout_words, recovered
from omnimj.view.wording import answer, fault_details, fault_name, is_diagnosed, number

_MOST = 12  # rows: a method that cries wolf must not push the checks off the screen


def told_diagnoses(metrics: Mapping[str, Any], wheels: int) -> str:
    """A table of truth and diagnosis, or a line; empty for a run without a method.

    Args:
      metrics: Content of `metrics.json`.
      wheels: Number of wheels of the plant.
    """
    if not is_diagnosed(metrics):
        return ""
    if not metrics.get("truth", True):
        return _without_truth(metrics)
    found = pair(metrics["faults"], metrics["diagnoses"], wheels)
    if not found.pairs and not found.false_alarms:
        return "diagnosis: nothing was wrong, and nothing was diagnosed"
    if not metrics["diagnoses"]:
        wrong = "; ".join(_true(one) for one in found.pairs)
        return f"diagnosis: nothing was diagnosed; true: {wrong}"
    rows = []
    for one in found.pairs:
        for k, naming in enumerate(one.namings or (None,)):
            rows.append((_true(one) if k == 0 else "", *_named(one, naming)))
    rows += [("–", _said(naming), _at(naming), "false alarm") for naming in found.false_alarms]
    left = len(rows) - _MOST
    lines = [table(("true fault", "diagnosed", "at", "delay"), rows[:_MOST])]
    if left > 0:
        lines.append(f"and {left} more, in metrics.json")
    return "\n".join(lines)


def told_recovery(trace: Trace, metrics: Mapping[str, Any], constants: Robot | Rig) -> str:
    """What recovery did, when, and what cannot be held then; empty for a run as planned."""
    ways = recovered(trace, metrics)
    if not ways:
        return ""
    lines = [table(("recovery", "when", "what it gives up"), [(w.name, w.when, w.gives_up) for w in ways])]
    limits = layout_words(constants)
    return "\n".join([*lines, *([limits] if limits else [])])


def _without_truth(metrics: Mapping[str, Any]) -> str:
    """What was diagnosed where nobody knows what was wrong."""
    expected = len(metrics["scenario_faults"])
    note = f"the scenario's file has {expected} of its own, true only if the device runs it too"
    words = "diagnosis: nobody knows the faults of a robot behind a wire" + (f"; {note}" if expected else "")
    found = pair((), metrics["diagnoses"], 1).false_alarms
    if not found:
        return f"{words}\nnothing was diagnosed"
    lines = [words, table(("diagnosed", "at"), [(_said(one), _at(one)) for one in found[:_MOST]])]
    if len(found) > _MOST:
        lines.append(f"and {len(found) - _MOST} more, in metrics.json")
    return "\n".join(lines)


def _true(one: Pair) -> str:
    fault = one.fault
    details = fault_details({key: value for key, value in fault.items() if key != "channel"})
    onset = "never" if fault["onset"] is None else f"from {fault['onset']:g} s"
    return f"{fault_name(fault)}{f' ({details})' if details else ''} {onset}"


def _named(one: Pair, naming: Naming | None) -> tuple[str, str, str]:
    if naming is None:
        return ("nothing" if one.can_be_named else "no name for it"), "–", "–"
    return _said(naming), _at(naming), f"{number(naming.delay, 3)} s"


def _said(naming: Naming) -> str:
    times = len(naming.diagnoses)
    also = " or ".join(answer(text) for text in naming.last.get("ambiguous_with") or ())
    name = fault_name(naming.last) + (f" or {also}" if also else "")
    return f"{name} ({times} times)" if times > 1 else name


def _at(naming: Naming) -> str:
    return f"{naming.first['time']:.3f} s"
