"""Laws of single effects; the rig's equations are integrated afresh beside the fixed step."""

import dataclasses
import math

import numpy as np
import pytest
from driven_plants import RIG, ROBOT, STONE, rig_run, robot_run
from hypothesis import given
from hypothesis import strategies as st
from rig_reference import SMOOTHING, rates
from scipy.integrate import solve_ivp

from omnimj.effects import apply_effects, with_effects
from omnimj.errors import InputError
from omnimj.physics import effect_terms as terms_of
from omnimj.physics.effect_terms import (
    KNOTS,
    TERM,
    AxleTorque,
    Backlash,
    curve_force,
    mark_active,
    mean_ripple,
    step_backlash,
    terms_at,
    traction_scale,
    write_curve,
    zero_terms,
)
from omnimj.physics.motor import motor_parameters
from omnimj.physics.rig import RigModel, RigState, rig_parameters, step

MASS = RIG.rig.masses[0]
INERTIA = RIG.wheel.inertia + RIG.motor.reflected_inertia
RATIO = RIG.motor.gear_ratio


def sign(speed):
    return math.tanh(speed / SMOOTHING)


# force on the carriage (t, x, v, φ, φ̇), torque on the wheel, written afresh
FORCES = {
    "rail_coulomb": ({"force": 1.0}, lambda t, x, v, a, w: -1.0 * sign(v)),
    "rail_viscous": ({"coefficient": 1.5}, lambda t, x, v, a, w: -1.5 * v),
    "rail_stribeck": (
        {"force": 1.5, "velocity": 0.2},
        lambda t, x, v, a, w: -1.5 * math.exp(-((v / 0.2) ** 2)) * sign(v),
    ),
    "rail_position": (
        {"force": 4.0, "position": 0.3, "width": 0.05},
        lambda t, x, v, a, w: -4.0 * math.exp(-0.5 * ((x - 0.3) / 0.05) ** 2) * sign(v),
    ),
    "cable_drag": ({"stiffness": 5.0, "rest_position": 0.2}, lambda t, x, v, a, w: -5.0 * (x - 0.2)),
    "air_drag": ({"coefficient": 2.0}, lambda t, x, v, a, w: -2.0 * v * abs(v)),
    "roller_ripple": ({"amplitude": 2.0}, lambda t, x, v, a, w: 2.0 * math.sin(18.0 * a)),
}
TORQUES = {
    "bearing_friction": (
        {"torque": 0.03, "viscous": 0.001},
        lambda t, x, v, a, w: -0.03 * sign(RIG.wheel.radius * w) - 0.001 * w,
    ),
    "gear_loss": ({"viscous": 0.002}, lambda t, x, v, a, w: -0.002 * w),
    "motor_cogging": (
        {"amplitude": 0.004, "poles": 2.0},
        lambda t, x, v, a, w: 0.004 * RATIO * math.sin(2.0 * RATIO * a),
    ),
}


def integrated(force, torque, current, duration):
    """Carriage speed every millisecond with one more force and torque."""

    def change(t, y):
        derivative, _ = rates(RIG, STONE, MASS, current, 0.0, y[:4])
        derivative[0] += force(t, y[4], y[0], y[5], y[1]) / MASS
        derivative[1] += torque(t, y[4], y[0], y[5], y[1]) / INERTIA
        return [*derivative, y[0], y[1]]

    time = np.arange(1, round(duration * 1000) + 1) * 1e-3
    found = solve_ivp(
        change, (0.0, duration), np.zeros(6), "LSODA", t_eval=time, rtol=1e-8, atol=1e-8, max_step=2e-3
    )
    return found.y[0]


def nothing(*_):
    return 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", [*FORCES, *TORQUES])
def test_an_added_force_moves_the_rig_as_an_adaptive_integrator_computes(name, measured):
    values, law = {**FORCES, **TORQUES}[name]
    force, torque = (law, nothing) if name in FORCES else (nothing, law)
    stepped = rig_run(with_effects(RIG, {name: values}), "planar", 800, 0.0, np.full(800, 0.9))[:, 2]
    plain = rig_run(RIG, "planar", 800, 0.0, np.full(800, 0.9))[:, 2]
    # what the step alone is off drops out
    mine = stepped - plain
    theirs = integrated(force, torque, 0.9, 0.8) - integrated(nothing, nothing, 0.9, 0.8)
    off = float(np.sqrt(np.mean((mine - theirs) ** 2)))
    measured(f"{name}: change of carriage speed, fixed step less integrator [m/s]", off, 1e-3)
    assert np.abs(theirs).max() > 2e-3
    assert off <= 1e-3


