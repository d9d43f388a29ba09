"""Gap workflow from a dataset's folder to a finding: read, check, replay, search, verdict, location."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from omnimj.control.robot_constants import robot_constants
from omnimj.effects import Interval
from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.gap.check.acceptance import fault_records, sound_dataset
from omnimj.estimate.gap.check.suspicions import DataCheck
from omnimj.estimate.gap.locate.regimes import locate
from omnimj.estimate.gap.plants import find_plant, in_terms_of, read_machine
from omnimj.estimate.gap.records import ChannelGap, Finding, NamedEffect, Overlay, Refitted, Stage
from omnimj.estimate.gap.search.candidates import parameter_slice
from omnimj.estimate.gap.search.judgement import SelectedEffect
from omnimj.estimate.gap.search.search import SearchResult, search
from omnimj.estimate.gap.search.selection import Progress
from omnimj.estimate.gap.search.uncertainty import parameter_reach
from omnimj.estimate.gap.verdict import Verdict, judge_search, next_experiment
from omnimj.estimate.intervals import channel_rms, effective_samples, finite_rms, repeatability
from omnimj.estimate.replay.interface import CandidateEffect, Replay
from omnimj.estimate.replay.problem import Fit, Problem
from omnimj.estimate.replay.steady.replay import SteadyReplay
from omnimj.estimate.replay.steady.runs import direction_sectors
from omnimj.estimate.replay.steady.traction import TractionCurves, traction_curves
from omnimj.estimate.robot.blocks import robot_rows
from omnimj.estimate.robot.pose_check import require_like_motion
from omnimj.parameters import Robot
from omnimj.parameters.floor import all_floors
from omnimj.recording.dataset import Dataset, Run
from omnimj.recording.read_dataset import read_dataset
from omnimj.signals import Array

_WIDEST = 20.0  # half width of the interval of a logarithm


def held_out_conditions(names: Sequence[str], runs: Sequence[Run]) -> tuple[str, ...]:
    """Conditions of the named runs; all repeats of a condition are held out together.

    Returns:
      Conditions in the order of the runs, each once.

    Raises:
      UnknownNameError: A name that is neither.
      InputError: Nothing is left to fit to.
    """
    known = {run.name for run in runs} | {run.condition for run in runs}
    for name in names:
        if name not in known:
            raise UnknownNameError("--holdout", "run or condition", name, sorted(known))
    wanted = {run.condition for run in runs if run.name in names or run.condition in names}
    if wanted and all(run.condition in wanted for run in runs):
        raise InputError(
            "--holdout", f"holds out all {len(runs)} runs", "one condition at least is needed to fit to"
        )
    return tuple(dict.fromkeys(run.condition for run in runs if run.condition in wanted))


@dataclass(frozen=True)
class DatasetSummary:
    """Facts about the dataset that become part of the finding."""

    dataset: str
    notes: tuple[str, ...] = ()
    conditions: Mapping[str, Mapping[str, float | str]] | None = None
    """Run → its conditions."""
    faults: tuple[Mapping[str, Any], ...] = ()
    """Findings of the data check as records, the most important first."""
    model: Path | None = None
    """Model file that the dataset names."""


def analyse_replay(
    replay: Replay,
    about: DatasetSummary,
    holdout: tuple[str, ...] = (),
    seed: int = 0,
    report: Progress | None = None,
) -> Finding:
    """Find where simulation and measurement disagree, and what the model lacks.

    Args:
      holdout: Conditions excluded from every fit; drawn by the seed when empty.
      seed: Seed of the held-out draw, the folds and the decoys.
      report: Called with a phrase and the completed share of it; KeyboardInterrupt raised there ends the
        search with the result so far.
    """
    began = time.perf_counter()
    counted = _CountingReplay(replay)
    found = search(cast(Replay, counted), holdout, seed, report or (lambda phrase, share: None))
    verdict = judge_search(found)
    is_named = verdict.kind in ("named", "ambiguous")
    after = found.described if is_named else None
    mismatch_before = _mismatch(found.first, found.base)
    mismatch_after = None if after is None else _mismatch(found.problem, after)
    was = _in_noise(found, mismatch_before)
    rest = None if mismatch_after is None else _in_noise(found, mismatch_after)
    noise = found.problem.noise
    regimes = replay.regimes()
    names = [c.name for c in replay.channels]
    return Finding(
        dataset=about.dataset,
        plant=replay.plant,
        verdict=verdict.kind,
        reason=verdict.reason,
        effects=_effects(found) if is_named else (),
        where=locate(replay.channels, replay.segments, regimes, mismatch_before, mismatch_after, noise),
        train=_gaps(found, mismatch_before, mismatch_after, found.used),
        heldout=_gaps(found, mismatch_before, mismatch_after, ~found.used),
        shrink=1.0 - rest / was if rest is not None and was > 0.0 else None,
        next_experiment=_next(found, verdict),
        channels={c.name: (c.unit, c.words) for c in replay.channels},
        noise=dict(zip(names, noise.tolist(), strict=True)),
        heldout_runs=_heldout_runs(found),
        refitted=_refitted(found.problem, after or found.base),
        stages=_stages(found, is_named),
        flexible=verdict.flexible,
        overlays=_overlays(found, mismatch_before, mismatch_after, about),
        data_notes=about.notes,
        data_faults=about.faults,
        samples=int(np.isfinite(replay.measured).sum()),
        effective_samples=effective_samples(replay, (after or found.base).residual),
        simulations=counted.count,
        seconds=time.perf_counter() - began,
        failure="interrupted" if found.interrupted else "",
        regimes={name: unit for name, (unit, _) in regimes.items()},
        remains=verdict.remains,
        outside=verdict.outside,
        tolerated=verdict.tolerated,
        undetermined=verdict.undetermined,
        incomplete=verdict.incomplete,
        given_up=found.given_up,
        traction=_traction(replay, found, after),
        ended=found.ended,
        model=about.model,
        heldout_total=(was, rest),
    )


def _stages(found: SearchResult, is_named: bool) -> tuple[Stage, ...]:
    """Rounds of the search; the last one may have been interrupted before its outcome."""
    named = found.named if is_named else ()
    labels = tuple(n.candidate.label for n in named)
    rivals = {r.candidate.label for n in named for r in n.rivals}
    pairs = itertools.zip_longest(found.rounds, found.outcomes, fillvalue="")
    return tuple(one.stage(labels, rivals, outcome) for one, outcome in pairs)


def _traction(replay: Replay, found: SearchResult, after: Fit | None) -> tuple[TractionCurves, ...]:
    """Traction over slip, of replays that know it."""
    if not isinstance(replay, SteadyReplay):
        return ()
    second = None if after is None else found.problem.split(after.x, after.effects)[0]
    return traction_curves(replay, found.first.split(found.base.x, found.base.effects)[0], second)


class _CountingReplay:
    """Replay that counts its simulations."""

    def __init__(self, replay: Replay):
        self._replay, self.count, self._lock = replay, 0, threading.Lock()

    def __getattr__(self, name: str):
        return getattr(self._replay, name)

    def simulate(self, settings: Sequence) -> list[Array]:
        with self._lock:
            self.count += len(settings)
        return self._replay.simulate(settings)


def _mismatch(problem: Problem, fitted: Fit) -> Array:
    (mismatch,) = problem.mismatches([fitted.x], fitted.effects)
    return mismatch


def _effects(found: SearchResult) -> tuple[NamedEffect, ...]:
    reach = found.reach
    if reach is None:  # interrupted
        reach = parameter_reach(found.problem, found.final, found.used)
    return tuple(_effect(found, named, reach) for named in found.named)


def _effect(found: SearchResult, named: SelectedEffect, reach: Array) -> NamedEffect:
    candidate = named.candidate
    own = parameter_slice(found.problem, found.final, candidate)
    parameters = _intervals(candidate, found.final.x[own], reach[own])
    rivals = []
    for rival in named.rivals:
        name = rival.candidate.effect
        rivals.append(name if name != candidate.effect else rival.candidate.label)
    unique = tuple(dict.fromkeys(rivals))
    return NamedEffect(
        candidate.effect,
        candidate.words,
        parameters,
        dict(candidate.selectors),
        unique,
        named.gain,
        named.p_false,
    )


def _intervals(candidate: CandidateEffect, numbers: Array, reach: Array) -> dict[str, Interval]:
    """Parameters of an effect with their 90 % intervals."""
    values, parameters = candidate.values(numbers), {}
    halves = dict(zip([shape.name for shape in candidate.parameters], reach.tolist(), strict=True))
    for shape, number in zip(candidate.parameters, numbers.tolist(), strict=True):
        half = halves[shape.name]
        if shape.times:
            ends = _interval_of_quotient(number, half, values[shape.times], halves[shape.times])
            ends = max(ends[0], shape.least), max(ends[1], shape.least)
        else:
            ends = max(number - half, shape.low), min(number + half, shape.high)
        is_fixed = shape.low == shape.high  # at its null value: the data do not determine it
        bounds = (None, None) if is_fixed else ends
        parameters[shape.name] = Interval(values[shape.name], *bounds, shape.unit)
    return parameters


def _interval_of_quotient(a: float, half_a: float, b: float, half_b: float) -> tuple[float, float]:
    """Interval of a/b for b > 0: that of its logarithm unless the interval of a includes 0."""
    if half_a >= abs(a):
        return (a - half_a) / b, (a + half_a) / b
    share = min(math.hypot(half_a / a, half_b / b), _WIDEST)
    ends = a / b * math.exp(-share), a / b * math.exp(share)
    return min(ends), max(ends)


def _gaps(
    found: SearchResult, before: Array, after: Array | None, rows: NDArray[np.bool_]
) -> dict[str, ChannelGap]:
    """RMS per channel before, after and between repeats; 0 where nothing was measured."""
    replay = found.problem.replay
    floor = repeatability(replay, before if after is None else after)
    first = np.nan_to_num(channel_rms(before[rows])).tolist()
    second = [None] * len(first) if after is None else np.nan_to_num(channel_rms(after[rows])).tolist()
    return {
        channel.name: ChannelGap(b, a, float(f) if np.isfinite(f) else None)
        for channel, b, a, f in zip(replay.channels, first, second, floor, strict=True)
    }


def _in_noise(found: SearchResult, mismatch: Array) -> float:
    """Held-out mismatch, RMS over all channels in units of noise."""
    return finite_rms(mismatch[~found.used] / found.problem.noise, without=0.0)


def _next(found: SearchResult, verdict: Verdict):
    """Run that separates the first effect from its rivals."""
    if verdict.kind != "ambiguous":
        return None
    for named in found.named:
        if named.rivals:
            rivals = [(r.candidate.label, r.fit) for r in named.rivals]
            return next_experiment(found.problem, found.final, rivals)
    return None


def _heldout_runs(found: SearchResult) -> tuple[str, ...]:
    rows = ~found.used
    runs = [p.run for p in found.problem.replay.segments if rows[p.first : p.last].any()]
    return tuple(dict.fromkeys(runs))


def _refitted(problem: Problem, fitted: Fit) -> tuple[Refitted, ...]:
    rows, totals = [], {c.quantity: c.label for c in fitted.effects if c.quantity}
    for b, value in zip(problem.replay.base, fitted.x, strict=False):
        edge = 1e-3 * (b.high - b.low)
        at_bound = value <= b.low + edge or value >= b.high - edge
        label = totals.get(b.name, "") if value == b.nominal else ""
        rows.append(Refitted(b.name, b.unit, b.nominal, b.low, b.high, float(value), bool(at_bound), label))
    return tuple(rows)


def _overlays(
    found: SearchResult, before: Array, after: Array | None, about: DatasetSummary
) -> tuple[Overlay, ...]:
    replay, regimes = found.problem.replay, found.problem.replay.regimes()
    after = before if after is None else after
    overlays = []
    for segment in replay.segments:
        rows = slice(segment.first, segment.last)
        overlays.append(
            Overlay(
                segment.run,
                bool((~found.used[rows]).any()),
                segment.time,
                replay.measured[rows],
                replay.measured[rows] - before[rows],
                replay.measured[rows] - after[rows],
                dict((about.conditions or {}).get(segment.run, {})),
                {name: values[rows] for name, (_, values) in regimes.items()},
            )
        )
    return tuple(overlays)


def _checked(dataset: Dataset, machine: Any, accept: bool) -> tuple[Dataset, DataCheck]:
    """Data to search in, and the findings on them; a measured pose is compared with the wheels."""
    if not dataset.pose_measured:
        return sound_dataset(dataset, machine, accept)
    require_like_motion(dataset.path, robot_rows(dataset, machine), robot_constants(machine))
    return dataset, DataCheck((), ())


def find_gap(
    dataset: Path | str,
    model: Path | str | None = None,
    holdout: Sequence[str] = (),
    report: Callable[[str, float], None] | None = None,
    seed: int = 0,
    floors_file: Path | str | None = None,
    accept: bool = False,
) -> Finding:
    """Find where a model and measured runs disagree, and what the model lacks.

    Args:
      dataset: Folder of the measured runs.
      model: The plant's model file; the shipped one when None.
      holdout: Runs or conditions to hold out; drawn by the seed when empty.
      report: Called with a phrase and the completed share of it; KeyboardInterrupt raised there ends the
        search with the result so far.
      seed: Seed of the held-out draw and of the random curves.
      floors_file: Floors in addition to the shipped ones; equal names replace them.
      accept: Whether to search in data with certain faults: gross units and time bases are then corrected.

    Raises:
      DataFaultError: The data have certain faults in time, unit, sign or delay, and are not accepted.
      InputError: The dataset or the model file is wrong.
      UnknownNameError: Unknown floor, plant or run.
    """
    floors = all_floors(floors_file)
    read = read_dataset(dataset, floors)
    machine = read_machine(read.plant, model or read.model)
    read = in_terms_of(read, machine)
    plant = find_plant(read.plant)
    plant.require(read, machine)
    if read.pose_measured:
        read = direction_sectors(read, cast(Robot, machine))
    conditions = held_out_conditions(holdout, read.runs)
    usable, check = _checked(read, machine, accept)
    replay = plant.make_replay(usable, machine, floors)
    about = DatasetSummary(
        str(dataset),
        (*usable.notes, *replay.notes),
        {run.name: run.conditions for run in usable.runs},
        tuple(fault_records(check)),
        read.model,
    )
    return analyse_replay(replay, about, conditions, seed, report)
