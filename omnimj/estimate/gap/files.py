"""Files of a finding: `gap.json`, the new model file and the refitted floors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import omnimj
from omnimj.effects import (
    FLOOR,
    FLOOR_SCALES,
    MJCF,
    Interval,
    apply_effects,
    scale_floor,
    with_further_effects,
)
from omnimj.effects.model_writer import format_model
from omnimj.estimate.gap import sentences
from omnimj.estimate.gap.plants import Machine, find_plant
from omnimj.estimate.gap.records import (
    CandidateResult,
    Finding,
    MismatchRegime,
    NamedEffect,
    Refitted,
    Stage,
    run_gaps,
)
from omnimj.parameters import Floor
from omnimj.parameters.floor import FLOOR_UNITS, format_floor
from omnimj.recording.json_files import to_jsonable

_UNCHANGED = 1e-9  # change as a share of the box, up to which a value is unchanged


def digest(
    finding: Finding, new_model: str | None = None, new_floors: str | None = None, command: str = ""
) -> dict[str, Any]:
    """Content of `gap.json`: every number of the report, nothing that JSON cannot hold.

    Args:
      new_model: File name of the new model in the same folder; None if there is none.
      new_floors: File name of the refitted floors in the same folder; None if there are none.
      command: Command that repeats the work.
    """
    content = {
        "verdict": finding.verdict,
        "summary": sentences.summarize_finding(finding),
        "reason": finding.reason,
        "incomplete": finding.incomplete,
        "outside": None if finding.outside is None else vars(finding.outside),
        "remains": finding.remains,
        "tolerated": list(finding.tolerated),
        "effects": [_effect(effect) for effect in finding.effects],
        "where": [_place(place) for place in finding.where],
        "gap": {
            part: {channel: vars(gap) for channel, gap in gaps.items()}
            for part, gaps in (("train", finding.train), ("heldout", finding.heldout))
        },
        "shrink": finding.shrink,
        "heldout_total": dict(zip(("before", "after"), finding.heldout_total, strict=True)),
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
        "data_faults": [dict(fault) for fault in finding.data_faults],
        "refitted": list(map(vars, finding.refitted)),
        "stages": [_stage(stage) for stage in finding.stages],
        "given_up": [
            {"label": one.label, "gain": _interval(one.gain), "reason": one.reason}
            for one in finding.given_up
        ],
        "ended": finding.ended or None,
        "flexible": dict(finding.flexible),
        "runs": list(map(vars, run_gaps(finding))),
        "heldout_runs": list(finding.heldout_runs),
        "n": finding.samples,
        "n_eff": finding.effective_samples,
        "simulations": finding.simulations,
        "seconds": finding.seconds,
        "failure": finding.failure or None,
        "command": command,
        "version": omnimj.__version__,
    }
    return to_jsonable(content)


def _interval(interval: Interval) -> dict[str, Any]:
    return {"value": interval.value, "low": interval.low, "high": interval.high}


def _effect(effect: NamedEffect) -> dict[str, Any]:
    parameters = {name: {**_interval(value), "unit": value.unit} for name, value in effect.parameters.items()}
    return {**vars(effect), "parameters": parameters, "gain": _interval(effect.gain)}


def _place(place: MismatchRegime) -> dict[str, Any]:
    bounds = {name: list(interval) for name, interval in place.bounds.items()}
    return {
        "channel": place.channel,
        "regime": {"words": place.regime, "bounds": bounds},
        "share": place.share,
        "before": place.before,
        "after": place.after,
    }


def _candidate(candidate: CandidateResult) -> dict[str, Any]:
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
        "outcome": stage.outcome,
        "candidates": [_candidate(candidate) for candidate in stage.candidates],
        "decoys": np.sort(stage.decoys),
    }


def new_model_files(finding: Finding, file: Path | None = None) -> dict[str, str]:
    """Files of the model with the named effects and refitted values: file name → text; empty without a name.

    The first is the one to give to `--model`. Values that are no quantity of the model file are left out:
    numbers of a floor (see `new_floors_text`), lags of channels, the scale of the masses given by the runs.

    Args:
      file: Model file from which the search began; the shipped one when None.

    Raises:
      InputError: A file's text cannot be changed.
    """
    if not finding.effects:
        return {}
    machine = find_plant(finding.plant).read(file)
    tables = effect_tables(finding.effects, machine.effects)
    if finding.plant != MJCF:
        return {"model.toml": format_model(machine.file, tables, _changed(finding, machine))}
    from omnimj.plant.mujoco.machine_writer import new_machine_files  # loads MuJoCo

    fitted = {p.name: p.fitted for p in finding.refitted if _is_changed(p)}
    own = {one.part: fitted[one.name] for one in machine.uncertain if one.name in fitted}
    return new_machine_files(machine, own, tables, "model")


def new_floors_text(finding: Finding, floors: Mapping[str, Floor], file: Path | None = None) -> str | None:
    """Text of a floors file with the refitted floors; None where nothing was named or changed.

    Effects of one floor have become numbers of this floor.

    Args:
      floors: Floors from which the search began, by name.
      file: Model file from which the search began; the shipped one when None.

    Raises:
      InputError: A floor's law has no such number.
    """
    scales: dict[str, dict[str, float]] = {}
    for parameter in finding.refitted if finding.effects else ():
        name, _, letter = parameter.name.rpartition(".")
        if name in floors and letter in FLOOR_SCALES and _is_changed(parameter):
            scales.setdefault(name, {})[letter] = parameter.fitted
    own = _floor_effects(finding)
    if not scales and not own:
        return None
    changed = apply_effects(with_further_effects(_refitted_machine(finding, file), own))
    source = f"identified: refitted to {finding.dataset}"
    names = dict.fromkeys([*scales, *(str(values[FLOOR.name]) for _, values in own)])
    fitted = [changed.floor(scale_floor(floors[name], scales.get(name, {}))) for name in names]
    new = [replace(floor, source=source) for floor in fitted]
    return "\n".join(
        [f"# Floors refitted by omnimj {omnimj.__version__}.\n{FLOOR_UNITS}\n", *map(format_floor, new)]
    )


def _floor_effects(finding: Finding) -> list[tuple[str, dict[str, Any]]]:
    """Named effects of single floors, with the values of their parameters."""
    return [
        (effect.effect, {**effect.selectors, **{key: p.value for key, p in effect.parameters.items()}})
        for effect in finding.effects
        if FLOOR.name in effect.selectors
    ]


def _refitted_machine(finding: Finding, file: Path | None) -> Any:
    """Machine of the model file with its refitted mass, on which loads of floors depend, without effects."""
    machine: Any = replace(find_plant(finding.plant).read(file), effects={})
    for parameter in finding.refitted:
        if parameter.name == "body.mass":
            machine = replace(machine, body=replace(machine.body, mass=parameter.fitted))
    return machine


def effect_tables(
    effects: Iterable[NamedEffect], present: Iterable[str] = ()
) -> dict[str, dict[str, float | int | str | Interval]]:
    """Effects by the names of their tables; a second instance is called `sensor_delay_2`. Effects of one
    floor are left out: they become numbers of this floor.

    Args:
      present: Tables that the file has already; new effects are added to them.
    """
    tables: dict[str, dict[str, float | int | str | Interval]] = {}
    taken = set(present)
    for effect in effects:
        if FLOOR.name in effect.selectors:
            continue
        name, k = effect.effect, 2
        while name in taken:
            name, k = f"{effect.effect}_{k}", k + 1
        taken.add(name)
        tables[name] = {**effect.selectors, **effect.parameters}
    return tables


def _changed(finding: Finding, machine: Machine) -> dict[str, float]:
    """Refitted quantities under the names `table.key` of the model file."""
    changed = {}
    for parameter in finding.refitted:
        name = _quantity(parameter, machine)
        if name is not None and _is_changed(parameter):
            changed[name] = parameter.fitted
    return changed


def _is_changed(parameter: Refitted) -> bool:
    return abs(parameter.fitted - parameter.nominal) > _UNCHANGED * (parameter.high - parameter.low)


def _quantity(parameter: Refitted, machine: Machine) -> str | None:
    """Name of a parameter in the model file (`axis.coulomb` for `coulomb`); None if it has none."""
    for name in (parameter.name, f"axis.{parameter.name}"):
        table, _, key = name.partition(".")
        if name in machine.provenance and table != "effects":
            value: Any = getattr(getattr(machine, table, None), key, 0.0)  # an axis has none of its own
            return name if isinstance(value, float) else None
    return None
