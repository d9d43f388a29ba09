"""Numbers that no wheel or robot can have are refused in one line with the rule."""

import math

import pytest

from omnimj.errors import InputError
from omnimj.wheels import SolverContact, WheeledRobot, mecanum_wheel, omni_wheel, solver_contact, wheel_file

REFUSED = [
    (
        lambda: omni_wheel(rollers=30),
        r"rollers: found 30 in a row; the rollers overlap; .* 4 to 15 in a row fit",
    ),
    (lambda: omni_wheel(rollers=3), r"drop by 1\.3 mm .* 2 % of the radius; at least 4 in a row"),
    (lambda: omni_wheel(rows=1), r"the rollers overlap; .*may be up to 0\.0065 m"),
    (lambda: omni_wheel(rows=0), r"rows: found 0; must be at least 1 and at most 4"),
    (lambda: omni_wheel(rollers=2), r"rollers: found 2; must be at least 3"),
    (lambda: omni_wheel(rollers=9.5), r"rollers: found 9\.5; must be a whole number"),  # pyright: ignore[reportArgumentType]
    (lambda: omni_wheel(roller_radius=0.03), r"roller_radius: found 0\.03; must be .* at most 0\.02 m"),
    (lambda: omni_wheel(roller_radius=0.015), r"with 9 the roller radius may be up to 0\.0\d+ m"),
    (lambda: omni_wheel(row_spacing=0.01), r"row_spacing: found 0\.01; must be at least 0\.018 m, or rows"),
    (lambda: omni_wheel(radius=math.nan), r"radius: found nan"),
    (lambda: omni_wheel(radius=2.0), r"radius: found 2; must be at least 0\.005 and at most 1 m"),
    (lambda: omni_wheel(mass=0.01), r"mass: found 0\.01; must be at least 0\.\d+ kg: the rollers alone"),
    (lambda: mecanum_wheel(rollers=30), r"the rollers overlap"),
    (lambda: mecanum_wheel(rollers=5), r"at least \d+ in a row are needed"),
    (lambda: mecanum_wheel(roller_angle=0.1), r"roller_angle: found 0\.1; must be at least 0\.3491"),
    (lambda: SolverContact(timestep=0.004), r"timestep: found 0\.004 s; must be at most 0\.002 s"),
    (lambda: SolverContact(friction=math.inf), r"friction: found inf"),
    (lambda: WheeledRobot("omni5"), r"unknown layout 'omni5'.*choices: mecanum4, omni3, omni4"),
    (lambda: WheeledRobot("mecanum4"), r"wheel: is of the kind omni; mecanum4 needs mecanum wheels"),
    (lambda: WheeledRobot("omni3", mecanum_wheel()), r"omni3 needs omni wheels"),
    (lambda: WheeledRobot(arm=0.05), r"arm: found 0\.05; must be at least 0\.07"),
    (lambda: WheeledRobot(mass=1.0), r"mass: found 1; must be at least 1\.68"),
    (lambda: WheeledRobot(mass=math.nan), r"mass: found nan"),
    (lambda: WheeledRobot(actuators="servo"), r"unknown actuator 'servo'"),
    (lambda: WheeledRobot(top_speed=0.0), r"top_speed: found 0; must be above 0"),
    (lambda: WheeledRobot("mecanum4", mecanum_wheel(), track=0.02), r"track: found 0\.02"),
    (lambda: WheeledRobot("mecanum4", mecanum_wheel(), wheelbase=0.1), r"wheelbase: found 0\.1"),
    (lambda: wheel_file(omni_wheel(), SolverContact(), load=-1.0), r"load: found -1 kg"),
]


@pytest.mark.parametrize(("make", "message"), REFUSED, ids=[str(k) for k in range(len(REFUSED))])
def test_a_number_out_of_range_is_refused_in_one_line(make, message):
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_every_count_and_radius_that_a_message_offers_is_accepted():
    for rollers in range(4, 16):
        assert omni_wheel(rollers=rollers).roller_half_length > 0.0
    with pytest.raises(InputError):
        omni_wheel(rollers=16)
    assert omni_wheel(rows=1, roller_radius=0.0065).rows == 1


def test_the_contact_of_small_wheels_is_harder_as_far_as_the_step_allows():
    assert solver_contact(0.05) == solver_contact(0.5) == SolverContact()
    assert solver_contact(0.02) == SolverContact(0.002, 0.988)
    assert solver_contact(0.02, timestep=0.002).time_constant == 0.004
    assert solver_contact(0.005, timestep=1e-4) == SolverContact(0.0004, 0.997, timestep=1e-4)


@pytest.mark.parametrize("radius", [0.005, 0.02, 0.1, 0.5, 1.0])
def test_wheels_of_any_size_are_made_in_proportion(radius):
    for make in (omni_wheel, mecanum_wheel):
        wheel, usual = make(radius), make()
        assert wheel.drop / radius == pytest.approx(usual.drop / usual.radius)
        assert wheel.mass / radius**3 == pytest.approx(usual.mass / usual.radius**3)
