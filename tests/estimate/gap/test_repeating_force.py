"""A force that repeats along the way: it is described beside the named effects, and never named itself."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.integrate import quad
from test_effects_given_each_other import Wavy, quiet
from toy import SIZE, STEP, Toy

from omnimj.effects import effects_of
from omnimj.estimate.gap.find import DatasetSummary, analyse_replay, find_gap
from omnimj.estimate.gap.search.search import search
from omnimj.estimate.gap.sentences import next_step, summarize_finding
from omnimj.estimate.replay.interface import Structure, average_blocks, candidate_effects
from omnimj.estimate.replay.repeating_force import repeating_forces, with_repeating_force
from omnimj.physics.effect_terms import guide_force, terms_at, zero_terms
from omnimj.studies.gap_benchmark import datasets
from omnimj.studies.gap_benchmark.cases import HiddenEffect, draw_cases
from omnimj.studies.gap_benchmark.unmodelled import UnmodelledEffect

TURN = 3.0
FORCES = repeating_forces(TURN)


class Repeating(Toy):
    """Both forces, as a wave on the speed over the time."""

    structures: tuple[Structure, ...] = FORCES

    def simulate(self, settings):
        found = super().simulate(settings)
        time = average_blocks(STEP * np.arange(1500.0, dtype=np.float64), SIZE)
        for values, setting in zip(found, settings, strict=True):
            for force in FORCES:
                sine, cosine, period = setting.effects.get(force.label, np.array([0.0, 0.0, 1.0])).tolist()
                turned = 2.0 * np.pi * time / period
                wave = 0.1 * (sine * np.sin(turned) + cosine * np.cos(turned))
                values[:, 0] += np.tile(wave, len(values) // len(time))
        return found


class WavyRepeating(Wavy, Repeating):
    """A wave over the speed, which repeats along no way."""


@pytest.mark.parametrize("force", FORCES, ids=lambda force: force.label)
def test_the_force_on_the_guide_is_the_mean_of_a_sine_and_a_cosine_over_the_step(force):
    numbers, h, speed = np.array([0.3, -0.7, 0.8]), 0.05, 2.0
    row = with_repeating_force(zero_terms()[0], FORCES, {force.label: numbers}, TURN)
    turning = 2.0 * np.pi * speed / TURN  # rolling without slip
    found = guide_force(terms_at(row), speed, 0.4, 0.0, 0.0, 2.0 * np.pi * 0.4 / TURN, turning, h)

    def at(t):
        turned = 2.0 * np.pi * (0.4 + speed * t) / 0.8
        return 0.3 * np.sin(turned) - 0.7 * np.cos(turned)

    assert found == pytest.approx(quad(at, 0.0, h)[0] / h, rel=1e-9)


@pytest.mark.parametrize("plant", ["quarter_rig", "uto_robot"])
def test_only_repeating_forces_are_outside_the_library(plant):
    spans, effects = {"speed": (-1.0, 1.0), "position": (0.0, 1.0)}, effects_of(plant)
    candidates = candidate_effects(plant, spans, wheels=4)
    assert all(force.is_outside for force in FORCES) and not any(c.is_outside for c in candidates)
    for c in candidates:
        own = effects[c.effect]
        flags = c.turns_with_wheel, c.has_threshold, c.quantity, c.has_impacts
        assert flags == (own.turns_with_wheel, own.has_threshold, own.quantity, own.has_impacts)
    assert any(c.has_impacts for c in candidates)


def test_a_repeating_force_is_described_beside_the_effect_of_the_library_and_never_named():
    hidden = {"air_drag": np.array([0.05]), FORCES[0].label: np.array([0.3, -0.4, 0.9])}
    finding = analyse_replay(Repeating(hidden), DatasetSummary("toy"))
    assert [e.effect for e in finding.effects] == ["air_drag"] and finding.incomplete
    assert finding.effects[0].parameters["coefficient"].value == pytest.approx(0.05, rel=0.1)
    assert finding.outside is not None
    assert finding.outside.words.startswith("a force of 0.5 N that repeats every 0.9 m")
    assert finding.outside.remains < 1.2 < 2.0 < (finding.remains or 0.0)
    assert finding.reason.endswith("the noise remains without it")
    assert finding.outside.words in summarize_finding(finding)
    assert next_step(finding).startswith(f"Use the new model. Look for {finding.outside.words}")


def test_mismatches_after_the_effects_are_those_of_the_model_that_a_file_can_state():
    hidden = {"air_drag": np.array([0.05]), FORCES[0].label: np.array([0.3, -0.4, 0.9])}
    toy = Repeating(hidden)
    found = search(toy, (), 0, quiet)
    assert found.described.labels == {"air_drag"}
    (mismatch,) = found.problem.mismatches([found.described.x], found.described.effects)
    assert np.sqrt(np.mean(mismatch**2)) == pytest.approx(0.1 * 0.5 / np.sqrt(2.0), rel=0.1)


def test_a_repeating_force_alone_leaves_the_gap_unexplained_and_is_what_to_look_for():
    finding = analyse_replay(Repeating({FORCES[1].label: np.array([0.5, 0.0, 0.9])}), DatasetSummary("toy"))
    assert finding.verdict == "unexplained" and finding.outside is not None
    assert finding.outside.words in next_step(finding) and finding.outside.words in summarize_finding(finding)


def test_a_force_that_does_not_bring_the_mismatch_down_to_the_noise_leaves_no_trace():
    hidden = {"air_drag": np.array([0.15])}
    found, without = (search(kind(hidden, 0.1), (), 0, quiet) for kind in (WavyRepeating, Wavy))
    assert found.outside is None
    assert found.final.x == pytest.approx(without.final.x)
    assert found.outcomes == without.outcomes and found.given_up == without.given_up


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "period", "along"),
    [
        ("drive_ripple", 0.05 * 2.0 * np.pi / 1.6, "that the wheel rolls"),
        ("rail_joints", 0.16, "along the rail"),
    ],
)
def test_an_effect_is_named_alone_on_a_rig_whose_drive_or_rail_repeats_itself(tmp_path, kind, period, along):
    """Without such a force in the model a cable and sticky places make up for it."""
    length = 1.6 if kind == "drive_ripple" else period
    empty = next(case for case in draw_cases(6) if case.kind == "null")
    hidden = (HiddenEffect("rolling_resistance", {"mu_roll": 0.018}, "clear"),)
    case = dataclasses.replace(empty, hidden=hidden, structure=UnmodelledEffect(kind, 0.6, length, 1.0))
    datasets.make_dataset(case, tmp_path / "data")
    finding = find_gap(tmp_path / "data")
    assert [e.effect for e in finding.effects] == ["rolling_resistance"]
    assert finding.outside is not None and finding.outside.words.endswith(along)
    assert finding.outside.values["force"] == pytest.approx(0.6, rel=0.1)
    assert finding.outside.values["period"] == pytest.approx(period, rel=0.02)
