"""Closed forms of the outline against second routes: sampled surfaces, circles, neighbours in space."""

import math

import numpy as np
import pytest

from omnimj.wheels import mecanum_wheel, omni_wheel
from omnimj.wheels.outline import contact_reach, half_length, hand_over_drop, hub_height, room_between

CASES = [(0.05, 0.009, 90.0), (0.05, 0.005, 45.0), (0.1, 0.02, 60.0), (0.03, 0.004, 135.0), (0.2, 0.03, 30.0)]


def surface(radius, b, angle, cut=1.0, points=801):
    """Points of one roller's surface, lowest at its middle; x ahead, y along the axle."""
    long = half_length(radius, b, angle)
    along, turn = np.meshgrid(np.linspace(-cut, cut, points), np.linspace(0.0, 2.0 * math.pi, points))
    around = b * np.sqrt(1.0 - along**2)
    axial, side, up = long * along, around * np.cos(turn), around * np.sin(turn)
    s, c = math.sin(angle), math.cos(angle)
    return np.stack([axial * s - side * c, axial * c + side * s, up - (radius - b)], axis=-1).reshape(-1, 3)


def turned(points, by):
    """Points turned about the axle."""
    c, s = math.cos(by), math.sin(by)
    return points @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


@pytest.mark.parametrize(("radius", "b", "degrees"), CASES)
def test_the_hub_height_is_that_of_the_lowest_point_of_the_sampled_ellipsoid(radius, b, degrees):
    points = surface(radius, b, math.radians(degrees))
    for turn in (0.0, 0.1, 0.25, 0.4):
        lowest = -turned(points, turn)[:, 2].min()
        assert hub_height(turn, radius, b) == pytest.approx(lowest, abs=2e-5 * radius)


@pytest.mark.parametrize(("radius", "b", "degrees"), CASES)
def test_a_roller_keeps_inside_the_wheel_and_touches_its_cylinder(radius, b, degrees):
    points = surface(radius, b, math.radians(degrees))
    far = np.hypot(points[:, 0], points[:, 2]).max()
    assert far == pytest.approx(radius, rel=1e-4) and far < radius * (1.0 + 1e-12)


@pytest.mark.parametrize(("radius", "b", "degrees"), CASES)
def test_the_outline_leaves_the_wheel_s_circle_with_the_fourth_power_of_the_turn(radius, b, degrees):
    lost = [radius - hub_height(turn, radius, b) for turn in (0.05, 0.1)]
    assert lost[1] / lost[0] == pytest.approx(16.0, rel=0.05)


def test_the_drop_of_the_shipped_wheel_is_25_micrometres():
    assert hand_over_drop(0.05, 0.009, 18) == pytest.approx(24.6e-6, abs=0.05e-6)
    assert omni_wheel().drop == hand_over_drop(0.05, 0.009, 18)


@pytest.mark.parametrize("wheel", [omni_wheel(), omni_wheel(rollers=6, rows=3), mecanum_wheel()])
def test_the_drop_is_that_of_the_lowest_point_of_all_sampled_rollers(wheel):
    points = surface(wheel.radius, wheel.roller_radius, wheel.mounted_angle, points=401)
    step = 2.0 * math.pi / wheel.count
    turns = np.linspace(0.0, step, 41)
    heights = [-min(turned(points, turn - k * step)[:, 2].min() for k in (0, 1)) for turn in turns]
    assert np.argmin(heights) == 20
    assert max(heights) - min(heights) == pytest.approx(wheel.drop, abs=1e-6)


@pytest.mark.parametrize(("radius", "b", "degrees"), CASES)
def test_the_reach_is_where_the_sampled_roller_is_lowest_at_hand_over(radius, b, degrees):
    angle, count = math.radians(degrees), 16
    long, along = half_length(radius, b, angle), np.linspace(-1.0, 1.0, 20001)
    s = math.sin(math.pi / count) * math.sin(angle)
    depth = long * along * s + b * np.sqrt(1.0 - along**2) * math.sqrt(1.0 - s * s)
    assert contact_reach(radius, b, angle, count) == pytest.approx(
        long * along[depth.argmax()], abs=2e-4 * long
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("radius", "b", "degrees", "in_row", "cut"),
    [(0.05, 0.009, 90.0, 9, 0.012), (0.05, 0.005, 45.0, 16, 0.015), (0.05, 0.008, 45.0, 8, 0.02)],
)
def test_the_room_between_rollers_is_the_distance_of_their_sampled_surfaces(radius, b, degrees, in_row, cut):
    from scipy.spatial import cKDTree

    angle = math.radians(degrees)
    part = cut / half_length(radius, b, angle)
    one = surface(radius, b, angle, part, points=201)
    s, c = math.sin(angle), math.cos(angle)
    disc = []  # ends of the cut roller
    for end in (-1.0, 1.0):
        for r in np.linspace(0.0, b * math.sqrt(1.0 - part**2), 30):
            turn = np.linspace(0.0, 2.0 * math.pi, 120)
            side, up = r * np.cos(turn), r * np.sin(turn)
            disc.append(
                np.stack([end * cut * s - side * c, end * cut * c + side * s, up - (radius - b)], axis=-1)
            )
    one = np.concatenate([one, *disc])
    other = turned(one, 2.0 * math.pi / in_row)
    nearest = cKDTree(one).query(other)[0].min()
    assert room_between(radius, b, angle, in_row, cut) == pytest.approx(nearest, abs=0.01 * radius)


def test_mirrored_rollers_have_the_same_outline_and_room():
    wheel = mecanum_wheel()
    other = wheel.mirrored()
    assert other.mounted_angle == pytest.approx(math.pi - wheel.mounted_angle)
    for name in ("drop", "half_length", "roller_half_length", "width", "inertia"):
        assert getattr(other, name) == pytest.approx(getattr(wheel, name), rel=1e-9)


def test_the_stated_cotangent_is_in_the_middle_of_what_the_rollers_show_over_a_turn():
    """By projecting the axis of a turning roller; its cotangents are within 1 ± tan² of a quarter pitch."""
    wheel = mecanum_wheel(rollers=12, roller_radius=0.006, roller_angle=math.radians(40.0))
    s, c = math.sin(wheel.mounted_angle), math.cos(wheel.mounted_angle)
    seen = []
    for turn in np.linspace(-math.pi / wheel.count, math.pi / wheel.count, 201):
        ahead, axial, _ = turned(np.array([[s, c, 0.0]]), turn)[0]
        seen.append(axial / ahead)
    stated, ripple = 1.0 / math.tan(math.radians(40.0)), math.tan(0.5 * math.pi / wheel.count) ** 2
    assert [min(seen), max(seen)] == pytest.approx([stated * (1.0 - ripple), stated * (1.0 + ripple)])


def test_the_inertia_of_a_roller_is_that_of_its_sampled_volume():
    wheel = omni_wheel()
    long, b, cut = wheel.half_length, wheel.roller_radius, wheel.roller_half_length
    rng = np.random.default_rng(0)
    x, y, z = rng.uniform(-1.0, 1.0, (3, 400_000)) * np.array([[cut], [b], [b]])
    inside = (x / long) ** 2 + (y * y + z * z) / b**2 < 1.0
    mass = 1500.0 * 8.0 * cut * b * b * inside.mean()
    spin = mass * (y**2 + z**2)[inside].mean()
    across = mass * (x**2 + y**2)[inside].mean()
    assert wheel.roller_mass == pytest.approx(mass, rel=0.01)
    assert wheel.roller_inertia == pytest.approx((spin, across), rel=0.01)
