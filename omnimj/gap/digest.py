"""`gap.json`: a finding as numbers and names, by the schema of the command line's files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import omnimj
from omnimj.gap import sentences
from omnimj.gap.per_run import RunGap, run_gaps
from omnimj.gap.records import Candidate, ChannelGap, Finding, Interval, NamedEffect, Place, Refitted, Stage
from omnimj.trials.results import plain


def digest(
    finding: Finding, new_model: str | None = None, new_floors: str | None = None, command: str = ""
) -> dict[str, Any]:
    """The content of `gap.json`: every number that the report shows, nothing that JSON cannot hold.

    Args:
      finding: What was found.
      new_model: File name of the new model, which lies beside; None where there is none.
      new_floors: File name of the refitted floors, which lie beside; None where there are none.
      command: What repeats the work.
    """
    content = {
        "verdict": finding.verdict,
        "summary": sentences.summary(finding),
        "reason": finding.reason,
        "effects": [_effect(effect) for effect in finding.effects],
        "where": [_place(place) for place in finding.where],
        "gap": {"train": _gaps(finding.train), "heldout": _gaps(finding.heldout)},
        "shrink": finding.shrink,
        "next_experiment": None if finding.next_experiment is None else dict(finding.next_experiment),
        "model": new_model,
        "floors": new_floors,
        "dataset": finding.dataset,
        "plant": finding.plant,
        "channels": {
            name: {"unit": unit, "words": words} for name, (unit, words) in finding.channels.items()
        },
        "noise": dict(finding.noise),
        "data_notes": list(finding.data_notes),
        "refitted": [_refitted(parameter) for parameter in finding.refitted],
        "stages": [_stage(stage) for stage in finding.stages],
        "flexible": dict(finding.flexible),
        "runs": [_run(gap) for gap in run_gaps(finding)],
        "heldout_runs": list(finding.heldout_runs),
        "n": finding.samples,
        "n_eff": finding.effective_samples,
        "simulations": finding.simulations,
        "seconds": finding.seconds,
        "failure": finding.failure or None,
        "command": command,
        "version": omnimj.__version__,
    }
    return plain(content)


def write_digest(path: Path, content: Mapping[str, Any]) -> None:
    """Writes `gap.json`.

    Raises:
      ValueError: A number that JSON does not have.
    """
    path.write_text(
        json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n", encoding="utf-8"
    )


def _interval(interval: Interval) -> dict[str, Any]:
    return {"value": interval.value, "low": interval.low, "high": interval.high}


def _effect(effect: NamedEffect) -> dict[str, Any]:
    return {
        "effect": effect.effect,
        "words": effect.words,
        "parameters": {
            name: {**_interval(value), "unit": value.unit} for name, value in effect.parameters.items()
        },
        "selectors": dict(effect.selectors),
        "indistinguishable_from": list(effect.indistinguishable_from),
        "gain": _interval(effect.gain),
        "p_false": effect.p_false,
    }


def _place(place: Place) -> dict[str, Any]:
    bounds = {name: list(interval) for name, interval in place.bounds.items()}
    return {
        "channel": place.channel,
        "regime": {"words": place.regime, "bounds": bounds},
        "share": place.share,
        "before": place.before,
        "after": place.after,
    }


def _gaps(gaps: Mapping[str, ChannelGap]) -> dict[str, Any]:
    return {
        channel: {"before": gap.before, "after": gap.after, "floor": gap.floor}
        for channel, gap in gaps.items()
    }


def _refitted(parameter: Refitted) -> dict[str, Any]:
    return {
        "name": parameter.name,
        "unit": parameter.unit,
        "nominal": parameter.nominal,
        "low": parameter.low,
        "high": parameter.high,
        "fitted": parameter.fitted,
        "at_bound": parameter.at_bound,
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    return {
        "label": candidate.label,
        "verdict": candidate.verdict,
        "screened": candidate.screened,
        "gain": None if candidate.gain is None else _interval(candidate.gain),
        "is_sensor": candidate.is_sensor,
    }


def _stage(stage: Stage) -> dict[str, Any]:
    return {
        "margin": stage.margin,
        "candidates": [_candidate(candidate) for candidate in stage.candidates],
        "decoys": np.sort(stage.decoys),
    }


def _run(gap: RunGap) -> dict[str, Any]:
    return {
        "run": gap.run,
        "heldout": gap.heldout,
        "partly": gap.partly,
        "conditions": dict(gap.conditions),
        "before": dict(gap.before),
        "after": None if gap.after is None else dict(gap.after),
        "total_before": gap.total_before,
        "total_after": gap.total_after,
    }
