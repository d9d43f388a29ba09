"""Gaps and single-sample spikes are found; steps, reversals, noise, counts and standstill are none."""

from __future__ import annotations

import made_datasets as made
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from omnimj.parameters import read_floors, read_rig
from omnimj.plant.interface import RIG_CHANNELS
from omnimj.plant.mujoco.twin import RigTwin
from omnimj.recording.mask import find_gaps, find_spikes
from omnimj.recording.read_dataset import read_dataset
from omnimj.signals import Array
from omnimj.simulate.driving import drive_rig
from omnimj.simulate.suites.rig import samples_on_rail

TIME: Array = np.array(range(1500), float) / 1000.0


def marks(values: Array, time: Array | None = None, angle: bool = False) -> list[int]:
    found = find_spikes([values], [TIME[: len(values)] if time is None else time], angle)[0]
    return np.flatnonzero(found).tolist()


def noise(size: float, seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(0.0, size, len(TIME))


def driven(current: Array, floor: str, lateral_speed: float, seed: int) -> dict[str, Array]:
    """A run of the rig twin with all its sensors, until the rail ends."""
    rig = read_rig()
    trace = drive_rig(RigTwin(rig, read_floors()[floor], lateral_speed=lateral_speed, seed=seed), current)
    rows = samples_on_rail(rig, trace["carriage_position"], trace["lateral_position"])
    return {name: trace[name][:rows] for name in ("time", *RIG_CHANNELS, "current_target")}


@pytest.fixture(scope="module")
def recordings() -> list[dict[str, Array]]:
    """Standstill, a hardly moving carriage, jerks, reversals, coasting; straight and sideways."""
    t: Array = np.array(range(1600), float) / 1000.0
    currents = [
        np.zeros(1600),
        np.full(1600, 0.15),
        np.full(1600, 0.3),
        np.full(1600, 1.5),
        np.where(t % 1.0 < 0.5, 1.2, -1.2),
        np.where(t % 0.06 < 0.03, 1.5, -1.5),
        0.6 * np.sin(8.0 * t),
        np.where(t < 0.5, 1.5, 0.0),
    ]
    cases = [
        (c, f, v) for c in currents for f, v in (("pvc", 0.0), ("natural_stone", 0.2), ("paperboard", -0.35))
    ]
    return [driven(current, floor, speed, seed) for seed, (current, floor, speed) in enumerate(cases)]


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, 2, 10])
def test_recordings_of_the_twin_have_no_spike_at_any_rate(recordings, every):
    for name in (*RIG_CHANNELS, "current_target"):
        # a jerk every 30 ms is nothing but spikes to a logger of 100 Hz
        runs = [run for k, run in enumerate(recordings) if every == 1 or not 15 <= k < 18]
        found = find_spikes([run[name][::every] for run in runs], [run["time"][::every] for run in runs])
        assert not any(one.any() for one in found), name


@pytest.mark.parametrize("name", RIG_CHANNELS)
def test_a_glitch_in_a_recording_is_found_and_nothing_else(recordings, name):
    draws = np.random.default_rng(5)
    values, places = [], []
    recordings = recordings[:15] + recordings[18:]  # among jerks every 30 ms a glitch is one of many
    calm = np.median([np.std(np.diff(run[name])) for run in recordings])
    for run in recordings:
        k = int(draws.integers(5, len(run["time"]) - 5))
        glitched = run[name].copy()
        glitched[k] += 60.0 * calm
        values.append(glitched)
        places.append(k)
    found = find_spikes(values, [run["time"] for run in recordings])
    hits = sum(bool(one[k]) for one, k in zip(found, places, strict=True))
    assert hits == len(places)
    assert sum(int(one.sum()) for one in found) == hits


@given(st.integers(0, 10_000), st.integers(1, len(TIME) - 2), st.sampled_from([-1.0, 1.0]))
@example(seed=805, place=805, sign=1.0)
def test_a_spike_of_twenty_times_the_largest_noise_is_found_wherever_it_is(seed, place, sign):
    values = np.sin(5.0 * TIME) + np.random.default_rng(seed).uniform(-0.01, 0.01, len(TIME))
    values[place] += sign * 0.2
    assert marks(values) == [place]