def test_a_grade_is_felt_by_speed_and_accelerometer():
    slope = 0.02
    for kind in ("twin", "planar"):
        uphill, flat = (
            rig_run(with_effects(RIG, {"grade": {"slope": s}}), kind, 700, 0.0, np.full(700, 1.2))
            for s in (slope, 0.0)
        )
        assert uphill[-1, 2] < flat[-1, 2] - 0.02
        at_rest = rig_run(with_effects(RIG, {"grade": {"slope": slope}}), kind, 1500, 0.0, np.zeros(1500))
        # the bristles give way by a millimetre, then friction holds it, and the accelerometer reads the slope
        assert abs(at_rest[-1, 2]) < 2e-4
        assert at_rest[-1, 3] == pytest.approx(9.81 * math.sin(slope), abs=0.01)


def test_a_sagging_supply_lowers_the_top_speed_by_its_resistance():
    # at the limit i = (V − K ω)/(R + R_s)
    sag = 3.0
    for kind in ("twin", "planar"):
        found = rig_run(
            with_effects(RIG, {"supply_sag": {"resistance": sag}}), kind, 1000, 0.0, np.full(1000, 1.5)
        )
        current, wheel_speed = found[-1, :2]
        emf = RIG.motor.torque_constant * RATIO * wheel_speed
        assert current < 1.4
        assert current == pytest.approx((24.0 - emf) / (RIG.motor.resistance + sag), rel=0.02)


def test_four_motors_share_a_sagging_supply_without_oscillation():
    sag = 5.0
    machine = with_effects(ROBOT, {"supply_sag": {"resistance": sag}})
    for kind in ("twin", "planar"):
        found = robot_run(machine, kind, 700, np.full((700, 4), 1.5))  # turning on the spot
        current, wheel_speed = found[500:, :4], found[500:, 4:8]
        emf = ROBOT.motor.torque_constant * RATIO * wheel_speed
        left = 24.0 - sag * np.abs(current).sum(axis=1, keepdims=True)
        assert np.abs(np.diff(current, axis=0)).max() < 0.02
        limited = current < 1.49
        assert limited.any()
        expected = (left - emf) / ROBOT.motor.resistance
        assert np.abs(current - expected)[limited].max() < 0.03


def test_a_measured_current_is_cut_by_no_limit():
    for kind in ("twin", "planar"):
        rig = rig_run(RIG, kind, 300, 0.0, np.full(300, 3.0), measured_current=True)
        assert np.allclose(rig[1:, 0], 3.0)
        assert rig[-1, 2] > 1.2 * rig_run(RIG, kind, 300, 0.0, np.full(300, 3.0))[-1, 2]
        robot = robot_run(ROBOT, kind, 100, np.full((100, 4), 2.5), measured_current=True)
        assert np.allclose(robot[1:, :4], 2.5)


def test_a_late_channel_repeats_its_earlier_values():
    plain = rig_run(RIG, "planar", 300)
    for delay, steps in ((0.02, 20.0), (0.0125, 12.5)):
        late = with_effects(RIG, {"sensor_delay": {"channel": "carriage_speed", "delay": delay}})
        found = rig_run(late, "planar", 300)
        at = np.arange(60, 300) - steps
        assert np.allclose(found[60:, 2], np.interp(at, np.arange(300), plain[:, 2]), atol=1e-12)
        assert np.array_equal(found[:, [0, 1, 3]], plain[:, [0, 1, 3]])


def test_two_channels_may_be_late_and_a_sign_stored_wrong():
    machine = with_effects(
        RIG,
        {
            "sensor_delay": {"channel": "current", "delay": 0.01},
            "sensor_delay_2": {"channel": "wheel_speed", "delay": 0.005},
            "carriage_speed_scale": {"scale": -1.0},
        },
    )
    found, plain = rig_run(machine, "planar", 200), rig_run(RIG, "planar", 200)
    assert np.allclose(found[50:, 0], plain[40:-10, 0])
    assert np.allclose(found[50:, 1], plain[45:-5, 1])
    assert np.array_equal(found[:, 2], -plain[:, 2])


