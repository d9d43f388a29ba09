"""The robot's replay: missions driven in closed loop by the planar plant behind its sensors, and the twin."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from nightly import representative

from omnimj.effects import with_effects
from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.intervals import block_noise, neighbour_noise
from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.problem import Problem, fit
from omnimj.estimate.replay.robot.kernel_parameters import POINTS, lean_shares, roller_tables
from omnimj.estimate.replay.robot.replay import RobotReplay
from omnimj.parameters import read_floors, read_robot
from omnimj.recording.dataset import Dataset, Run
from omnimj.simulate.suites.missions import mission, record_robot
from omnimj.simulate.suites.suite import Condition, RunConfig

ROBOT, FLOORS = read_robot(), read_floors()
SECONDS = 8.0
CURRENTS = slice(0, 4)
ACCELERATION, YAW_RATE, YAW = 4, 6, 7


def columns_of(effects: Mapping, seed: int = 5, plant: str = "planar", floor: str = "natural_stone") -> dict:
    """A mission as a logger would have it, ground truth included."""
    reference = mission(np.random.default_rng(seed), SECONDS, 1.0 / ROBOT.sensors.sample_rate)
    robot = with_effects(ROBOT, effects) if effects else ROBOT
    made = record_robot(robot, ROBOT, Condition("m", {"floor": floor}, reference), RunConfig(plant, seed))
    return dict(made)


def dataset(*runs: dict, floor: str = "natural_stone", masked: Mapping | None = None) -> Dataset:
    about = MappingProxyType({"floor": floor})
    named = [Run(f"mission_{k + 1}", c, masked or {}, about) for k, c in enumerate(runs)]
    return Dataset(Path("somewhere"), "uto_robot", tuple(named))


def replay_of(*runs: dict) -> RobotReplay:
    return RobotReplay(dataset(*runs), ROBOT, FLOORS)


def setting(replay: RobotReplay, effects: Mapping | None = None) -> Setting:
    return Setting(np.array([b.nominal for b in replay.base]), effects or {})


def misfit(replay: RobotReplay, effects: Mapping | None = None) -> np.ndarray:
    (found,) = replay.simulate([setting(replay, effects)])
    return np.sqrt(np.nanmean((replay.measured - found) ** 2, axis=0))


@pytest.fixture(scope="module")
def healthy() -> dict:
    return columns_of({})


@pytest.fixture(scope="module")
def replayed(healthy) -> RobotReplay:
    return replay_of(healthy)


def test_a_healthy_robot_lacks_no_current(replayed):
    left = misfit(replayed)
    used = np.sqrt((replayed.measured[:, CURRENTS] ** 2).mean(axis=0))
    assert (used > 0.2).all()
    assert (left[CURRENTS] < 0.01).all()


def test_accelerometer_and_gyro_of_a_healthy_robot_are_met_within_their_noise(replayed):
    left = misfit(replayed)
    sensors = ROBOT.sensors
    # 20 samples make a block; both sensors are slower than a sample
    assert (left[ACCELERATION : ACCELERATION + 2] < 0.6 * sensors.accelerometer_noise).all()
    assert left[YAW_RATE] < sensors.gyro_noise
    assert left[YAW] < 2.0 * np.pi / 2**sensors.yaw_bits


def test_ground_truth_is_not_used(healthy, replayed):
    blind = {name: v for name, v in healthy.items() if name not in ("x", "y", "heading")}
    wrong = {**healthy, "x": healthy["x"] + 7.0, "y": -healthy["y"], "heading": 0.0 * healthy["heading"]}
    (expected,) = replayed.simulate([setting(replayed)])
    for columns in (blind, wrong):
        other = replay_of(columns)
        (found,) = other.simulate([setting(other)])
        assert np.array_equal(found, expected)
        assert np.array_equal(other.measured, replayed.measured)


PHYSICAL = {
    "torque_constant (wheel 2)": ({"torque_constant": {"wheel": 2, "scale": 0.85}}, (0.85,)),
    "wheel_radius (wheel 3)": ({"wheel_radius": {"wheel": 3, "scale": 1.03}}, (1.03,)),
    "payload": ({"payload": {"mass": 2.0}}, (2.0, 0.0, 0.0)),
    "roller_friction": ({"roller_friction": {"roller_dry": 0.02, "roller_viscous": 0.02}}, (0.02, 0.02)),
    "wheel_misalignment (wheel 1)": ({"wheel_misalignment": {"wheel": 1, "angle": 0.06}}, (0.06,)),
    "grade": ({"grade": {"slope": 0.03, "direction": 1.0}}, (0.03, 1.0)),
}


@cache
def replay_with(label: str) -> RobotReplay:
    """Replay of a mission of a robot with one of these effects."""
    return replay_of(columns_of(PHYSICAL[label][0]))


@pytest.mark.parametrize("label", representative(*PHYSICAL, keep=3))
def test_a_hidden_effect_shows_and_its_own_parameters_explain_it(label, replayed):
    values, replay = PHYSICAL[label][1], replay_with(label)
    blind, corrected = misfit(replay), misfit(replay, {label: np.array(values)})
    noise = misfit(replayed)
    assert (blind[CURRENTS] > 3.0 * corrected[CURRENTS]).any()
    assert (corrected < 1.5 * noise + 1e-4).all()


def test_a_weak_motor_shows_in_its_own_current():
    left = misfit(replay_with("torque_constant (wheel 2)"))
    assert left[1] > 3.0 * max(left[0], left[2], left[3])


@pytest.mark.parametrize(
    ("channel", "delay"),
    representative(
        ("current_1", 0.02),
        ("yaw", 0.03),
        ("wheel_speed_2", 0.02),
        ("acceleration_y", 0.03),
        ("yaw_rate", 0.02),
        keep=2,
    ),
)
def test_a_late_channel_is_explained_by_its_delay(healthy, replayed, channel, delay):
    late = dict(healthy)
    k = round(delay * ROBOT.sensors.sample_rate)
    late[channel] = np.concatenate((np.full(k, healthy[channel][0]), healthy[channel][:-k]))
    replay = replay_of(late)
    label = f"sensor_delay ({channel})"
    noise = block_noise(replayed, replayed.measured - replayed.simulate([setting(replayed)])[0])
    blind, corrected = misfit(replay) / noise, misfit(replay, {label: np.array([delay])}) / noise
    assert np.linalg.norm(corrected) < 0.9 * np.linalg.norm(blind)
    assert (corrected < 1.2 * misfit(replayed) / noise + 0.1).all()


@pytest.mark.parametrize(
    ("label", "channel", "scale", "offset"),
    [
        ("yaw_rate_bias", "yaw_rate", 1.0, 0.03),
        ("yaw_rate_scale", "yaw_rate", 1.05, 0.0),
        ("acceleration_scale (acceleration_x)", "acceleration_x", -1.0, 0.0),
        ("acceleration_bias (acceleration_y)", "acceleration_y", 1.0, 0.2),
    ],
)
def test_a_wrong_sensor_is_explained_by_its_scale_or_offset(healthy, replayed, label, channel, scale, offset):
    changed = {**healthy, channel: scale * healthy[channel] + offset}
    replay = replay_of(changed)
    at = [c.name for c in replay.channels].index(channel)
    corrected = misfit(replay, {label: np.array([offset or scale])})
    assert misfit(replay)[at] > 2.0 * corrected[at]
    assert corrected[at] == pytest.approx(misfit(replayed)[at], rel=0.1)


def test_a_fit_finds_the_radius_of_a_wheel_with_the_base_free():
    replay = replay_with("wheel_radius (wheel 3)")
    (candidate,) = (c for c in replay.candidates if c.label == "wheel_radius (wheel 3)")
    (found,) = replay.simulate([setting(replay)])
    problem = Problem(replay, block_noise(replay, replay.measured - found))
    used = np.ones(len(replay.measured), bool)
    fitted = fit(problem, (candidate,), np.append(problem.start(), 1.0), used)
    assert fitted.x[-1] == pytest.approx(1.03, abs=0.001)


def test_a_stretch_of_floor_is_looked_for_where_it_is(replayed):
    place = replayed.regimes()["position"][1]
    start, end = (float(np.quantile(place, share)) for share in (0.3, 0.7))
    assert end - start > 0.3
    hidden = {"floor_patch": {"scale": 0.4, "start": start, "end": end}}
    replay = replay_of(columns_of(hidden))
    (candidate,) = (c for c in replay.candidates if c.effect == "floor_patch")
    tried = {s.name: s.trials for s in candidate.parameters}
    assert tried["start"] == (pytest.approx(start, abs=0.15),)
    assert tried["end"] == (pytest.approx(end, abs=0.15),)


def test_a_gap_in_time_begins_a_new_piece(healthy):
    time = healthy["time"]
    kept = (time < 3.0) | (time > 3.5)
    replay = replay_of({name: v[kept] for name, v in healthy.items()})
    assert len(replay.segments) == 2
    assert replay.segments[0].time[-1] < 3.0
    assert replay.segments[1].time[0] > 3.5
    # the second begins on the move: the body's velocity is not known there at once
    assert np.isnan(replay.measured[replay.segments[1].first]).all()
    assert (misfit(replay)[CURRENTS] < 0.02).all()


def test_masked_samples_are_no_data_and_do_no_harm(healthy, replayed):
    broken, mark = dict(healthy), np.zeros(len(healthy["time"]), bool)
    broken["wheel_speed_2"] = healthy["wheel_speed_2"].copy()
    broken["current_1"] = healthy["current_1"].copy()
    mark[[2000, 4500]] = True
    broken["wheel_speed_2"][mark] = 500.0
    broken["current_1"][mark] = -4.9
    data = dataset(broken, masked={"wheel_speed_2": mark, "current_1": mark})
    replay = RobotReplay(data, ROBOT, FLOORS)
    assert 1 <= np.isnan(replay.measured[:, 0]).sum() <= 4
    assert misfit(replay) == pytest.approx(misfit(replayed), rel=0.05)


def test_settings_are_simulated_alike_on_one_thread_and_on_two(replayed):
    settings = [setting(replayed), setting(replayed, {"payload": np.array([1.0, 0.0, 0.0])})]
    alone = [replayed.simulate([s])[0] for s in settings]
    for a, b in zip(alone, replayed.simulate(settings), strict=True):
        assert np.array_equal(a, b)


@pytest.mark.slow
def test_every_candidate_at_its_vanishing_value_changes_nothing(replayed):
    (expected,) = replayed.simulate([setting(replayed)])
    for candidate in replayed.candidates:
        values = np.array([s.typical if s.null_value is None else s.null_value for s in candidate.parameters])
        (found,) = replayed.simulate([setting(replayed, {candidate.label: values})])
        assert found == pytest.approx(expected, abs=1e-9), candidate.label


def test_every_candidate_at_its_typical_size_can_be_simulated_and_shows(replayed):
    (plain,) = replayed.simulate([setting(replayed)])
    for candidate in replayed.candidates:
        values = np.array([s.typical for s in candidate.parameters])
        (found,) = replayed.simulate([setting(replayed, {candidate.label: values})])
        assert np.isfinite(found).all(), candidate.label
        assert not np.allclose(found, plain, atol=1e-6), candidate.label


def test_a_payload_that_no_fit_may_place_there_is_moved_inward(replayed):
    far = {"payload": np.array([20.0, 0.3, 0.3])}
    (found,) = replayed.simulate([setting(replayed, far)])
    assert np.isfinite(found).all()


def test_a_free_curve_over_each_variable_shows(replayed):
    (plain,) = replayed.simulate([setting(replayed)])
    for name in replayed.curves:
        force = np.linspace(0.5, 1.0, 8)
        (found,) = replayed.simulate([Setting(setting(replayed).base, {}, (name, force))])
        assert np.abs(found - plain).max() > 1e-3, name


def test_regimes_have_a_value_in_every_block(replayed):
    found = replayed.regimes()
    assert {"speed", "yaw_rate", "acceleration", "time", "reversal", "wheel_angle_1"} <= set(found)
    for _, values in found.values():
        assert len(values) == len(replayed.measured)


@pytest.mark.slow
def test_a_candidate_run_is_predicted_by_its_own_model_and_missed_by_its_rival(replayed):
    (spin,) = (e for e in replayed.candidate_experiments() if e.name == "spin_slow_0_natural_stone")
    (ahead,) = (e for e in replayed.candidate_experiments() if e.name == "ahead_fast_0_natural_stone")
    same = setting(replayed)
    loaded = setting(replayed, {"payload": np.array([2.0, 0.0, 0.0])})
    gyro = setting(replayed, {"yaw_rate_scale": np.array([1.1])})
    for experiment, rival, channel in ((ahead, loaded, 1), (spin, gyro, YAW_RATE)):
        first, again, other = replayed.predict([same, same, rival], experiment)
        assert np.array_equal(first, again)
        assert np.sqrt(((other - first)[:, channel] ** 2).mean()) > 0.01


def test_rows_of_rollers_change_sides_every_half_pitch_and_do_no_work():
    found = roller_tables(ROBOT)
    place, torque = found[:2]
    half = POINTS // 2
    assert place[0] == pytest.approx(ROBOT.wheel.row_offset)
    assert place[half:] == pytest.approx(-place[:half], abs=1e-12)
    assert torque.mean() == pytest.approx(0.0, abs=1e-9)
    assert abs(torque).max() > 1e-4


def test_a_body_on_stiff_springs_does_not_lean():
    stiff = dataclasses.replace(ROBOT, body=dataclasses.replace(ROBOT.body, suspension_stiffness=1e9))
    assert max(lean_shares(stiff)) < 1e-6
    assert lean_shares(ROBOT) == pytest.approx((0.0226, 0.0226), rel=0.02)


def test_rollers_explain_the_twin_and_what_is_left_is_the_stated_roughness():
    replay = replay_of(columns_of({}, seed=6, plant="twin"))
    at = setting(replay)
    flat = replay.measured - replay.simulate([at])[0]
    rolling = replay.measured - replay.simulate_twin(at)
    rms = [np.sqrt(np.nanmean(m**2, axis=0)) for m in (flat, rolling)]
    assert (rms[1][CURRENTS] < 0.9 * rms[0][CURRENTS]).all()
    assert rms[1][YAW_RATE] < 0.7 * rms[0][YAW_RATE]
    stated = np.hypot(neighbour_noise(replay, rolling), [c.equation_error for c in replay.channels])
    assert (rms[1] < 1.4 * stated).all()


def test_a_run_on_an_unknown_floor_is_refused(healthy):
    with pytest.raises(UnknownNameError, match="sand"):
        RobotReplay(dataset(healthy, floor="sand"), ROBOT, FLOORS)


def test_a_log_that_is_too_short_is_refused(healthy):
    short = {name: values[:100] for name, values in healthy.items()}
    with pytest.raises(InputError, match="long enough"):
        replay_of(short)
