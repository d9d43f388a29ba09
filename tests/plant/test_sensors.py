"""The sensor chain: resolution, range, noise, bandwidth, hold, seeds and sensor faults."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from sampled_sensors import sample
from scipy import signal

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import read_robot
from omnimj.plant.faults import Fault
from omnimj.plant.interface import RIG_CHANNELS, robot_channels
from omnimj.plant.sensors import RigSensors, RobotSensors

ROBOT = read_robot()
SENSORS, MOTOR = ROBOT.sensors, ROBOT.motor
PERIOD, TURN = 1e-3, 2.0 * math.pi
CHANNELS = robot_channels(4)
QUIET = replace(
    SENSORS,
    encoder_noise=0.0,
    carriage_encoder_noise=0.0,
    current_noise=0.0,
    accelerometer_noise=0.0,
    accelerometer_bias=0.0,
    gyro_noise=0.0,
    gyro_bias=0.0,
)


def robot(sensors=SENSORS, seed=0, faults=(), ideal=False):
    return RobotSensors(sensors, MOTOR, 4, PERIOD, seed, faults, ideal)


def flat(m):
    return np.concatenate([m.current, m.wheel_speed, m.acceleration, [m.yaw_rate, m.yaw]])


def run(
    sensors: RobotSensors,
    samples: int,
    current: ArrayLike = 0.0,
    speed: ArrayLike = 0.0,
    acceleration: ArrayLike = 0.0,
    yaw_rate: ArrayLike = 0.0,
    heading: ArrayLike = 0.0,
):
    """Readings, shape (samples, 12); every quantity a constant or one number per sample."""
    quantities = (current, speed, acceleration, yaw_rate, heading)
    found = []
    for k, (i, w, a, g, h) in enumerate(zip(*(np.broadcast_to(q, samples) for q in quantities), strict=True)):
        m = sample(sensors, k * PERIOD, np.full(4, i), np.full(4, w), np.full(2, a), g, h)
        found.append(flat(m))
    return np.array(found)


def drive(sensors, samples=400):
    """A lively run in which every channel moves."""
    t = np.arange(samples) * PERIOD
    return run(sensors, samples, np.sin(9 * t), 10 * np.sin(5 * t), np.cos(7 * t), np.sin(3 * t), 2.0 * t)


def fault(channel, mode, size=None, onset=0.1, end=None):
    numbers = {"channel": channel, "mode": mode} | ({} if size is None else {"size": size})
    return Fault("sensor", onset, end, None, numbers)


# --- resolution and range -----------------------------------------------------------------------------


@pytest.mark.parametrize("true", [0.0, 0.0031, -1.234, 4.9])
def test_current_lies_on_the_grid_of_its_monitor_within_half_a_code(true):
    code = 2 * SENSORS.current_monitor_range / 2**12
    read = run(robot(QUIET), 1, current=true)[0, 0]
    assert abs(read - true) <= code / 2 + 1e-12
    assert read / code == pytest.approx(round(read / code), abs=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_every_channel_is_clipped_at_its_range(sign):
    big = 1e6 * sign
    last = run(robot(QUIET), 60, big, big, big, big)[-1]
    code = 0.0 if sign < 0 else 1.0  # two's complement: the top code is one step below full scale
    assert last[0] == sign * 5.0 - code * 10.0 / 2**12
    assert last[4] * MOTOR.gear_ratio == pytest.approx(sign * 838.0 - code * 2 * 838.0 / 2**12)
    assert last[8] == pytest.approx(sign * 98.1 - code * 2 * 98.1 / 2**16)
    assert last[10] == pytest.approx(sign * 6.981 - code * 2 * 6.981 / 2**16)


@pytest.mark.parametrize("speed", [1.0, 5.0, 20.0, -5.0])
def test_mean_speed_is_the_true_speed_and_its_noise_that_of_the_encoder(speed):
    read = run(robot(seed=3), 1200, speed=speed)[200:, 4:8]
    np.testing.assert_allclose(read.mean(axis=0), speed, rtol=0.005)
    # noise and counts through difference, filter and gear; the monitor's own steps on top
    count, a = TURN / SENSORS.encoder_counts, math.exp(-PERIOD / SENSORS.speed_filter)
    angle = math.hypot(SENSORS.encoder_noise, count / math.sqrt(12))
    raw = angle / PERIOD * (1 - a) * math.sqrt(2 / (1 + a))
    expected = math.hypot(raw, 2 * 838.0 / 2**12 / math.sqrt(12)) / MOTOR.gear_ratio
    assert 0.02 < expected < 0.08
    np.testing.assert_allclose(read.std(axis=0), expected, rtol=0.12)


def test_speed_of_a_shaft_follows_the_filter_after_a_step():
    read = run(robot(QUIET), 40, speed=20.0)[:, 4]
    expected = 20.0 * (1 - np.exp(-np.arange(1, 41) * PERIOD / SENSORS.speed_filter))
    count = TURN / SENSORS.encoder_counts / PERIOD / MOTOR.gear_ratio
    np.testing.assert_allclose(read, expected, atol=count)


def test_counted_angle_does_not_drift_from_the_turned_angle():
    t = np.arange(6000) * PERIOD
    speed = 8.0 * np.sin(2.0 * t) + 3.0
    read = run(robot(seed=1), t.size, speed=speed)[:, 4:8]
    turned = speed.sum() * PERIOD
    lag = SENSORS.speed_filter * speed[-1]
    assert np.all(np.abs(read.sum(axis=0) * PERIOD - (turned - lag)) < 0.01)


def test_reversal_takes_up_the_dead_band_before_the_speed_shows():
    band = 10 * SENSORS.encoder_hysteresis
    wide = replace(QUIET, encoder_hysteresis=band, speed_filter=1e-6)
    speed = 0.5  # [rad/s] at the wheel, 0.01 rad of the shaft per sample
    forward, still = 100, 0
    read = run(robot(wide, seed=5), 200, speed=np.r_[np.full(forward, speed), np.full(100, -speed)])[:, 4]
    while read[forward + still] == 0.0:
        still += 1
    count = TURN / SENSORS.encoder_counts
    assert abs(still * speed * PERIOD * MOTOR.gear_ratio - band) <= count + speed * PERIOD * MOTOR.gear_ratio
    lost = -read[forward:].sum() * PERIOD * MOTOR.gear_ratio - 100 * speed * PERIOD * MOTOR.gear_ratio
    assert lost == pytest.approx(-band, abs=2 * count)


def test_encoder_at_rest_is_almost_silent():
    assert np.abs(run(robot(seed=2), 1000)[:, 4:8]).max() < 0.15  # one count, filtered


# --- heading ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [7.0, -7.0])
def test_heading_wraps_and_follows_continuous_rotation_both_ways(rate):
    true = 0.5 + rate * np.arange(2500) * PERIOD
    read = run(robot(), true.size, heading=true)[:, 11]
    assert read.min() >= 0.0 and read.max() < TURN
    renewed = slice(0, None, 5)
    error = np.angle(np.exp(1j * (read[renewed] - true[renewed])))
    assert np.abs(error).max() <= TURN / 2**12 / 2 + 1e-9
    np.testing.assert_allclose(np.unwrap(read), true, atol=abs(rate) * 5 * PERIOD + TURN / 2**12)


@pytest.mark.parametrize("heading", [TURN - 1e-5, -1e-5, -1e-320, TURN, -40 * TURN])
def test_heading_next_to_a_full_turn_reads_zero(heading):
    assert run(robot(), 1, heading=heading)[0, 11] == 0.0
    assert 0.0 <= run(robot(ideal=True), 1, heading=heading)[0, 11] < TURN


def test_heading_is_held_between_its_updates():
    read = run(robot(), 100, heading=np.arange(100) * 0.01)[:, 11].reshape(-1, 5)
    assert np.all(read == read[:, :1])
    assert np.all(np.diff(read[:, 0]) > 0)


@pytest.mark.parametrize(("rate", "expected"), [(300.0, 300), (7.0, 7), (5000.0, 1000)])
def test_heading_is_renewed_at_its_rate_even_if_it_does_not_divide_the_sample_rate(rate, expected):
    read = run(robot(replace(SENSORS, yaw_update_rate=rate)), 1001, heading=np.arange(1001) * 0.005)[:, 11]
    assert np.count_nonzero(np.diff(read)) == expected


# --- noise, bandwidth, bias ---------------------------------------------------------------------------


def test_noise_has_its_rms_on_every_channel():
    read = run(robot(seed=11), 20000)
    code = 10.0 / 2**12
    expected_current = math.hypot(SENSORS.current_noise, code / math.sqrt(12))
    np.testing.assert_allclose(read[:, :4].std(axis=0), expected_current, rtol=0.03)
    np.testing.assert_allclose(read[:, 8:10].std(axis=0), SENSORS.accelerometer_noise, rtol=0.03)
    assert read[:, 10].std() == pytest.approx(SENSORS.gyro_noise, rel=0.03)


def test_noise_of_the_accelerometer_has_the_spectrum_of_its_bandwidth():
    read = run(robot(seed=4), 40000)[:, 8]
    frequency, density = signal.welch(read, 1 / PERIOD, nperseg=1000)
    a = math.exp(-TURN * SENSORS.accelerometer_bandwidth * PERIOD)
    shape = np.abs((1 - a) / (1 - a * np.exp(-1j * TURN * frequency * PERIOD))) ** 2
    white = 2 * PERIOD * SENSORS.accelerometer_noise**2 * (1 + a) / (1 - a)
    for low, high in ((5, 50), (50, 150), (150, 300), (300, 490)):
        band = (frequency >= low) & (frequency < high)
        assert density[band].mean() == pytest.approx((white * shape[band]).mean(), rel=0.06)


@pytest.mark.parametrize(("column", "bandwidth"), [(8, 100.0), (10, 140.0)])
@pytest.mark.parametrize("frequency", [5.0, 20.0])
def test_sine_passes_like_through_the_continuous_first_order_filter(column, bandwidth, frequency):
    t = np.arange(2000) * PERIOD
    sine = np.sin(TURN * frequency * t)
    read = run(robot(QUIET), t.size, acceleration=sine, yaw_rate=sine)[1000:, column]
    gain = 2 * abs(np.mean(read * np.exp(-1j * TURN * frequency * t[1000:])))
    assert gain == pytest.approx(1 / math.hypot(1, frequency / bandwidth), rel=0.01)


def test_bias_is_constant_in_a_run_and_normal_over_seeds():
    calm = replace(QUIET, accelerometer_bias=0.5, gyro_bias=0.2)
    within = run(robot(calm, seed=9), 200)[:, 8:11]
    assert np.all(within == within[0])
    drawn = np.array([run(robot(calm, seed=s), 1)[0, 8:11] for s in range(400)])
    np.testing.assert_allclose(drawn.std(axis=0), [0.5, 0.5, 0.2], rtol=0.1)
    assert np.all(np.abs(drawn.mean(axis=0)) < 3.5 * np.array([0.5, 0.5, 0.2]) / 20)
    assert np.all(np.abs(np.corrcoef(drawn.T) - np.eye(3)) < 0.17)


# --- seeds and independence ---------------------------------------------------------------------------


def test_same_seed_gives_the_same_run_bit_for_bit_and_another_seed_another():
    first, again, other = (drive(robot(seed=s), 1200) for s in (5, 5, 6))
    assert np.array_equal(first, again)
    assert not np.any(np.all(first[:, :11] == other[:, :11], axis=0))


def test_reset_starts_the_same_run_again():
    faults = [fault("yaw_rate", "noise", 0.1), fault("current_1", "freeze")]
    sensors = robot(seed=8, faults=faults)
    assert np.array_equal(drive(sensors), (sensors.reset(), drive(sensors))[1])


def test_reset_clears_what_a_frozen_channel_held():
    sensors = robot(QUIET, faults=[fault("current_1", "freeze", None, 0.0)])
    for amperes in (1.25, 2.5):
        sensors.reset()
        assert run(sensors, 3, current=amperes)[-1, 0] == amperes


def test_two_sets_of_sensors_do_not_share_state():
    alone = drive(robot(seed=1), 50)
    one, two = robot(seed=1), robot(seed=2)
    for k in range(50):
        t = k * PERIOD
        sample(two, t, np.ones(4), np.ones(4), np.ones(2), 1.0, 1.0)
        inputs = (np.sin(9 * t), 10 * np.sin(5 * t), np.cos(7 * t), np.sin(3 * t), 2.0 * t)
        i, w, a, g, h = inputs
        together = flat(sample(one, t, np.full(4, i), np.full(4, w), np.full(2, a), g, h))
        assert np.array_equal(together, alone[k])


def test_noise_of_different_channels_is_uncorrelated():
    noise = run(robot(seed=21), 5000, speed=5.0)[100:, :11]
    assert np.abs(np.corrcoef(noise.T) - np.eye(11)).max() < 0.06


@pytest.mark.parametrize("mode", ["bias", "freeze", "drift", "noise", "scale"])
@pytest.mark.parametrize("channel", ["current_1", "wheel_speed_2", "acceleration_x", "yaw_rate", "yaw"])
def test_fault_on_one_channel_leaves_all_others_bit_identical(channel, mode):
    c = CHANNELS.index(channel)
    healthy = drive(robot(seed=7))
    size = None if mode == "freeze" else 0.3
    faulty = drive(robot(seed=7, faults=[fault(channel, mode, size, 0.1, 0.2)]))
    assert np.array_equal(np.delete(healthy, c, axis=1), np.delete(faulty, c, axis=1))
    assert np.array_equal(healthy[:100, c], faulty[:100, c])
    assert np.array_equal(healthy[200:, c], faulty[200:, c])
    assert np.count_nonzero(healthy[100:200, c] != faulty[100:200, c]) > 90


# --- sensor faults ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "size", "law"),
    [
        ("bias", 0.25, lambda y, t: y + 0.25),
        ("drift", -2.0, lambda y, t: y - 2.0 * (t - 0.1)),
        ("scale", 0.5, lambda y, t: 0.5 * y),
        ("scale", 0.0, lambda y, t: 0.0 * y),
    ],
)
def test_fault_changes_the_healthy_reading_by_its_law_on_its_interval(mode, size, law):
    t = np.arange(400) * PERIOD
    healthy = drive(robot(seed=7))[:, 5]
    faulty = drive(robot(seed=7, faults=[fault("wheel_speed_2", mode, size, 0.1, 0.2)]))[:, 5]
    holds = (np.arange(400) >= 100) & (np.arange(400) < 200)
    np.testing.assert_allclose(faulty, np.where(holds, law(healthy, t), healthy), rtol=0, atol=1e-12)


def test_frozen_channel_holds_its_last_healthy_reading():
    healthy = drive(robot(seed=7))[:, 8]
    frozen = drive(robot(seed=7, faults=[fault("acceleration_x", "freeze", None, 0.1, 0.2)]))[:, 8]
    assert np.all(frozen[100:200] == healthy[99])
    from_start = drive(robot(seed=7, faults=[fault("acceleration_x", "freeze", None, 0.0)]))[:, 8]
    assert np.all(from_start == healthy[0])


def test_noise_fault_adds_its_rms():
    faulty = run(robot(seed=7, faults=[fault("yaw_rate", "noise", 0.5, 0.0)]), 5000)[:, 10]
    healthy = run(robot(seed=7), 5000)[:, 10]
    assert (faulty - healthy).std() == pytest.approx(0.5, rel=0.04)


def test_faults_on_one_channel_act_in_the_order_of_their_onset():
    faults = [fault("current_1", "freeze", None, 0.2), fault("current_1", "bias", 1.0, 0.1)]
    healthy, faulty = drive(robot(seed=7)), drive(robot(seed=7, faults=faults))
    assert np.all(faulty[200:, 0] == healthy[199, 0] + 1.0)


def test_faulty_yaw_is_still_an_angle():
    true = np.arange(3000) * PERIOD * 6.0
    for mode, size in (("bias", 0.7), ("bias", -0.7), ("drift", 3.0), ("scale", 1.7), ("noise", 2.0)):
        read = run(robot(faults=[fault("yaw", mode, size, 0.0)]), true.size, heading=true)[:, 11]
        assert read.min() >= 0.0 and read.max() < TURN


def test_times_summed_up_from_steps_meet_onset_and_end():
    sensors, time, read = robot(QUIET, faults=[fault("current_1", "bias", 1.0, 1.2, 1.5)]), 0.0, []
    for _ in range(2000):
        read.append(sample(sensors, time, np.zeros(4), np.zeros(4), np.zeros(2), 0.0, 0.0).current[0])
        time += PERIOD
    assert np.array_equal(np.flatnonzero(read), np.arange(1200, 1500))


def test_unknown_channel_or_mode_lists_the_choices():
    with pytest.raises(UnknownNameError, match=r"did you mean 'yaw_rate'.*wheel_speed_4"):
        robot(faults=[fault("yawrate", "bias", 1.0)])
    with pytest.raises(UnknownNameError, match=r"mode 'stuck'.*bias, drift, freeze, noise, scale"):
        robot(faults=[fault("yaw", "stuck", 1.0)])
    with pytest.raises(UnknownNameError, match="carriage_speed"):
        RigSensors(SENSORS, MOTOR, PERIOD, 0, [fault("yaw", "bias", 1.0)])


@pytest.mark.parametrize("seed", [-1, 1.5, None, True, "1"])
def test_seed_that_is_not_a_whole_number_is_refused(seed):
    with pytest.raises(InputError, match=r"seed.*whole number of at least 0"):
        robot(seed=seed)


# --- ideal chain, bad numbers, arrays -----------------------------------------------------------------

NUMBER = st.floats(-1e9, 1e9)


@settings(max_examples=60, deadline=None)
@given(*[NUMBER] * 4, st.floats(0.0, TURN, exclude_max=True))
def test_ideal_chain_is_transparent(current, speed, acceleration, yaw_rate, heading):
    truth = [current] * 4 + [speed] * 4 + [acceleration] * 2 + [yaw_rate, heading]
    read = run(robot(ideal=True), 2, current, speed, acceleration, yaw_rate, heading)
    np.testing.assert_array_equal(read, [truth, truth])


def test_ideal_rig_chain_is_transparent_and_its_faults_act():
    sensors = RigSensors(SENSORS, MOTOR, PERIOD, 0, [fault("lateral_speed", "bias", 1.0, 0.5)], ideal=True)
    m = sample(sensors, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
    assert [getattr(m, name) for name in RIG_CHANNELS] == [0.1, 0.2, 0.3, 0.4, 0.5]
    assert sample(sensors, 0.5, 0.1, 0.2, 0.3, 0.4, 0.5).lateral_speed == 1.5


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("ideal", [False, True])
def test_quantity_that_is_not_finite_reads_nan_once_and_spoils_nothing(bad, ideal):
    sensors = robot(seed=1, ideal=ideal)
    assert np.isnan(run(sensors, 1, bad, bad, bad, bad, bad)).all()
    assert np.isfinite(run(sensors, 5, 1.0, 1.0, 1.0, 1.0, 1.0)).all()


def test_one_bad_channel_leaves_the_others_alone():
    good, bad = robot(seed=1), robot(seed=1)
    speeds = np.array([1.0, np.nan, 1.0, 1.0])
    a = flat(sample(good, 0.0, np.ones(4), np.ones(4), np.ones(2), 0.0, 0.0))
    b = flat(sample(bad, 0.0, np.ones(4), speeds, np.ones(2), 0.0, 0.0))
    assert np.array_equal(np.delete(a, 5), np.delete(b, 5)) and np.isnan(b[5])


def test_absurd_but_finite_quantities_give_finite_readings():
    sensors = robot(seed=1)
    assert np.isfinite(run(sensors, 5, 1e308, -1e308, 1e308, -1e308, 1e308)).all()
    recovered = run(sensors, 2000, speed=5.0)[-1000:, 4]
    assert recovered.mean() == pytest.approx(5.0, rel=0.005)


def test_arrays_in_are_not_kept_and_arrays_out_are_fresh():
    sensors = robot(QUIET)
    current, speed = np.zeros(8)[::2], [0, 0, 0, 0]  # strided views and lists are fine
    first = sample(sensors, 0, current, speed, np.zeros(2), 0, 0)
    kept = flat(first).copy()
    current[:] = 3.0
    second = sample(sensors, PERIOD, current, speed, np.zeros(2), 0, 0)
    assert np.array_equal(flat(first), kept)
    for name in ("current", "wheel_speed", "acceleration"):
        assert not np.shares_memory(getattr(first, name), getattr(second, name))
    first.current[:] = 9.0
    assert np.array_equal(second.current, sample(sensors, 0, current, speed, np.zeros(2), 0, 0).current)


# --- rig ----------------------------------------------------------------------------------------------


def rig_run(sensors, samples, **constant):
    truth = dict.fromkeys(RIG_CHANNELS, 0.0) | constant
    found = [sample(sensors, k * PERIOD, *truth.values()) for k in range(samples)]
    return np.array([[getattr(m, name) for name in RIG_CHANNELS] for m in found])


@pytest.mark.parametrize("speed", [0.05, 0.5, 1.43, -0.5])
def test_measuring_wheels_give_the_true_mean_speed_and_millimetres_of_noise(speed):
    read = rig_run(RigSensors(SENSORS, MOTOR, PERIOD, 1), 1200, carriage_speed=speed, lateral_speed=speed)
    for column in (2, 4):
        assert read[200:, column].mean() == pytest.approx(speed, rel=0.005)
        assert 0.001 < read[200:, column].std() < 0.005


def test_rig_channels_are_the_same_chains_as_the_robots():
    sensors = RigSensors(QUIET, MOTOR, PERIOD, 0)
    rig = rig_run(sensors, 300, current=0.777, wheel_speed=12.0, carriage_acceleration=1.5)
    four = run(robot(QUIET), 300, current=0.777, speed=12.0, acceleration=1.5)
    np.testing.assert_array_equal(rig[:, 0], four[:, 0])
    np.testing.assert_array_equal(rig[:, 3], four[:, 8])
    assert rig[100:, 1].mean() == pytest.approx(four[100:, 4].mean(), abs=0.01)


def test_rig_run_is_reproducible():
    sensors = RigSensors(SENSORS, MOTOR, PERIOD, 3)
    first = rig_run(sensors, 600, wheel_speed=3.0)
    sensors.reset()
    assert np.array_equal(first, rig_run(sensors, 600, wheel_speed=3.0))