def test_a_late_heading_turns_the_short_way_round():
    machine = with_effects(ROBOT, {"sensor_delay": {"channel": "yaw", "delay": 0.0105}})
    found = robot_run(machine, "planar", 700, np.full((700, 4), 0.8))[:, 11]
    plain = robot_run(ROBOT, "planar", 700, np.full((700, 4), 0.8))[:, 11]
    assert found.min() >= 0.0 and found.max() < 2.0 * math.pi
    turned = np.unwrap(plain)
    expected = np.interp(np.arange(100, 700) - 10.5, np.arange(700), turned)
    assert np.allclose(np.exp(1j * found[100:]), np.exp(1j * expected), atol=1e-9)


def test_the_motor_s_encoder_sees_the_play_of_the_gear():
    machine = with_effects(RIG, {"backlash": {"angle": 0.1}})
    currents = np.where(np.arange(400) < 200, 0.8, -0.8)
    for kind in ("twin", "planar"):
        with_it, without = (rig_run(m, kind, 400, 0.0, currents) for m in (machine, RIG))
        # in the gap the rotor turns alone and fast, the carriage hardly notices
        assert np.abs(with_it - without)[200:230, 1].max() > 5.0
        assert np.abs(with_it - without)[200:230, 2].max() < 0.05


@given(
    play=st.floats(-0.02, 0.02), rate=st.floats(-20.0, 20.0), speed=st.floats(-20.0, 20.0),
    torque=st.floats(-0.6, 0.6), other=st.floats(-0.6, 0.6),
)  # fmt: skip
def test_rotor_and_wheel_keep_their_momentum_through_the_gap(play, rate, speed, torque, other):
    gear, h = Backlash(0.04, RIG.motor.reflected_inertia, play, rate), 2.5e-4
    torques = AxleTorque(torque, torque, 0.0, other)
    change, next_play, next_rate, touching = step_backlash(gear, torques, speed, INERTIA, h)
    before = INERTIA * speed + gear.rotor_inertia * rate
    after = INERTIA * (speed + h * change) + gear.rotor_inertia * next_rate
    assert after - before == pytest.approx(h * (torque + other), abs=1e-12)
    assert abs(next_play) <= 0.02 and (abs(next_play) < 0.02 or next_rate == 0.0)
    assert not touching or next_play == play


@given(
    order=st.floats(0.5, 200.0), angle=st.floats(-10.0, 10.0), speed=st.floats(-60.0, 60.0),
    h=st.floats(1e-4, 1e-2),
)  # fmt: skip
def test_a_ripple_acts_with_its_mean_over_the_step(order, angle, speed, h):
    fine = np.sin(order * (angle + speed * h * (np.arange(4000) + 0.5) / 4000)).mean()
    assert mean_ripple(2.0, order, angle, speed, h) == pytest.approx(2.0 * fine, abs=1e-3)


@pytest.mark.parametrize("over", terms_of.CURVE_VARIABLES)
def test_a_tabulated_force_is_straight_between_its_knots(over):
    rng = np.random.default_rng(3)
    values, rows = rng.normal(size=KNOTS), zero_terms()
    write_curve(rows, over, values, -1.0, 2.0)
    mark_active(rows)
    assert rows[0, terms_of.ACTIVE] == 1.0
    place = terms_of.CURVE_VARIABLES.index(over)
    for x in np.linspace(-3.0, 9.0, 101):
        numbers = np.full(5, 99.0)
        numbers[place] = x
        if over == "wheel_angle":
            knots, table = np.arange(KNOTS + 1) * 2.0 * math.pi / KNOTS, np.append(values, values[0])
            expected = np.interp(x % (2.0 * math.pi), knots, table)
        else:
            expected = np.interp(x, np.linspace(-1.0, 2.0, KNOTS), values)
        assert curve_force(terms_at(rows[0]), *numbers) == pytest.approx(expected, abs=1e-9)


def test_a_tabulated_force_over_position_works_on_the_carriage():
    rows = zero_terms()
    write_curve(rows, "position", [-0.5 * k for k in range(KNOTS)], 0.0, 0.7)
    mark_active(rows)
    motor, terms = motor_parameters(RIG.motor), terms_at(rows[0])
    model, state = RigModel(rig_parameters(RIG), motor, STONE.traction, terms, False), RigState(*[0.0] * 9)
    state, _ = step(state, 0.9, 0.0, model, 2.5e-4, 2400)
    spring = rig_run(
        with_effects(RIG, {"cable_drag": {"stiffness": 5.0}}), "planar", 600, 0.0, np.full(600, 0.9)
    )
    assert state.position < 0.7
    assert state.speed == pytest.approx(spring[-1, 2], abs=1e-9)  # 0.5 N per 0.1 m


