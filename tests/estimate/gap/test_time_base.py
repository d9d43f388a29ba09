import numpy as np
import pytest
from healthy_recordings import (
    at_rate_over,
    axis_runs,
    both,
    rig_reversals,
    rig_steps,
    robot_missions,
    scaled,
    spoilt,
    with_time_of_all_samples,
    without,
)
from mentions import mentions
from nightly import checkerboard

from omnimj.estimate.gap.check.acceptance import check_dataset, correct_dataset
from omnimj.estimate.gap.check.time_base import TimeLink, time_base_suspicions
from omnimj.recording.dataset import Run

MACHINES = {
    "rig": rig_steps,
    "robot": robot_missions,
    "axis": axis_runs,
    "axis without velocity": lambda seed: axis_runs(seed, with_velocity=False),
}


def time_base_of(dataset):
    return [s for s in check_dataset(dataset).suspicions if s.kind == "time_base"]


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1e3, 10.0, 1.0 / 60.0, 0.1, 1e6])
@pytest.mark.parametrize("name", MACHINES)
def test_time_in_another_unit_is_the_one_fault_and_is_sure(name, factor):
    (found,) = check_dataset(spoilt(MACHINES[name](0), scaled("time", factor))).suspicions
    assert (found.channel, found.kind, found.is_sure) == ("time", "time_base", True)
    assert found.size == pytest.approx(factor, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "number"), checkerboard(MACHINES, (5, 10)))
def test_another_sampling_rate_is_no_fault_where_rates_fit_their_integrals(name, number):
    dataset = spoilt(MACHINES[name](0), at_rate_over(number))
    assert time_base_of(dataset) == []
    assert not any(s.is_certain for s in check_dataset(dataset).suspicions)


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_milliseconds_at_another_sampling_rate_are_milliseconds(name):
    (found,) = time_base_of(spoilt(MACHINES[name](0), both(at_rate_over(5), scaled("time", 1e3))))
    assert found.is_sure and found.size == 1e3


@pytest.mark.parametrize("recorded", [axis_runs, robot_missions])
def test_a_logger_that_counts_the_rows_that_it_keeps_has_a_wrong_time(recorded):
    (found,) = time_base_of(spoilt(recorded(0), with_time_of_all_samples(10)))
    assert found.is_sure and found.size == pytest.approx(0.1, rel=0.1)


def test_a_unit_of_a_channel_is_not_mistaken_for_one_of_time():
    for recorded, name in ((axis_runs, "position"), (rig_steps, "carriage_speed"), (robot_missions, "yaw")):
        slower = spoilt(recorded(0), both(at_rate_over(10), scaled(name, 1e3 if name != "yaw" else 57.3)))
        assert [s.kind for s in check_dataset(slower).suspicions if s.is_sure] == ["unit"]


@pytest.mark.slow
def test_a_single_run_in_milliseconds_is_named_and_corrected_alone():
    own = rig_steps(0)
    runs = (spoilt(own, scaled("time", 1e3)).runs[1], *own.runs[2:])
    broken = own.__class__(own.path, own.plant, runs)
    (found,) = time_base_of(broken)
    assert found.runs == (runs[0].name,)
    corrected = correct_dataset(broken, check_dataset(broken))
    for run, whole in zip(corrected.runs, own.runs[1:], strict=True):
        np.testing.assert_allclose(run.time, whole.time, rtol=1e-12)
    assert any("divided by 1000" in note for note in corrected.notes)


@pytest.mark.slow
def test_other_channels_are_judged_with_the_corrected_time():
    broken = spoilt(rig_reversals(0), both(scaled("time", 1e3), scaled("carriage_acceleration", -1.0)))
    kinds = [(s.channel, s.kind) for s in check_dataset(broken).suspicions]
    assert kinds == [("time", "time_base"), ("carriage_acceleration", "sign")]


def test_a_time_that_does_not_increase_is_named_with_its_row():
    own = axis_runs(0)
    time = np.array(own.runs[1].time)
    time[700] = time[600]
    broken = own.__class__(
        own.path, own.plant, (own.runs[0], Run("back", {**own.runs[1].columns, "time": time}, {}, {}))
    )
    (found,) = time_base_of(broken)
    assert found.is_sure and found.runs == ("back",)
    assert mentions(found.words, "sample 700", "back")


def resting(step: float) -> list[Run]:
    return [Run("a", {"time": step * np.arange(200.0), "position": np.zeros(200)}, {}, {})]


@pytest.mark.parametrize(
    "step, certain", [(1e-3, None), (2e-3, None), (0.01, False), (1.0, True), (1e3, True), (1e-5, True)]
)
def test_without_motion_the_period_alone_decides_and_a_plausible_one_only_likely(step, certain):
    found = list(time_base_suspicions(resting(step), 1000.0, lambda runs: []))
    assert [s.is_sure for s in found] == ([] if certain is None else [certain])


def test_two_rates_that_share_a_channel_do_not_blame_time_at_the_period_of_the_model():
    links = [TimeLink(("a", "x"), 0.1), TimeLink(("b", "x"), 0.1)]
    assert not list(time_base_suspicions(resting(1e-3), 1000.0, lambda runs: links))
    links = [TimeLink(("a", "x"), 0.1), TimeLink(("b", "y"), 0.1)]
    (found,) = time_base_suspicions(resting(1e-3), 1000.0, lambda runs: links)
    assert found.is_sure and found.size == pytest.approx(10.0)


def test_a_motion_without_velocity_tells_a_wrong_time_by_its_force():
    dataset = spoilt(axis_runs(0), both(without("velocity"), scaled("time", 1e6)))
    (found,) = time_base_of(dataset)
    assert found.size == 1e6
