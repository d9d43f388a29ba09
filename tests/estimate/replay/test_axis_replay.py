"""The axis' replay: at the noise where the model is right; finds what was hidden in logs of two makers."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pytest
from axis_logs import AXIS, FORCE_NOISE, MASS, axis_moves
from axis_reference import log_of, sign
from nightly import representative

from omnimj.errors import InputError
from omnimj.estimate.gap.plants import find_plant
from omnimj.estimate.gap.search.screening import screen_candidates
from omnimj.estimate.intervals import block_noise
from omnimj.estimate.replay.interface import KNOTS, Setting
from omnimj.estimate.replay.mjcf.one_joint import free_windows_of_one_joint
from omnimj.estimate.replay.problem import Problem, fit
from omnimj.recording.dataset import Dataset, Run

VELOCITY = ("velocity_scale", "sensor_delay (velocity)")


@functools.cache
def logs(effect="", values=(), velocity=False, current=False):
    effects = {effect: dict(values)} if effect else {}
    true = {"mass": 96.5, "coulomb": 21.5, "viscous": 190.0}
    return tuple(axis_moves(effects, 3, seconds=6.0, velocity=velocity, current=current, true=true))


def replay_of(runs):
    return find_plant("linear_axis").make_replay(Dataset(AXIS.file, "linear_axis", tuple(runs)), AXIS, {})


def nominal(found, **changes):
    return Setting(np.array([changes.get(b.name, b.nominal) for b in found.base]))


def rms(mismatch):
    return np.sqrt(np.nanmean(mismatch**2, axis=0))


def problem_of(found):
    start = Problem(found, np.ones(len(found.channels)))
    (mismatch,) = start.mismatches([start.start()], ())
    return dataclasses.replace(start, noise=block_noise(found, mismatch))


def fitted(found, label):
    problem = problem_of(found)
    used = np.ones(len(found.measured), bool)
    base = fit(problem, (), problem.start(), used)
    (candidate,) = [c for c in found.candidates if c.label == label]
    (start,) = screen_candidates(problem, base, [candidate], used)
    return base, fit(problem, (candidate,), start.start, used)


def test_where_the_model_is_right_only_noise_is_left():
    found = replay_of(logs())
    (simulated,) = found.simulate([nominal(found, mass=96.5, coulomb=21.5, viscous=190.0)])
    force, position = rms(found.measured - simulated)
    white = FORCE_NOISE / math.sqrt(20.0)
    assert force < 1.25 * white
    assert position < 1e-4


def test_the_base_is_refitted_inside_its_box():
    found = replay_of(logs())
    problem = problem_of(found)
    base = fit(problem, (), problem.start(), np.ones(len(found.measured), bool))
    values = dict(zip((b.name for b in found.base), base.x, strict=True))
    assert values["mass"] == pytest.approx(96.5, rel=2e-3)
    assert values["coulomb"] == pytest.approx(21.5, rel=5e-3)
    assert values["viscous"] == pytest.approx(190.0, rel=5e-3)


CASES = [
    ("asymmetric_viscous", {"difference": 40.0}),
    ("force_offset", {"force": -3.2}),
    ("grade", {"slope": 0.004}),
    ("backlash", {"angle": 2e-4}),
    ("current_bias", {"bias": 0.1}),
    ("velocity_scale", {"scale": 0.96}),
    ("sensor_delay", {"delay": 0.004, "channel": "velocity"}),
    # foreign logs have these
    ("asymmetric_coulomb", {"difference": 4.0}),
    ("stribeck", {"force": 6.0, "velocity": 0.02}),
    ("position_friction", {"force": 8.0, "position": 0.06, "width": 0.02}),
    ("cable_drag", {"stiffness": 40.0, "rest_position": 0.05}),
    ("air_drag", {"coefficient": 60.0}),
]


@pytest.mark.parametrize(("effect", "values"), representative(*CASES, keep=2), ids=[c[0] for c in CASES])
def test_the_hidden_effect_is_recovered(effect, values, measured):
    label = effect if "channel" not in values else f"{effect} ({values['channel']})"
    found = replay_of(logs(effect, tuple(values.items()), label in VELOCITY))
    base, with_effect = fitted(found, label)
    assert with_effect.loss < 0.25 * base.loss
    for value, shape in zip(with_effect.x[len(found.base) :], with_effect.effects[0].parameters, strict=True):
        size = abs(values[shape.name]) if shape.name not in ("position", "rest_position") else 0.05
        error = abs(value - values[shape.name]) / size
        measured(f"axis effects recovered, {shape.name} [1]", error, 0.06)
        assert error < 0.06


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "values", "together"),
    [
        ("coulomb", {"force": 6.0}, lambda x, base: x + base["coulomb"] - 27.5),
        ("payload", {"mass": 7.0}, lambda x, base: (x + base["mass"] - 103.5) / 4.0),
        ("sensor_delay", {"delay": 0.006, "channel": "force"}, lambda x, base: (x - 0.006) * 500.0),
        ("viscous", {"coefficient": 60.0}, lambda x, base: (x + base["viscous"] - 250.0) / 10.0),
        ("torque_constant", {"scale": 0.9}, lambda x, base: (x * 96.5 / base["mass"] - 0.9) * 20.0),
        ("sensor_delay", {"delay": 0.006, "channel": "position"}, lambda x, base: (x - 0.006) * 500.0),
    ],
)
def test_what_the_base_can_take_a_part_of_is_recovered_with_it(effect, values, together):
    label = effect if "channel" not in values else f"{effect} ({values['channel']})"
    found = replay_of(logs(effect, tuple(values.items())))
    before, after = fitted(found, label)
    assert after.loss < 0.3 * before.loss
    base = dict(zip((b.name for b in found.base), after.x, strict=False))
    assert abs(together(after.x[len(found.base)], base)) < 0.5


@pytest.mark.slow
def test_feedback_hides_friction_from_position_not_from_force():
    found = replay_of(logs("coulomb", (("force", 10.0),)))
    setting = nominal(found, mass=96.5, coulomb=21.5, viscous=190.0)
    force, position = rms(found.measured - found.simulate([setting])[0])
    assert force > 20.0 * FORCE_NOISE / math.sqrt(20.0)
    assert position > 1e-3  # let go for a second it drifts off


def base_friction(v):
    return 20.0 * sign(v) + 200.0 * v


OTHERS = [
    ("asymmetric_coulomb", lambda x, v, t: base_friction(v) + 2.0, (4.0,)),
    (
        "stribeck",
        lambda x, v, t: base_friction(v) + 6.0 * math.exp(-((v / 0.02) ** 2)) * sign(v),
        (6.0, 0.02),
    ),
    (
        "position_friction",
        lambda x, v, t: base_friction(v) + 8.0 * math.exp(-0.5 * ((x - 0.03) / 0.02) ** 2) * sign(v),
        (8.0, 0.03, 0.02),
    ),
    ("cable_drag", lambda x, v, t: base_friction(v) + 30.0 * (x - 0.02), (30.0, 0.02)),
    ("air_drag", lambda x, v, t: base_friction(v) + 60.0 * v * abs(v), (60.0,)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("label", "resistance", "expected"), OTHERS, ids=[o[0] for o in OTHERS])
def test_logs_of_a_simulator_that_shares_no_code_are_understood(label, resistance, expected, measured):
    runs = [Run(f"r{k}", log_of(resistance, seed=k, duration=8.0), {}, {}, "r") for k in range(2)]
    found = replay_of(runs)
    base, after = fitted(found, label)
    assert after.loss < 0.2 * base.loss
    assert np.allclose(after.x[:3], (95.0, 20.0, 200.0), rtol=0.02)
    for value, truth in zip(after.x[len(found.base) :], expected, strict=True):
        measured("axis effects recovered from foreign logs [1]", abs(value / truth - 1.0), 0.1)
        assert value == pytest.approx(truth, rel=0.1)


def test_a_setting_s_simulation_does_not_depend_on_its_neighbours():
    found = replay_of(logs())
    settings = [nominal(found, mass=m) for m in (93.0, 95.0, 97.0)]
    together = found.simulate(settings)
    for setting, values in zip(settings, together, strict=True):
        (alone,) = found.simulate([setting])
        assert np.array_equal(alone, values, equal_nan=True)


def test_blocks_belong_to_pieces_without_holes():
    found = replay_of(logs())
    assert found.segments[0].first == 0
    for one, other in zip(found.segments[:-1], found.segments[1:], strict=True):
        assert one.last == other.first
    assert found.segments[-1].last == len(found.measured)
    for segment in found.segments:
        assert len(segment.time) == segment.last - segment.first
    for _, values in found.regimes().values():
        assert values.shape == (len(found.measured),)


@pytest.mark.slow
def test_each_candidate_moves_the_prediction():
    found = replay_of(logs(velocity=True))
    base = nominal(found)
    (plain,) = found.simulate([base])
    for candidate in found.candidates:
        size = np.array([s.typical for s in candidate.parameters])
        (moved,) = found.simulate([dataclasses.replace(base, effects={candidate.label: size})])
        assert np.nanmax(np.abs(moved - plain) / [1.0, 1e-3, 1e-2]) > 0.3, candidate.label


def test_each_curve_moves_the_prediction():
    found = replay_of(logs())
    base = nominal(found)
    (plain,) = found.simulate([base])
    for name, size in found.curves.items():
        (moved,) = found.simulate([dataclasses.replace(base, curve=(name, np.full(KNOTS, size)))])
        assert np.nanmax(np.abs(moved - plain)[:, 0]) > 0.5 * size, name


def test_the_menu_can_be_driven_and_a_load_parts_slope_from_offset():
    found = replay_of(logs())
    base, slope = nominal(found), 0.004
    offset = -MASS * 9.81 * math.sin(slope)
    rivals = [
        dataclasses.replace(base, effects={"grade": np.array([slope])}),
        dataclasses.replace(base, effects={"force_offset": np.array([offset])}),
    ]
    parting = {}
    for experiment in found.candidate_experiments():
        one, other = found.predict(rivals, experiment)
        assert np.isfinite(one[:, 0]).all() and np.isnan(one[:, 1:]).all()  # inputs alone
        parting[experiment.name] = float(np.abs(other - one)[:, 0].mean())
    loaded = [p for name, p in parting.items() if name.endswith("loaded")]
    assert len(parting) == 2 * len(loaded) == 8  # every motion bare and loaded
    plain = [p for name, p in parting.items() if not name.endswith("loaded")]
    assert min(loaded) > 20.0 * max(plain)


@pytest.mark.slow
def test_a_log_of_current_is_read_by_the_force_constant():
    force, current = replay_of(logs()), replay_of(logs(current=True))
    assert np.allclose(force.measured, current.measured, equal_nan=True)
    labels = {c.label for c in current.candidates}
    assert "sensor_delay (current)" in labels
    assert "sensor_delay (force)" not in labels


def test_gaps_and_spikes_are_masked_and_the_rest_is_at_the_floor():
    run = logs()[0]
    keep = np.ones(len(run.time), bool)
    keep[2100:2300] = False
    columns = {name: values[keep].copy() for name, values in run.columns.items()}
    spike = np.zeros(keep.sum(), bool)
    spike[4000] = True
    columns["position"][4000] += 0.05
    broken = Run("broken", columns, {"position": spike}, {})
    found = replay_of([broken])
    (simulated,) = found.simulate([nominal(found, mass=96.5, coulomb=21.5, viscous=190.0)])
    force, position = rms(found.measured - simulated)
    assert force < 0.3
    assert position < 2e-4
    assert np.isnan(found.measured).any()


def test_a_logger_with_a_noisy_position_gets_a_slower_filter():
    random, runs = np.random.default_rng(0), []
    for run in logs():
        noisy = run.columns["position"] + 3e-5 * random.standard_normal(len(run.time))
        runs.append(dataclasses.replace(run, columns={**run.columns, "position": noisy}))
    fine, rough = replay_of(logs()), replay_of(runs)
    assert rough.smoothing[0] > 2.0 * fine.smoothing[0]
    setting = nominal(rough, mass=96.5, coulomb=21.5, viscous=190.0)
    force, position = rms(rough.measured - rough.simulate([setting])[0])
    assert force < 1.0
    assert position < 1e-3


def test_a_log_without_force_or_too_short_is_refused():
    run = logs()[0]
    columns = {k: v for k, v in run.columns.items() if k != "force"}
    with pytest.raises(InputError, match="neither 'force' nor 'current'"):
        replay_of([Run("bare", columns, {}, {})])
    short = Run("short", {k: v[:200] for k, v in run.columns.items()}, {}, {})
    with pytest.raises(InputError, match="no run is long enough"):
        replay_of([short])


@pytest.mark.slow
def test_the_kernels_are_compiled_once():
    for found in (replay_of(logs(velocity=True)), replay_of(logs(current=True))):
        found.simulate([nominal(found)])
    assert len(free_windows_of_one_joint.signatures) == 1