def test_a_floor_patch_begins_and_ends_within_a_centimetre():
    rows = zero_terms()
    rows[0, [TERM["patch"], TERM["patch_start"], TERM["patch_end"]]] = -0.6, 0.3, 0.6
    terms = terms_at(rows[0])
    found = [traction_scale(terms, x) for x in (0.0, 0.294, 0.3, 0.306, 0.45, 0.594, 0.6, 0.606, 2.0)]
    assert found == pytest.approx([1.0, 1.0, 0.7, 0.4, 0.4, 0.4, 0.7, 1.0, 1.0])


def test_effects_of_one_kind_add_up_or_are_refused():
    both = with_effects(RIG, {"rail_viscous": {"coefficient": 1.0}, "rail_viscous_2": {"coefficient": 0.5}})
    once = with_effects(RIG, {"rail_viscous": {"coefficient": 1.5}})
    assert np.array_equal(rig_run(both, "planar", 200), rig_run(once, "planar", 200))
    heavy = with_effects(ROBOT, {"payload": {"mass": 2.0, "x": 0.1}, "payload_2": {"mass": 2.0, "x": -0.1}})
    central = with_effects(ROBOT, {"payload": {"mass": 4.0}})
    assert np.allclose(robot_run(heavy, "planar", 200), robot_run(central, "planar", 200))
    with pytest.raises(InputError, match=r"rail_position_2.*it can act once"):
        with_effects(RIG, {"rail_position": {}, "rail_position_2": {"position": 0.1}})


def test_one_weak_motor_acts_on_its_wheel_alone():
    weak = with_effects(ROBOT, {"torque_constant": {"wheel": 2, "scale": 0.5}})
    currents = np.tile([0.0, -0.9, 0.0, 0.9], (300, 1))
    for kind in ("twin", "planar"):
        change = robot_run(weak, kind, 300, currents) - robot_run(ROBOT, kind, 300, currents)
        speed = np.abs(change[:100, 4:8]).max(axis=0)
        assert speed[1] > 3.0 * speed[[0, 2, 3]].max()


def test_rollers_without_friction_and_the_effect_are_the_rollers_with_it():
    bare = dataclasses.replace(
        RIG,
        wheel=dataclasses.replace(RIG.wheel, roller_dry=0.0, roller_viscous=0.0),
        rig=dataclasses.replace(RIG.rig, rail_dry=0.0),
    )
    amounts = {
        "roller_dry": RIG.wheel.roller_dry,
        "roller_viscous": RIG.wheel.roller_viscous,
        "rail_dry": RIG.rig.rail_dry,
    }
    for kind in ("twin", "planar"):
        again = rig_run(with_effects(bare, {"lateral_coupling": amounts}), kind, 300, 0.35)
        assert np.array_equal(again, rig_run(RIG, kind, 300, 0.35))
        assert rig_run(bare, kind, 300, 0.35)[-1, 2] > again[-1, 2] + 0.015


@pytest.mark.parametrize("kind", ["planar", "twin"])
def test_a_gear_that_passes_on_as_much_either_way_brakes_less_and_drives_as_before(kind):
    currents = np.concatenate([np.full(300, 1.2), np.full(200, -0.6)])
    either_way = with_effects(RIG, {"back_driving": {"efficiency": RIG.motor.gear_efficiency**-2}})
    before, after = (rig_run(machine, kind, 500, 0.0, currents)[:, 2] for machine in (RIG, either_way))
    assert np.array_equal(before[:300], after[:300])
    assert after[-1] > before[-1] + 0.01


def test_back_driving_acts_on_what_the_model_file_states_for_its_gear():
    stated = dataclasses.replace(RIG, motor=dataclasses.replace(RIG.motor, back_driving_efficiency=0.5))
    twice = with_effects(stated, {"back_driving": {"efficiency": 0.8}, "back_driving_2": {"efficiency": 0.9}})
    assert 1.0 / apply_effects(twice).machine.motor.driven_gain == pytest.approx(0.5 * 0.8 * 0.9)
