"""Trials of the benchmark: search a dataset by its path alone; once the seal is open, fit the true model.

The baselines, sparse regression on the residual and forward selection by BIC, use the data of the workflow's
screening: the whitened mismatch of the refitted base, the sensitivities of the candidates, each in its best
shape, and those of the base. Everything is linear.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnimj.estimate.gap.check.acceptance import check_dataset, correct_dataset
from omnimj.estimate.gap.files import digest
from omnimj.estimate.gap.find import find_gap
from omnimj.estimate.gap.plants import find_plant, read_machine
from omnimj.estimate.gap.search.cross_validation import choose_heldout, make_folds, make_groups
from omnimj.estimate.gap.search.refitting import fit_base, refit
from omnimj.estimate.gap.search.screening import screen_candidates
from omnimj.estimate.gap.search.sensitivities import Sensitivities
from omnimj.estimate.intervals import channel_rms
from omnimj.estimate.replay.interface import CandidateEffect, Replay
from omnimj.estimate.replay.problem import Fit, Problem, fit, huber_weights
from omnimj.parameters import read_floors
from omnimj.recording.read_dataset import read_dataset
from omnimj.signals import Array
from omnimj.studies.gap_benchmark.cases import HiddenEffect
from omnimj.studies.runner import guarded

SEED = 0
"""Default seed of the workflow, which draws the hold-out."""
_THRESHOLDS = (0.05, 0.1, 0.2, 0.4, 0.8)  # in typical sizes
_RIDGE = 1e-3
_MOST = 8  # effects that forward selection may take


@guarded
def search_case(dataset: str) -> dict[str, Any]:
    """Run the workflow and the baselines on a dataset, given its path only.

    Returns:
      `gap`: the content of gap.json; `seconds` of the workflow; `baselines`. Or `error`: the message.
    """
    began = time.perf_counter()
    finding = find_gap(Path(dataset))
    seconds = time.perf_counter() - began
    baselines = {
        name: {"names": list(picked.names), "heldout": picked.heldout}
        for name, picked in run_baselines(load_replay(Path(dataset)), SEED).items()
    }
    return {"gap": digest(finding), "seconds": seconds, "baselines": baselines}


@guarded
def fit_truth(dataset: str, hidden: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Fit the model with the true effects, the best result that the search could reach.

    Returns:
      `heldout`: channel → RMS mismatch on the held-out runs [unit of the channel]. `without`: the same for
      the model without one of several effects, by its label. Or `error`.
    """
    replay, effects = load_replay(Path(dataset)), [HiddenEffect(**one) for one in hidden]
    others = {one.label: [e for e in effects if e is not one] for one in effects if len(effects) > 1}
    without = {label: true_heldout(replay, rest) for label, rest in others.items()}
    return {"heldout": true_heldout(replay, effects), "without": without}


def load_replay(dataset: Path) -> Replay:
    """Load the dataset as the workflow does, with its own model or the shipped one."""
    read = read_dataset(dataset)
    machine = read_machine(read.plant, read.model)
    usable = correct_dataset(read, check_dataset(read, machine))
    return find_plant(read.plant).make_replay(usable, machine, read_floors())


def true_heldout(replay: Replay, effects: Sequence[HiddenEffect]) -> dict[str, float]:
    """Return channel → RMS mismatch of the true model on the held-out runs, fitted from the true values."""
    groups = make_groups(replay)
    out = choose_heldout(groups, SEED)
    used = ~out[groups.of_block]
    problem, base = fit_base(replay, used, lambda phrase, share: None)
    form = tuple(hidden_candidate(replay, one) for one in effects)
    own = [candidate.numbers(one.values) for one, candidate in zip(effects, form, strict=True)]
    fitted = fit(problem, form, np.concatenate([base.x, *own]), used)
    for _ in range(2):  # linearised again at the fit
        problem, fitted = refit(problem, fitted, used)
    (mismatch,) = problem.mismatches([fitted.x], form)
    names = [channel.name for channel in replay.channels]
    return dict(zip(names, channel_rms(mismatch[~used]).tolist(), strict=True))


def hidden_candidate(replay: Replay, hidden: HiddenEffect) -> CandidateEffect:
    """Return the candidate effect that equals the hidden one."""
    for candidate in replay.candidates:
        if candidate.label == hidden.label:
            return candidate
    raise ValueError(f"the search has no candidate {hidden.label}")


@dataclass(frozen=True)
class BaselineResult:
    """Effects that a baseline names, and the mismatch of its linear model on the held-out runs."""

    names: tuple[str, ...]
    """Labels of the effects, the first or largest first."""
    heldout: dict[str, float]
    """Channel → RMS mismatch [unit of the channel]."""


