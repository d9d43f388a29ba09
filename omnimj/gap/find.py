"""The workflow from a replay to a finding: search, judge, locate, and say which run comes next."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from omnimj.gap.fit import Fit
from omnimj.gap.heldout import make_folds
from omnimj.gap.intervals import spreads
from omnimj.gap.locate import locate
from omnimj.gap.name import Data, Report
from omnimj.gap.next_run import next_experiment
from omnimj.gap.noise import effective_samples, repeatability
from omnimj.gap.problem import Problem
from omnimj.gap.records import ChannelGap, Finding, Interval, NamedEffect, Overlay, Refitted
from omnimj.gap.replay import CandidateForm, Replay
from omnimj.gap.search import Named, Searched, search
from omnimj.gap.verdict import Verdict, judge_search
from omnimj.signals import Array


@dataclass(frozen=True)
class About:
    """What the finding says of its dataset beside the search itself."""

    dataset: str
    notes: tuple[str, ...] = ()
    conditions: Mapping[str, Mapping[str, float | str]] | None = None
    """Run → its conditions."""


def find(
    replay: Replay, about: About, holdout: tuple[str, ...] = (), seed: int = 0, report: Report | None = None
) -> Finding:
    """Finds where simulation and measurement disagree and what the model lacks.

    Args:
      replay: The plant with the measured runs.
      about: Of the dataset.
      holdout: Conditions that nothing is fitted to; drawn by the seed when empty.
      seed: Of what is held out, of folds and decoys.
      report: Called with a phrase and the share of it that is done; KeyboardInterrupt raised there ends the
        search with what it has.
    """
    began = time.perf_counter()
    counted = _Counted(replay)
    found = search(cast(Replay, counted), holdout, seed, report or (lambda phrase, share: None))
    folds = make_folds(found.groups, ~found.heldout, seed)
    data = Data(found.used, found.groups, folds, seed)
    verdict = judge_search(found, data)
    is_named = verdict.kind in ("named", "ambiguous")
    labels = tuple(n.candidate.label for n in found.named) if is_named else ()
    after = found.final if is_named else None
    mismatch_before = _mismatch(found.first, found.base)
    mismatch_after = None if after is None else _mismatch(found.problem, after)
    noise = found.problem.noise
    regimes = replay.regimes()
    names = [c.name for c in replay.channels]
    return Finding(
        dataset=about.dataset,
        plant=replay.plant,
        verdict=verdict.kind,
        reason=verdict.reason,
        effects=_effects(found) if is_named else (),
        where=locate(replay.channels, replay.pieces, regimes, mismatch_before, mismatch_after, noise),
        train=_gaps(found, mismatch_before, mismatch_after, found.used),
        heldout=_gaps(found, mismatch_before, mismatch_after, ~found.used),
        shrink=_shrink(found, mismatch_before, mismatch_after),
        next_experiment=_next(found, verdict),
        channels={c.name: (c.unit, c.words) for c in replay.channels},
        noise=dict(zip(names, noise.tolist(), strict=True)),
        heldout_runs=_heldout_runs(found),
        refitted=_refitted(found.problem, after or found.base),
        stages=tuple(r.stage(labels) for r in found.rounds),
        flexible=verdict.flexible,
        overlays=_overlays(found, mismatch_before, mismatch_after, about),
        data_notes=about.notes,
        samples=int(np.isfinite(replay.measured).sum()),
        effective_samples=effective_samples(replay, (after or found.base).residual),
        simulations=counted.count,
        seconds=time.perf_counter() - began,
        failure="interrupted" if found.interrupted else "",
        regimes={name: unit for name, (unit, _) in regimes.items()},
    )


class _Counted:
    """A replay that counts its simulations."""

    def __init__(self, replay: Replay):
        self._replay, self.count = replay, 0

    def __getattr__(self, name: str):
        return getattr(self._replay, name)

    def simulate(self, settings: Sequence) -> list[Array]:
        self.count += len(settings)
        return self._replay.simulate(settings)


def _mismatch(problem: Problem, fitted: Fit) -> Array:
    (mismatch,) = problem.mismatches([fitted.x], fitted.form)
    return mismatch


def own_values(problem: Problem, fitted: Fit, candidate: CandidateForm) -> slice:
    """Where the parameters of one effect lie in a fit's vector."""
    at = len(problem.replay.base) + problem.has_share
    for one in fitted.form:
        if one.label == candidate.label:
            return slice(at, at + len(one.parameters))
        at += len(one.parameters)
    raise ValueError(f"{candidate.label} is not in the model")