@pytest.mark.slow
def test_all_but_one_in_a_thousand_spikes_of_twenty_sigma_are_found_and_nothing_else():
    draws, missed = np.random.default_rng(1), 0
    for seed in range(1000):
        values, place = np.sin(5.0 * TIME) + noise(0.01, seed), int(draws.integers(1, len(TIME) - 1))
        values[place] += draws.choice((-0.2, 0.2))
        found = marks(values)
        assert found in ([], [place])
        missed += not found
    assert missed <= 1


@given(st.integers(0, 10_000))
def test_noise_alone_has_no_spike(seed):
    assert not marks(noise(0.01, seed))
    assert not marks(np.rint(noise(1.0, seed)))  # nor when it is quantised
    assert not marks(np.random.default_rng(seed).laplace(size=len(TIME)))


def test_two_spikes_close_together_are_two_spikes():
    values = noise(0.01)
    values[[700, 712]] += 1.0
    assert marks(values) == [700, 712]


@pytest.mark.parametrize(
    "values",
    [
        np.where(TIME < 0.7, 0.0, 1.0),
        np.where(TIME < 0.7, 1.0, -1.0) + noise(0.001),
        np.abs(TIME - 0.7),
        -np.abs(TIME - 0.7) + noise(0.0001),
        np.minimum(np.rint(500.0 * TIME), 350.0) + noise(0.002),
        np.cumsum(np.where((TIME > 0.695) & (TIME <= 0.7), 1.0, 0.0)) + noise(0.01),
        np.exp(-np.clip(TIME - 0.7, 0.0, None) / 0.002) * (TIME >= 0.7),
        np.rint(2.0 * np.sin(9.0 * TIME)),
        np.rint(1000.0 * TIME) % 2,
        np.where(np.arange(1500) % 50 == 7, 1.0, 0.0),
        (np.abs(noise(1.0)) > 2.5).astype(float),
        np.zeros(1500),
        np.full(1500, 1e300),
    ],
)
def test_ordinary_signals_hold_no_spike(values):
    assert not marks(values)


def test_numbers_at_the_edge_of_floating_point_raise_no_warning():
    values = np.zeros(200)
    values[100], values[101] = 1.7e308, -1.7e308
    assert not marks(values)


def test_an_angle_that_wraps_has_no_spike_and_one_that_leaps_has():
    yaw = (0.001 * np.sin(900.0 * TIME)) % (2.0 * np.pi)  # to and fro across zero
    assert not marks(yaw, angle=True)
    yaw[700] = 1.5
    assert marks(yaw, angle=True) == [700]


def test_uneven_time_steps_make_no_spike():
    time = np.cumsum(np.random.default_rng(1).uniform(0.2e-3, 3e-3, 1500))
    assert not marks(3.0 * time + np.sin(time), time)


def test_a_dropped_sample_is_a_gap_and_a_varying_rate_is_none():
    dropped = np.delete(TIME, [300, 600, 601, 602])
    assert find_gaps(dropped).tolist() == [299, 598]
    draws = np.random.default_rng(2)
    assert not len(find_gaps(np.cumsum(draws.uniform(0.5e-3, 1.5e-3, 5000))))
    assert not len(find_gaps(np.cumsum(np.exp(0.3 * draws.normal(size=5000)))))
    assert not len(find_gaps(np.array([k * 2.5 // 1.0 for k in range(500)])))  # 400 Hz, told in whole ms
    assert not len(find_gaps(np.cumsum(np.concatenate((np.full(500, 1e-3), np.geomspace(1e-3, 1e-2, 200))))))


def test_gaps_and_spikes_are_reported_and_marked_and_nothing_is_changed(tmp_path):
    columns = made.rig_columns(400)
    columns["current"][120] += 5.0
    columns = {name: np.delete(values, np.s_[200:240]) for name, values in columns.items()}
    dataset = read_dataset(made.write_rig(tmp_path, a=columns))
    run = dataset.runs[0]
    assert np.flatnonzero(run.masked["current"]).tolist() == [120, 199, 200]
    assert np.flatnonzero(run.masked["wheel_speed"]).tolist() == [199, 200]
    assert "time" not in run.masked
    assert all(run.columns[name].tobytes() == values.tobytes() for name, values in columns.items())
    assert dataset.notes == (
        "run a: a single-sample spike in current masked, at 1.2 s",
        "run a: a gap in time of 0.41 s after 1.99 s (a step is 0.01 s), edges masked",
    )
