"""References: position, velocity and heading belong together, within the limits of the table."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from omnimj.errors import InputError, UnknownNameError
from omnimj.simulate.scenario.drive import DRIVE_KEYS, KINDS, read_drive
from omnimj.simulate.scenario.motion import Trapezoid, chained_distance, directions, fastest_trapezoid

H = 1e-3
POSITIVE = st.floats(0.05, 5.0)


def drive(duration=5.0, period=H, **table):
    return read_drive(table, "drive", duration, period)


def speed_of(reference):
    return np.linalg.norm(reference.velocity, axis=1)


def _cross(a, b):
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def acceleration_of(reference):
    return np.linalg.norm(np.diff(reference.velocity, axis=0), axis=1) / (
        reference.time[1] - reference.time[0]
    )


EXAMPLES = [
    {"kind": "hold", "start": [1.0, 2.0]},
    {"kind": "profile", "speed": "high", "direction": 0.7, "cruise_time": 1.0},
    {"kind": "profile", "speed": 0.8, "distance": 2.0, "yaw_rate": -1.0, "turn": 1.5, "start": [-1.0, 0.5]},
    {"kind": "circle", "diameter": 2.0, "speed": 0.8, "acceleration": 1.2, "start": [0.0, 1.0]},
    {"kind": "circle", "diameter": 8.0, "lap_time": 4.0, "clockwise": False, "start_angle": 1.0},
    {"kind": "square", "side": 1.0, "speed": 1.0},
    {"kind": "square", "side": 6.0, "lap_time": 5.0},
    {"kind": "waypoints", "points": [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], "speed": 1.0, "start_time": 0.3},
]


@pytest.mark.parametrize("table", EXAMPLES, ids=lambda t: t["kind"])
def test_one_sample_per_control_step_from_zero_to_the_end(table):
    r = drive(**table).reference
    np.testing.assert_allclose(r.time, np.arange(5001) * H)
    assert r.velocity.shape == r.position.shape == (5001, 2)
    assert r.yaw_rate.shape == r.heading.shape == (5001,)


@pytest.mark.parametrize("table", EXAMPLES, ids=lambda t: t["kind"])
def test_a_velocity_held_for_one_period_leads_to_the_next_position(table):
    d = drive(**table)
    r = d.reference
    reached = r.position[0] + np.cumsum(r.velocity, axis=0) * H
    np.testing.assert_allclose(reached[:-1], r.position[1:], atol=1e-9)
    np.testing.assert_allclose(r.heading[0] + np.cumsum(r.yaw_rate)[:-1] * H, r.heading[1:], atol=1e-9)
    assert d.start == (*r.position[0], r.heading[0])


def test_circle_is_the_closed_form_at_constant_speed_and_clockwise():
    r = drive(10.0, kind="circle", diameter=8.0, start=[0.0, 4.0], lap_time=10.0).reference
    w = 2.0 * np.pi / 10.0
    expected = 4.0 * np.column_stack([np.sin(w * r.time), np.cos(w * r.time)])
    np.testing.assert_allclose(r.position, expected, atol=1e-9)
    middle = w * (r.time[:-1] + 0.5 * H)
    velocity = 4.0 * w * np.column_stack([np.cos(middle), -np.sin(middle)])
    np.testing.assert_allclose(r.velocity[:-1], velocity, atol=1e-6)
    assert not r.velocity[-1].any() and not r.heading.any()


def test_square_runs_clockwise_from_its_corner_and_back():
    r = drive(26.0, kind="square", side=6.0, speed=2.0, acceleration=1.0).reference
    at = [int(np.argmin(np.linalg.norm(r.position - c, axis=1))) for c in ([-3, -3], [-3, 3], [3, 3])]
    assert at == sorted(at)
    np.testing.assert_allclose(
        r.position[[0, *at, -1]], [[3, -3], [-3, -3], [-3, 3], [3, 3], [3, -3]], atol=1e-6
    )
    assert np.max(speed_of(r)[at]) < 0.01


def test_square_at_constant_speed_takes_its_lap_time():
    r = drive(24.0, kind="square", side=6.0, lap_time=24.0, start=[-3.0, 3.0], clockwise=False).reference
    np.testing.assert_allclose(speed_of(r)[[100, 9000, 23000]], 1.0)
    np.testing.assert_allclose(
        r.position[[0, 6000, 12000, 24000]], [[-3, 3], [-3, -3], [3, -3], [-3, 3]], atol=1e-9
    )


def test_waypoints_are_reached_at_rest_in_order_from_the_start():
    r = drive(
        20.0, kind="waypoints", start=[0, -1], points=[[1, 0], [1, 2], [1, 2], [-1, 2]], speed=0.5
    ).reference
    still = speed_of(r) < 2e-3
    for point in ([0, -1], [1, 0], [1, 2], [-1, 2]):
        assert np.min(np.linalg.norm(r.position[still] - point, axis=1)) < 2e-3
    np.testing.assert_allclose(r.position[-1], [-1, 2], atol=1e-12)


@pytest.mark.parametrize("direction", directions())
def test_profile_drives_in_its_world_direction_whatever_the_heading(direction):
    r = drive(
        4.0, kind="profile", speed="low", direction=float(direction), distance=1.0, heading=0.4
    ).reference
    np.testing.assert_allclose(r.position[-1], [math.cos(direction), math.sin(direction)], atol=1e-9)
    assert speed_of(r).max() == pytest.approx(0.5)
    assert np.all(r.heading == 0.4)


def test_there_are_24_directions_all_different_and_evenly_spaced():
    found = directions()
    assert len(found) == 24 and found[0] == 0.0
    np.testing.assert_allclose(np.diff(found), 2.0 * np.pi / 24)


def test_without_end_a_profile_cruises_to_the_end_of_the_run():
    r = drive(3.0, kind="profile", speed=1.0, acceleration=2.0, start_time=0.5).reference
    assert not r.velocity[:500].any()
    np.testing.assert_allclose(speed_of(r)[1001:], 1.0)


def test_a_turn_on_the_spot_ends_at_its_angle():
    r = drive(5.0, kind="profile", speed=0, yaw_rate=-1.0, turn=1.5).reference
    assert not r.velocity.any()
    assert r.heading[-1] == pytest.approx(-1.5) and r.yaw_rate.min() == pytest.approx(-1.0)


def test_control_loops_are_as_set_in_the_scenario():
    d = drive(kind="hold")
    assert (d.yaw_loop, d.heading_hold, d.heading_feedback) == (True, False, True)
    d = drive(kind="hold", yaw_loop=False, heading_hold=True, heading_feedback=False, heading=1.0)
    assert (d.yaw_loop, d.heading_hold, d.heading_feedback) == (False, True, False)
    assert d.start == (0.0, 0.0, 1.0)


def test_only_paths_are_paths():
    assert [drive(**t).reference.is_path for t in EXAMPLES] == [False] * 3 + [True] * 5


@given(st.floats(0.01, 20.0), POSITIVE, POSITIVE, POSITIVE)
def test_trapezoid_covers_its_distance_within_speed_and_acceleration(distance, speed, up, down):
    motion = fastest_trapezoid(distance, speed, up, down)
    time = np.linspace(0.0, motion.duration, 2001)
    s = motion.distance_at(time)
    step = time[1]
    v = np.diff(s) / step
    a = np.diff(v) / step
    assert s[0] == 0.0 and s[-1] == pytest.approx(distance, rel=1e-9)
    assert v.min() >= -1e-9 * speed and v.max() <= speed * (1.0 + 1e-9)
    assert a.max() <= up * (1.0 + 1e-6) + 1e-9 and a.min() >= -down * (1.0 + 1e-6) - 1e-9
    assert motion.distance_at(np.array([-1.0, motion.duration + 1.0])) == pytest.approx([0.0, distance])


def test_trapezoid_distance_is_the_integral_of_its_speed():
    motion = Trapezoid(1.2, 0.8, 2.0, 0.7)

    def speed(t):
        return max(0.0, min(0.8 * t, 1.2, 2.0 * (motion.duration - t)))

    for t in (0.3, 1.5, 2.0, 2.5, motion.duration):
        area = quad(speed, 0.0, t, points=[p for p in (1.5, 2.2) if p < t])[0]
        assert motion.distance_at(np.array([t]))[0] == pytest.approx(area, abs=1e-9)


def test_motions_follow_each_other_without_a_gap():
    motions = [
        fastest_trapezoid(1.0, 1.0, 1.0, 1.0),
        fastest_trapezoid(0.0, 1.0, 1.0, 1.0),
        fastest_trapezoid(2.0, 0.5, 1.0, 2.0),
    ]
    end = sum(m.duration for m in motions)
    assert chained_distance(motions, np.array([motions[0].duration, end])) == pytest.approx([1.0, 3.0])


@settings(max_examples=40)
@given(st.sampled_from(["square", "waypoints", "profile"]), POSITIVE, POSITIVE, POSITIVE, st.floats(0.1, 3.0))
def test_straight_drives_keep_speed_and_acceleration(kind, speed, up, down, length):
    own = {"side": length} if kind == "square" else {"points": [[0, 0], [length, 1], [0, 2]]}
    own = {"distance": length, "direction": length} if kind == "profile" else own
    r = drive(10.0, 2e-3, kind=kind, speed=speed, acceleration=up, deceleration=down, **own).reference
    assert speed_of(r).max() <= speed * (1.0 + 1e-9)
    # a sample that the end of one leg and the start of the next share still changes by no more
    assert acceleration_of(r).max() <= max(up, down) * (1.0 + 1e-6) + 1e-6


@settings(max_examples=40)
@given(st.floats(0.5, 10.0), st.floats(0.05, 3.0), POSITIVE, st.floats(-4.0, 4.0), st.booleans())
def test_circle_keeps_radius_speed_and_acceleration(diameter, speed, along, angle, clockwise):
    r = drive(
        10.0, 2e-3, kind="circle", diameter=diameter, speed=speed, acceleration=along, start_angle=angle,
        clockwise=clockwise, center=[1.0, -2.0],
    ).reference  # fmt: skip
    np.testing.assert_allclose(np.linalg.norm(r.position - [1.0, -2.0], axis=1), 0.5 * diameter)
    assert speed_of(r).max() <= speed * (1.0 + 1e-9)
    total = math.hypot(along, speed**2 / (0.5 * diameter))
    assert acceleration_of(r).max() <= total * (1.0 + 1e-6) + 1e-6
    turning = _cross(r.position - [1.0, -2.0], r.velocity)
    assert np.all(turning <= 1e-9 if clockwise else turning >= -1e-9)


BAD = [
    ({}, InputError, "drive: 'kind' is missing.*circle, hold, profile, square, waypoints"),
    ({"kind": "elipse"}, UnknownNameError, r"drive\.kind: unknown drive 'elipse'.*circle"),
    ({"kind": ["circle"]}, UnknownNameError, r"drive\.kind: unknown drive"),
    ({"kind": "hold", "speed": 1.0}, UnknownNameError, "key of a hold drive 'speed'.*heading_hold"),
    ({"kind": "circle", "diamter": 8.0}, UnknownNameError, "did you mean 'diameter'"),
    (
        {"kind": "circle", "diameter": -8.0, "speed": 1.0},
        InputError,
        r"drive\.diameter: found -8\.0; .*above 0",
    ),
    ({"kind": "circle", "diameter": 8.0}, InputError, "'speed' or 'lap_time' is missing"),
    (
        {"kind": "circle", "diameter": 8.0, "speed": 1.0, "lap_time": 9.0},
        InputError,
        "both 'lap_time' and 'speed'",
    ),
    (
        {"kind": "circle", "diameter": 8.0, "lap_time": 0.01},
        InputError,
        r"drive\.lap_time: found 0\.01.*at least",
    ),
    (
        {"kind": "circle", "diameter": 8.0, "speed": 1.0, "start": [0, 3]},
        InputError,
        "must lie on the circle, 4 m",
    ),
    (
        {"kind": "circle", "diameter": 8, "speed": 1, "start": [0, 4], "start_angle": 1},
        InputError,
        "both 'start'",
    ),
    ({"kind": "circle", "diameter": 8.0, "speed": 1.0, "laps": 1.5}, InputError, "must be a whole number"),
    ({"kind": "square", "side": 6.0, "speed": 1.0, "start": [0, 0]}, InputError, "must be a corner"),
    ({"kind": "square", "side": 6.0, "speed": 1.0, "clockwise": 1}, InputError, "must be true or false"),
    ({"kind": "profile"}, InputError, "'speed' is missing; a number is needed that must be above 0"),
    ({"kind": "profile", "speed": "fast"}, InputError, r"drive\.speed: found 'fast'.*choices: high, low"),
    ({"kind": "profile", "speed": math.nan}, InputError, r"drive\.speed: found nan"),
    ({"kind": "profile", "speed": True}, InputError, r"drive\.speed: found True"),
    ({"kind": "profile", "speed": 1, "distance": 1, "cruise_time": 1}, InputError, "give one of them"),
    (
        {"kind": "profile", "speed": 1, "yaw_rate": 1, "turn": 1, "yaw_cruise_time": 1},
        InputError,
        "give one of them",
    ),
    ({"kind": "profile", "speed": 1, "start": [1]}, InputError, r"drive\.start: found \[1\]; two numbers"),
    ({"kind": "waypoints", "speed": 1.0}, InputError, r"drive\.points: found None; a list of points"),
    (
        {"kind": "waypoints", "speed": 1.0, "points": [[0, 0], [1, "x"]]},
        InputError,
        r"drive\.points\[1\]\[1\]: found 'x'",
    ),
    ("circle", InputError, "drive: found 'circle'; a table is needed"),
]


@pytest.mark.parametrize(("table", "kind", "message"), BAD, ids=[str(b[0])[:60] for b in BAD])
def test_bad_tables_are_refused_with_place_value_and_choices(table, kind, message):
    with pytest.raises(kind, match=message) as caught:
        read_drive(table, "drive", 5.0, H)
    assert "\n" not in str(caught.value)


VALUES = st.one_of(
    st.floats(),
    st.integers(-3, 20),
    st.booleans(),
    st.text(max_size=4),
    st.none(),
    st.lists(st.floats(), max_size=3),
)


@pytest.mark.slow
@settings(max_examples=300)
@given(st.sampled_from(KINDS), st.dictionaries(st.sampled_from(DRIVE_KEYS), VALUES, max_size=6))
def test_any_table_gives_a_finite_reference_or_one_input_error(kind, table):
    try:
        r = read_drive({**table, "kind": kind}, "drive", 1.0, 0.01).reference
    except InputError as error:
        assert str(error).startswith("drive")
        return
    for values in (r.position, r.velocity, r.heading, r.yaw_rate):
        assert np.all(np.isfinite(values))
