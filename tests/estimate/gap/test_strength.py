"""The strength of an effect is the same everywhere where its law is that of the machine, and only there."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from toy import Toy

from omnimj.estimate.gap.find import DatasetSummary, analyse_replay
from omnimj.estimate.gap.search.cross_validation import FOLD_PRIOR
from omnimj.estimate.gap.search.search import search
from omnimj.estimate.gap.search.strength import strength_gains
from omnimj.estimate.gap.sentences import next_step, summarize_finding
from omnimj.estimate.gap.verdict import judge_search
from omnimj.estimate.replay.interface import KNOTS, CandidateEffect, CandidateParameter, Setting
from omnimj.estimate.replay.problem import huber_weights

FORWARD_ONLY = np.where(np.arange(KNOTS) >= KNOTS // 2, -0.6 * np.linspace(-3.0, 3.0, KNOTS) ** 2 / 9.0, 0.0)
"""Drag that brakes forward motion alone [N], at speeds from −3 to 3 m/s."""


def searched(replay: Toy):
    """Result of a search with one named effect."""
    found = search(replay, (), 0, lambda phrase, share: None)
    assert [n.candidate.label for n in found.named] == ["air_drag"]
    return found


def one_sided() -> Toy:
    """A mass with drag in one direction, which the library does not have."""
    replay = Toy({})
    (clean,) = replay.simulate([Setting(np.array([1.05, 0.47]), {}, ("speed", FORWARD_ONLY))])
    replay.measured = clean + 0.0005 * np.random.default_rng(0).standard_normal(clean.shape)
    return replay


def test_a_strength_that_varies_gains_nothing_where_the_law_is_right_and_much_where_it_is_wrong():
    right, wrong = searched(Toy({"air_drag": np.array([0.05])})), searched(one_sided())
    by_law = {
        name: strength_gains(found.problem, found.final, found.split)
        for name, found in (("right", right), ("wrong", wrong))
    }
    assert max(by_law["right"].values()) < 0.02
    assert by_law["wrong"]["air_drag", "speed"] > 0.1


def test_the_gain_is_that_of_a_ridge_regression_without_each_fold():
    """An independent route: rows of the prior below those of the data, solved by a pseudo-inverse."""
    found = searched(one_sided())
    problem, model, split = found.problem, found.final, found.split
    x, weight = model.x, huber_weights(problem, model.residual, split.used)
    speed = problem.replay.regimes()["speed"][1]
    low, high = np.quantile(speed, (0.02, 0.98))
    knots = np.linspace(low, high, 5)
    hats = np.column_stack([np.interp(speed, knots, row) for row in np.eye(5)])
    change = model.jacobian[:, -1] * x[-1] / problem.scales(model.effects)[-1]
    boxes = [0.5 * (b.high - b.low) for b in problem.replay.base]
    box = np.append(
        3.0 * np.array([1.0 / (half / s) ** 2 for half, s in zip(boxes, boxes, strict=True)]), 1e-6
    )

    def loss(columns, precision):
        total, whole = 0.0, columns[split.used] * weight[split.used, None]
        precision = precision + FOLD_PRIOR * (whole**2).sum(axis=0)
        for out in split.folds:
            rest = split.used & ~out
            a = np.vstack([columns[rest] * weight[rest, None], np.diag(np.sqrt(precision))])
            b = np.append(-model.residual[rest, 0] * weight[rest], np.zeros(len(precision)))
            step = np.linalg.pinv(a) @ b
            total += float((((model.residual[:, 0] + columns @ step) * weight)[out] ** 2).sum())
        return total

    plain = loss(model.jacobian, box)
    free = loss(np.column_stack([model.jacobian, change[:, None] * hats]), np.append(box, np.ones(5)))
    gain = strength_gains(problem, model, split)["air_drag", "speed"]
    assert gain == pytest.approx(1.0 - np.sqrt(free / plain), rel=1e-6)


def test_a_law_whose_strength_varies_is_not_named():
    found = searched(one_sided())
    verdict = judge_search(found)
    assert verdict.kind == "unexplained"
    assert "removes more: the effect is not in the library" in verdict.reason


def test_an_effect_after_which_more_is_left_than_was_there_before_is_not_named():
    """The mismatch before is that of the first model, with its own twin, as it is reported."""
    found = searched(Toy({"air_drag": np.array([0.05])}))
    assert judge_search(found).kind == "named"
    replay = Toy({})
    (exact,) = replay.simulate([found.first.split(found.base.x, ())[0]])
    replay.measured = exact
    verdict = judge_search(dataclasses.replace(found, first=dataclasses.replace(found.first, replay=replay)))
    assert verdict.kind == "unexplained" and "does not carry over" in verdict.reason


def test_the_same_effect_is_named_where_it_is_of_typical_size_and_tolerated_where_it_is_below_a_tenth_of_it():
    for typical, verdict in ((0.3, "named"), (0.6, "unexplained")):
        replay = Toy({"air_drag": np.array([0.05])})
        drag = next(c for c in replay.candidates if c.label == "air_drag")
        shape = dataclasses.replace(drag.parameters[0], typical=typical)
        others = (c for c in replay.candidates if c is not drag)
        replay.candidates = (dataclasses.replace(drag, parameters=(shape,)), *others)
        finding = analyse_replay(replay, DatasetSummary("runs"))
        assert finding.verdict == verdict
    assert finding.tolerated == ("air_drag",) and not finding.effects
    assert "air_drag" in summarize_finding(finding) and "no effect" not in summarize_finding(finding)
    assert next_step(finding).startswith("Drive faster, with more load or for longer")


def test_the_size_of_an_effect_is_that_of_its_largest_amplitude_in_typical_sizes():
    amplitudes = (
        CandidateParameter("force", "N", -4.0, 4.0, 2.0, 0.0),
        CandidateParameter("scale", "1", 0.5, 1.5, 0.8, 1.0),
        CandidateParameter("place", "m", 0.0, 1.0, 0.5, None),
    )
    effect = CandidateEffect("patch", "patch", "a patch", amplitudes)
    assert effect.relative_size(np.array([-0.5, 0.97, 0.9])) == pytest.approx(0.25)
    assert effect.relative_size(np.array([0.1, 0.9, 0.9])) == pytest.approx(0.5)
    assert dataclasses.replace(effect, parameters=amplitudes[2:]).relative_size(np.array([0.9])) == np.inf
