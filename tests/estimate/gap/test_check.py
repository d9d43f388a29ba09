import numpy as np
import pytest
from healthy_recordings import (
    axis_runs,
    both,
    counted,
    cut_off,
    frozen,
    late,
    rig_reversals,
    rig_steps,
    robot_missions,
    scaled,
    shifted,
    spoilt,
    swapped,
    with_bursts,
    with_repeated_rows,
    with_stale_rows,
)
from mentions import mentions

from omnimj.errors import UnknownNameError
from omnimj.estimate.gap.check.acceptance import check_dataset, correct_dataset
from omnimj.estimate.gap.check.columns import unwrap_counter
from omnimj.estimate.gap.check.compare import Stretch, compare
from omnimj.estimate.gap.check.suspicions import Link, wrong_scales, wrong_signs

HEALTHY = {
    "rig, steps": rig_steps,
    "rig, reversals": rig_reversals,
    "robot": robot_missions,
    "axis": axis_runs,
    "axis at 200 Hz": lambda seed: axis_runs(seed, 200.0),
    "axis without velocity": lambda seed: axis_runs(seed, with_velocity=False),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", HEALTHY)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_healthy_recording_raises_no_suspicion(name, seed):
    assert check_dataset(HEALTHY[name](seed)).suspicions == ()


G = 9.81
CURRENTS = tuple(f"current_{k}" for k in range(1, 5))
WHEELS = tuple(f"wheel_speed_{k}" for k in range(1, 5))
SURE_ONES = [
    (rig_steps, scaled("current", -1.0), "current", "sign", -1.0),
    (rig_steps, scaled("wheel_speed", -1.0), "wheel_speed", "sign", -1.0),
    (rig_steps, scaled("carriage_speed", -1.0), "carriage_speed", "sign", -1.0),
    (rig_reversals, scaled("carriage_acceleration", -1.0), "carriage_acceleration", "sign", -1.0),
    (rig_steps, scaled("carriage_position", -1.0), "carriage_position", "sign", -1.0),
    (rig_steps, scaled("carriage_acceleration", 1.0 / G), "carriage_acceleration", "unit", 1.0 / G),
    (rig_steps, scaled("carriage_speed", 1000.0), "carriage_speed", "unit", 1000.0),
    (rig_steps, scaled("carriage_position", 1000.0), "carriage_position", "unit", 1000.0),
    (rig_steps, scaled("wheel_speed", 30.0 / np.pi), "wheel_speed", "unit", 30.0 / np.pi),
    (rig_steps, scaled("wheel_speed", 20.25), "wheel_speed", "unit", 20.25),
    (rig_steps, late("carriage_speed", 0.020), "carriage_speed", "delay", 0.020),
    (rig_reversals, late("carriage_acceleration", 0.020), "carriage_acceleration", "delay", 0.020),
    (rig_steps, late("wheel_speed", 0.015), "wheel_speed", "delay", 0.015),
    (rig_steps, late("current", 0.015), "current", "delay", 0.015),
    (rig_steps, shifted("current", 0.05), "current", "bias", 0.05),
    (rig_steps, frozen("carriage_acceleration", 100), "carriage_acceleration", "frozen", 100),
    (rig_steps, frozen("wheel_speed", 100), "wheel_speed", "frozen", 100),
    (rig_steps, cut_off("wheel_speed", 20.0), "wheel_speed", "clipping", 20.0),
    (rig_steps, counted("wheel_angle", 2.0 * np.pi), "wheel_angle", "wrap", 2.0 * np.pi),
    (rig_steps, with_bursts("carriage_speed", 1.0), "carriage_speed", "glitch", None),
    (rig_steps, with_repeated_rows(10), "time", "duplicated", None),
    (robot_missions, scaled("current_3", -1.0), "current_3", "sign", -1.0),
    (robot_missions, scaled("wheel_speed_2", -1.0), "wheel_speed_2", "sign", -1.0),
    (robot_missions, scaled("acceleration_x", -1.0), "acceleration_x", "sign", -1.0),
    (robot_missions, scaled("yaw_rate", -1.0), "yaw_rate", "sign", -1.0),
    (robot_missions, scaled("yaw_rate", 180.0 / np.pi), "yaw_rate", "unit", 180.0 / np.pi),
    (robot_missions, scaled("yaw", 180.0 / np.pi), "yaw", "unit", 180.0 / np.pi),
    (robot_missions, scaled("acceleration_x", 1.0 / G), "acceleration_x", "unit", 1.0 / G),
    (robot_missions, swapped("wheel_speed_1", "wheel_speed_2"), "wheel_speed_1", "swapped", 2),
    (robot_missions, swapped("wheel_speed_2", "wheel_speed_4"), "wheel_speed_2", "swapped", 4),
    (robot_missions, swapped("current_3", "current_4"), "current_3", "swapped", 4),
    (robot_missions, late("yaw", 0.04), "yaw", "delay", 0.04),
    (robot_missions, late("yaw_rate", 0.04), "yaw_rate", "delay", 0.04),
    (robot_missions, shifted("yaw_rate", 0.03), "yaw_rate", "bias", 0.03),
    (robot_missions, frozen("yaw_rate", 200), "yaw_rate", "frozen", 200),
    (axis_runs, scaled("force", -1.0), "force", "sign", -1.0),
    (axis_runs, scaled("position", -1.0), "position", "sign", -1.0),
    (axis_runs, scaled("velocity", -1.0), "velocity", "sign", -1.0),
    (axis_runs, scaled("position", 1000.0), "position", "unit", 1000.0),
    (axis_runs, scaled("velocity", 1000.0), "velocity", "unit", 1000.0),
    (axis_runs, late("position", 0.010), "position", "delay", 0.010),
    (axis_runs, late("velocity", 0.010), "velocity", "delay", 0.010),
    (axis_runs, late("force", 0.020), "force", "delay", 0.020),
    (axis_runs, cut_off("force", 150.0), "force", "clipping", 150.0),
    (axis_runs, counted("position", 0.04), "position", "wrap", 0.04),
    (axis_runs, both(scaled("position", 1e3), scaled("velocity", 1e3)), "velocity", "unit", 1e3),
    (axis_runs, scaled("force", 1e-3), "force", "unit", 1e-3),
    (axis_runs, late("force", 0.05), "force", "delay", 0.05),
    (axis_runs, scaled("force", 5.0), "force", "magnitude", 5.0),
    (rig_steps, scaled("current", 1e3), "current", "unit", 1e3),
    (rig_steps, scaled("current", 4.0), "current", "magnitude", 4.0),
    (rig_steps, scaled("wheel_speed", 180.0 / np.pi), "wheel_speed", "unit", 180.0 / np.pi),
    (
        rig_steps,
        both(scaled("carriage_speed", 1e3), scaled("carriage_acceleration", 1e3)),
        "carriage_speed",
        "unit",
        1e3,
    ),
    (rig_steps, late("carriage_speed", 0.05), "carriage_speed", "delay", 0.05),
    (rig_steps, late("current", 0.05), "current", "delay", 0.05),
    (rig_steps, with_stale_rows(60), "time", "stale", 8 * 59),
    (robot_missions, scaled(CURRENTS, 1e3), "current_2", "unit", 1e3),
    (robot_missions, scaled(CURRENTS, -1.0), "current_2", "sign", -1.0),
    (robot_missions, scaled(WHEELS, 30.0 / np.pi), "wheel_speed", "unit", 30.0 / np.pi),
    (robot_missions, scaled(WHEELS, -1.0), "wheel_speed", "sign", -1.0),
    (robot_missions, scaled(("yaw_rate", "yaw"), 180.0 / np.pi), "yaw", "unit", 180.0 / np.pi),
    (robot_missions, scaled(("acceleration_x", "acceleration_y"), -1.0), "acceleration", "sign", -1.0),
    (robot_missions, late("wheel_speed_1", 0.05), "wheel_speed_1", "delay", 0.05),
    (robot_missions, with_stale_rows(60), "time", "stale", 4 * 59),
]


def one_of_each_kind(cases):
    """Cases of which all but the first of each kind of fault on each machine are left to nightly runs."""
    seen = set()
    for case in cases:
        recorded, _, _, kind, _ = case
        repeated = (recorded, kind) in seen
        seen.add((recorded, kind))
        yield pytest.param(*case, marks=[pytest.mark.slow] * repeated)


@pytest.mark.parametrize("recorded, change, channel, kind, size", [*one_of_each_kind(SURE_ONES)])
def test_what_is_spoilt_is_found_for_sure_with_its_size(recorded, change, channel, kind, size):
    found = check_dataset(spoilt(recorded(0), change)).suspicions
    own = [s for s in found if (s.channel, s.kind) == (channel, kind)]
    assert own, [s.words for s in found]
    assert own[0].is_sure
    if size is not None:
        assert abs(own[0].size) == pytest.approx(abs(size), rel=0.15)


def test_a_bias_that_a_slope_explains_as_well_is_never_sure():
    found = check_dataset(spoilt(rig_steps(0), shifted("carriage_acceleration", 0.2))).suspicions
    (bias,) = [s for s in found if s.kind == "bias"]
    assert bias.size == pytest.approx(0.2, abs=0.03)
    assert not bias.is_sure


@pytest.mark.parametrize("factor", [1.1, 1.3])
def test_a_small_factor_between_two_channels_blames_neither_for_sure(factor):
    without_position = spoilt(
        rig_steps(0), lambda c: {n: v for n, v in c.items() if n != "carriage_position"}
    )
    found = check_dataset(spoilt(without_position, scaled("carriage_acceleration", factor))).suspicions
    assert found
    assert all(not s.is_sure for s in found if s.kind == "scale")
    assert {"carriage_acceleration", "carriage_speed"} >= {s.channel for s in found}


def test_a_position_in_millimetres_without_velocity_leaves_the_guide():
    dataset = axis_runs(0, with_velocity=False)
    (found,) = check_dataset(spoilt(dataset, scaled("position", 1000.0))).suspicions
    assert (found.channel, found.size, found.is_sure) == ("position", 1000.0, True)


def test_a_force_with_the_wrong_sign_may_be_a_position_with_the_wrong_sign():
    dataset = axis_runs(0, with_velocity=False)
    (found,) = check_dataset(spoilt(dataset, scaled("force", -1.0))).suspicions
    assert found.kind == "sign"
    assert {found.channel, *found.or_channels} == {"force", "position"}


def test_units_and_counters_are_put_right_and_signs_are_left():
    own = rig_steps(0)
    broken = spoilt(own, scaled("carriage_speed", 1000.0))
    broken = spoilt(broken, counted("wheel_angle", 2.0 * np.pi))
    broken = spoilt(broken, scaled("current", -1.0))
    mended = correct_dataset(broken, check_dataset(broken))
    for before, after in zip(own.runs, mended.runs, strict=True):
        np.testing.assert_allclose(
            after.columns["carriage_speed"], before.columns["carriage_speed"], rtol=1e-9
        )
        turned = before.columns["wheel_angle"] - before.columns["wheel_angle"][0]
        joined = after.columns["wheel_angle"] - after.columns["wheel_angle"][0]
        np.testing.assert_allclose(joined, turned, atol=1e-6)
        np.testing.assert_array_equal(after.columns["current"], -before.columns["current"])
    assert len(mended.notes) == len(own.notes) + 2
    assert [s.kind for s in check_dataset(mended).suspicions] == ["sign"]


def test_a_healthy_dataset_is_left_as_it_is():
    own = rig_steps(0)
    assert correct_dataset(own, check_dataset(own)) == own


def test_a_run_that_is_a_copy_of_another_one_is_reported():
    own = rig_steps(0)
    twice = own.runs[0].__class__("copy", own.runs[0].columns, {}, own.runs[0].conditions)
    check = check_dataset(own.__class__(own.path, own.plant, (*own.runs, twice)))
    (note,) = check.notes
    assert mentions(note, "copy", "run_0")


def test_an_unknown_plant_is_refused():
    own = rig_steps(0)
    with pytest.raises(UnknownNameError, match="quarter_rig"):
        check_dataset(own.__class__(own.path, "crane", own.runs))


@pytest.mark.parametrize("delay", [-0.013, 0.0, 0.021])
@pytest.mark.parametrize("scale", [-2.0, 0.5])
def test_scale_and_delay_of_two_like_signals_are_recovered(delay, scale):
    time = np.linspace(0.0, 2.999, 3000)
    random = np.random.default_rng(0)

    def law(t):
        return np.sin(7.0 * t) + 0.3 * np.sin(31.0 * t + 1.0)

    y = scale * law(time - delay) + 0.2 * time - 1.0 + 0.01 * random.normal(size=3000)
    found = compare([Stretch(time, law(time), y)])
    assert found is not None
    assert found.delay == pytest.approx(delay, abs=3e-4)
    assert found.scale == pytest.approx(scale, rel=0.01)
    assert found.drift == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("culprit", ["a", "b", "c"])
def test_the_channel_that_spoils_all_its_links_is_the_culprit(culprit):
    pairs = [("a", "b"), ("b", "c"), ("a", "c")]
    links = [Link(x, y, -1.0 if culprit in (x, y) else 1.0, 0.1) for x, y in pairs]
    (found,) = wrong_signs(links)
    assert (found.channel, found.or_channels) == (culprit, ())


def test_channels_beyond_reach_are_blamed_rather_than_the_one_that_they_contradict():
    links = [Link("a", "b", 1.0, 0.05), Link("b", "c", 1e-3, 0.7), Link("a", "c", 1e-3, 0.7)]
    (alone,) = wrong_scales(links)
    assert alone.channel == "c"
    found = {s.channel: s.size for s in wrong_scales(links, beyond=("a", "b"))}
    assert found == pytest.approx({"a": 1e3, "b": 1e3})


def test_a_counter_is_joined_to_what_it_counted():
    moved = np.cumsum(0.01 + 0.05 * np.sin(np.arange(2000) / 90.0) ** 2)
    joined = unwrap_counter(np.mod(moved, 2.0 * np.pi))
    np.testing.assert_allclose(np.diff(joined), np.diff(moved), atol=1e-9)
