"""Trials of the benchmark: search a dataset by its path alone; once the seal is open, fit the true model."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.estimate.gap.check.acceptance import check_dataset, correct_dataset
from omnimj.estimate.gap.files import digest
from omnimj.estimate.gap.find import find_gap
from omnimj.estimate.gap.plants import find_plant, read_machine
from omnimj.estimate.gap.records import channel_rms
from omnimj.estimate.gap.search.cross_validation import choose_heldout, make_groups
from omnimj.estimate.gap.search.search import fit_base, refit
from omnimj.estimate.replay.interface import CandidateEffect, Replay
from omnimj.estimate.replay.problem import fit
from omnimj.parameters import read_floors
from omnimj.recording.read_dataset import read_dataset
from omnimj.studies.gap_benchmark.baselines import run_baselines
from omnimj.studies.gap_benchmark.cases import HiddenEffect
from omnimj.studies.runner import guarded

SEED = 0
"""Default seed of the workflow, which draws the hold-out."""


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
    """Load the dataset as the workflow does, with the shipped model."""
    read = read_dataset(dataset)
    machine = read_machine(read.plant, None)
    usable = correct_dataset(read, check_dataset(read, machine))
    return find_plant(read.plant).make_replay(usable, machine, read_floors())


def true_heldout(replay: Replay, effects: Sequence[HiddenEffect]) -> dict[str, float]:
    """Return channel → RMS mismatch of the true model on the held-out runs, fitted from the true values."""
    groups = make_groups(replay)
    out = choose_heldout(groups, SEED)
    used = ~out[groups.of_block]
    problem, base = fit_base(replay, used, lambda phrase, share: None)
    form = tuple(hidden_candidate(replay, one) for one in effects)
    own = [float(one.values[s.name]) for one, f in zip(effects, form, strict=True) for s in f.parameters]
    fitted = fit(problem, form, np.concatenate([base.x, own]), used)
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