@dataclass(frozen=True)
class LinearModel:
    """Linearised data: weighted residual + columns · d; the columns of the base come first."""

    columns: Array
    """Sensitivities, shape (rows, base + all amplitudes)."""
    residual: Array
    """Whitened mismatch of the refitted base, shape (rows,)."""
    weight: Array
    """Weights, 0 where not fitted, shape (rows,)."""
    fold: NDArray[np.int_]
    """Fold of every row, −1 outside the folds, shape (rows,)."""
    is_heldout: NDArray[np.bool_]
    """Mask of measured rows that are held out, shape (rows,)."""
    count: int
    """Number of measured values in the fit."""
    prior: Array
    """Precision of the base's columns, shape (base,)."""
    labels: tuple[str, ...]
    """Labels of the columns after those of the base."""
    noise: dict[str, float]
    """Channel → noise of a block mean [unit of the channel]."""

    def solve(self, used: list[int], rows: NDArray[np.bool_] | None = None) -> Array:
        """Solve by ridge regression for some amplitudes and the base.

        Args:
          used: Indices of the amplitudes.
          rows: Mask of the rows, shape (rows,); all when None.

        Returns:
          d, 0 for the others, shape (columns,).
        """
        base = len(self.prior)
        at = [*range(base), *(base + k for k in used)]
        weight = self.weight if rows is None else self.weight * rows
        a = self.columns[:, at] * weight[:, None]
        gram = a.T @ a
        gram[np.diag_indices_from(gram)] += np.concatenate([self.prior, np.full(len(used), _RIDGE)])
        d = np.zeros(self.columns.shape[1])
        d[at] = np.linalg.solve(gram, -a.T @ (self.residual * weight))
        return d

    def squares(self, d: Array, rows: NDArray[np.bool_] | None = None) -> float:
        """Return the weighted residual sum of squares for d, shape (columns,)."""
        left = (self.residual + self.columns @ d) * self.weight
        return float((left**2).sum() if rows is None else (left[rows] ** 2).sum())

    def heldout(self, d: Array) -> dict[str, float]:
        """Return channel → RMS on the held-out rows [unit of the channel] with d, shape (columns,)."""
        left = np.where(self.is_heldout, self.residual + self.columns @ d, np.nan)
        found = channel_rms(left.reshape(-1, len(self.noise)))
        return {name: float(z * s) for (name, s), z in zip(self.noise.items(), found, strict=True)}


def run_baselines(replay: Replay, seed: int = 0) -> dict[str, BaselineResult]:
    """Run all baselines: refit of the base alone, sparse regression, forward selection by BIC.

    Args:
      replay: The dataset with the model.
      seed: Seed of the hold-out, that of the workflow, so that all are judged on the same runs.
    """
    groups = make_groups(replay)
    out = choose_heldout(groups, seed)
    used = ~out[groups.of_block]
    problem, base = fit_base(replay, used, lambda phrase, share: None)
    linear = linearize(problem, base, used, make_folds(groups, ~out, seed))
    nothing = np.zeros(linear.columns.shape[1])
    return {
        "base": BaselineResult((), linear.heldout(nothing)),
        "sparse": sparse_regression(linear),
        "bic": forward_selection(linear),
    }


def linearize(
    problem: Problem, base: Fit, used: NDArray[np.bool_], folds: list[NDArray[np.bool_]]
) -> LinearModel:
    """Return the sensitivities of every candidate in its best shape, in typical sizes, and those of the base.

    Args:
      problem: The fit problem.
      base: The refitted base.
      used: Mask of the training blocks, shape (blocks,).
      folds: Masks of the folds, shape (blocks,) each.
    """
    channels = len(problem.replay.channels)
    columns, labels, here = [base.jacobian], [], Sensitivities()
    for found in screen_candidates(problem, base, list(problem.replay.candidates), used, here):
        trial = here.trial(problem, base, found.candidate, found.shape, found.step)
        columns.append(trial.columns / found.step)
        labels += [found.candidate.label] * len(trial.steps)
    fold = np.full(len(used), -1)
    for k, rows in enumerate(folds):
        fold[rows] = k
    measured = np.isfinite(problem.replay.measured)
    precision, _ = problem.prior(base.x, base.effects)
    return LinearModel(
        np.hstack(columns),
        base.residual.ravel(),
        huber_weights(problem, base.residual, used),
        np.repeat(fold, channels),
        (measured & ~used[:, None]).ravel(),
        int(measured[used].sum()),
        precision + _RIDGE,
        tuple(labels),
        {c.name: float(s) for c, s in zip(problem.replay.channels, problem.noise, strict=True)},
    )


def sparse_regression(linear: LinearModel) -> BaselineResult:
    """Fit by sequentially thresholded least squares; the threshold has the smallest cross-validation loss."""
    scores = []
    for threshold in _THRESHOLDS:
        loss = 0.0
        for k in range(int(linear.fold.max()) + 1):
            rest = linear.fold != k
            loss += linear.squares(_thresholded(linear, threshold, rest), ~rest)
        scores.append(loss)
    d = _thresholded(linear, _THRESHOLDS[int(np.argmin(scores))])
    sizes: dict[str, float] = {}
    for label, value in zip(linear.labels, d[len(linear.prior) :].tolist(), strict=True):
        if value:
            sizes[label] = max(sizes.get(label, 0.0), abs(value))
    return BaselineResult(tuple(sorted(sizes, key=lambda label: -sizes[label])), linear.heldout(d))


def _thresholded(linear: LinearModel, threshold: float, rows: NDArray[np.bool_] | None = None) -> Array:
    used = list(range(len(linear.labels)))
    while True:
        d = linear.solve(used, rows)
        kept = [k for k in used if abs(d[len(linear.prior) + k]) >= threshold]
        if len(kept) == len(used):
            return d
        used = kept


def forward_selection(linear: LinearModel) -> BaselineResult:
    """Select effects one by one while N ln(RSS/N) + k ln N decreases."""
    names: list[str] = []

    def criterion(chosen: list[str]) -> tuple[float, Array]:
        used = [k for k, label in enumerate(linear.labels) if label in chosen]
        d = linear.solve(used)
        n = max(linear.count, 2)
        return n * np.log(max(linear.squares(d), 1e-30) / n) + len(used) * np.log(n), d

    best, d = criterion(names)
    while len(names) < _MOST:
        left = [label for label in dict.fromkeys(linear.labels) if label not in names]
        tried = [(*criterion([*names, label]), label) for label in left]
        if not tried:
            break
        value, there, label = min(tried, key=lambda entry: entry[0])
        if value >= best:
            break
        best, d = value, there
        names.append(label)
    return BaselineResult(tuple(names), linear.heldout(d))