def _effects(found: Searched) -> tuple[NamedEffect, ...]:
    spread, factor = spreads(found.problem, found.final, found.used)
    return tuple(_effect(found, named, spread * factor) for named in found.named)


def _effect(found: Searched, named: Named, reach: Array) -> NamedEffect:
    candidate = named.candidate
    own = own_values(found.problem, found.final, candidate)
    parameters = {}
    for shape, value, half in zip(candidate.parameters, found.final.x[own], reach[own], strict=True):
        low, high = max(value - half, shape.low), min(value + half, shape.high)
        parameters[shape.name] = Interval(float(value), float(low), float(high), shape.unit)
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


def _rms(mismatch: Array, rows: NDArray[np.bool_]) -> list[float]:
    part = mismatch[rows]
    counts = np.maximum(np.isfinite(part).sum(axis=0), 1)
    return np.sqrt(np.nansum(part**2, axis=0) / counts).tolist()


def _gaps(
    found: Searched, before: Array, after: Array | None, rows: NDArray[np.bool_]
) -> dict[str, ChannelGap]:
    """RMS per channel before, after and between repeats."""
    replay = found.problem.replay
    floor = repeatability(replay, before if after is None else after)
    first = _rms(before, rows)
    second = [None] * len(first) if after is None else _rms(after, rows)
    return {
        channel.name: ChannelGap(b, a, float(f) if np.isfinite(f) else None)
        for channel, b, a, f in zip(replay.channels, first, second, floor, strict=True)
    }


def _shrink(found: Searched, before: Array, after: Array | None) -> float | None:
    """1 − after/before on held-out runs, RMS over all channels in units of their noise."""
    if after is None:
        return None
    rows = ~found.used
    whole = [np.nansum((m[rows] / found.problem.noise) ** 2) for m in (after, before)]
    return float(1.0 - np.sqrt(whole[0] / whole[1])) if whole[1] > 0.0 else None


def _next(found: Searched, verdict: Verdict):
    """A run that splits the first effect with rivals."""
    if verdict.kind != "ambiguous":
        return None
    for named in found.named:
        if named.rivals:
            rivals = [(r.candidate.label, r.fit) for r in named.rivals]
            return next_experiment(found.problem, found.final, rivals)
    return None


def _heldout_runs(found: Searched) -> tuple[str, ...]:
    rows = ~found.used
    runs = [p.run for p in found.problem.replay.pieces if rows[p.first : p.last].any()]
    return tuple(dict.fromkeys(runs))


def _refitted(problem: Problem, fitted: Fit) -> tuple[Refitted, ...]:
    rows = []
    for b, value in zip(problem.replay.base, fitted.x, strict=False):
        edge = 1e-3 * (b.high - b.low)
        at_bound = value <= b.low + edge or value >= b.high - edge
        rows.append(Refitted(b.name, b.unit, b.nominal, b.low, b.high, float(value), bool(at_bound)))
    return tuple(rows)


def _overlays(found: Searched, before: Array, after: Array | None, about: About) -> tuple[Overlay, ...]:
    replay, regimes = found.problem.replay, found.problem.replay.regimes()
    after = before if after is None else after
    overlays = []
    for piece in replay.pieces:
        rows = slice(piece.first, piece.last)
        overlays.append(
            Overlay(
                piece.run,
                bool((~found.used[rows]).any()),
                piece.time,
                replay.measured[rows],
                replay.measured[rows] - before[rows],
                replay.measured[rows] - after[rows],
                dict((about.conditions or {}).get(piece.run, {})),
                {name: values[rows] for name, (_, values) in regimes.items()},
            )
        )
    return tuple(overlays)
