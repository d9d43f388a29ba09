"""Laws of the planar robot model, smooth and stepped."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from nightly import in_turn
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from smooth_planar import derivative

from omnimj.parameters import WheelMount, read_floors, read_robot
from omnimj.physics.effect_terms import zero_terms
from omnimj.physics.kinematics import rolling_matrix
from omnimj.physics.motor import MotorParameters, drive_torque_bounds, motor_parameters
from omnimj.physics.planar import PlanarModel, output_size, planar_constants, planar_state, state_size, step
from omnimj.physics.planar_wheel import planar_wheel_at
from omnimj.physics.traction import force_ratio, relaxation_rate

ROBOT, N, RESISTANCE = read_robot(), 4, 0.05


def _soft(floor):
    return dataclasses.replace(floor, numbers={**floor.numbers, "rolling_resistance": RESISTANCE})


SHIPPED = read_floors()
SOFT = {f"soft {name}": _soft(SHIPPED[name]) for name in ("natural_stone", "paperboard", "linoleum")}
FLOORS = SHIPPED | SOFT
MOTOR = motor_parameters(ROBOT.motor)
MOTORS = np.tile(np.array(MOTOR), (N, 1))
PLAIN = planar_constants(ROBOT)
BREAKAWAY = ROBOT.motor.no_load_torque / ROBOT.motor.torque_constant
H = 2.5e-4


def _floors(name):
    return np.tile(FLOORS[name].row, (N, 1))


def _model(constants, floors, published=False, motors=MOTORS):
    return PlanarModel(constants.body, constants.wheels, motors, floors, zero_terms(len(floors)), published)


def _normal_forces(constants):
    return np.array([planar_wheel_at(row).normal for row in constants.wheels])


def _gliding():
    """A robot whose rollers have no friction, on wheels without grip."""
    wheel = dataclasses.replace(ROBOT.wheel, roller_dry=0.0, roller_viscous=0.0)
    return dataclasses.replace(ROBOT, wheel=wheel)


def _without_friction():
    """A robot that loses energy to the floor alone."""
    return dataclasses.replace(
        _gliding(),
        bearing=dataclasses.replace(ROBOT.bearing, dry=0.0, viscous=0.0),
        motor=dataclasses.replace(ROBOT.motor, no_load_torque=0.0, viscous=0.0),
    )


def _state(twist=(0.0, 0.0, 0.0), wheel_speed=(0.0,) * N):
    state = np.zeros(state_size(N))
    state[N : 2 * N], state[2 * N : 2 * N + 3] = wheel_speed, twist
    return state


def _stepped(state, command, constants, floors, duration, published=False, h=H, motors=MOTORS):
    """States every millisecond, from the given one on (which is left alone), and the outputs."""
    state, output, each = state.copy(), np.zeros(output_size(N)), round(1e-3 / h)
    states, outputs, model = [state.copy()], [], _model(constants, floors, published, motors)
    for _ in range(round(duration * 1000)):
        step(state, np.asarray(command, float), model, h, each, output)
        states.append(state.copy())
        outputs.append(output.copy())
    return np.array(states), np.array(outputs)


def _integrated(state, command, constants, floors, duration, published=False):
    command = np.asarray(command, float)
    time = np.arange(round(duration * 1000) + 1) * 1e-3
    numbers = (_model(constants, floors, published), 1e-4)
    return solve_ivp(
        lambda _, y: derivative(y, command, *numbers),
        (0.0, time[-1]), state[: 3 * N + 3], method="LSODA", t_eval=time, rtol=1e-9, atol=1e-9,
    ).y.T  # fmt: skip


@pytest.mark.parametrize(
    ("floor", "payload", "published"),
    in_turn(
        ["natural_stone", "pvc", "paperboard", "oil", "nylon", "dry_asphalt", "linoleum", *SOFT],
        [(5.0, 0.1, -0.05), (0.0, 0.0, 0.0)],
        [False, True],
    ),
)
def test_fixed_step_agrees_with_an_adaptive_integrator(floor, payload, published):
    constants = planar_constants(ROBOT, payload=payload)
    for command in ([0.0, -0.9, 0.0, 0.9], [0.4, -0.7, 0.2, 0.9], [-1.5, 1.2, 0.6, -0.3]):
        fixed, _ = _stepped(_state(), command, constants, _floors(floor), 2.0, published)
        exact = _integrated(_state(), command, constants, _floors(floor), 2.0, published)
        difference = fixed[:, : 3 * N + 3] - exact
        rms = np.sqrt(np.mean(difference**2, axis=0))
        assert rms[8:10].max() < 0.005  # m/s
        assert rms[10] < 0.01  # rad/s
        assert rms[4:8].max() * ROBOT.wheel.radius < 0.005  # m/s
        assert rms[11:].max() < 0.01  # A


def test_fixed_step_is_of_first_order():
    # rollers without friction and no wheel near rest: friction there is smoothed in the right-hand side
    command, floors, constants = [0.4, 0.7, 0.2, 0.9], _floors("natural_stone"), planar_constants(_gliding())
    start = _state((0.1, 0.05, -2.0), (9.0, 8.0, 11.0, 12.0))
    exact = _integrated(start, command, constants, floors, 0.3)
    errors = []
    for h in (2.5e-4, 1.25e-4, 6.25e-5):
        fixed, _ = _stepped(start, command, constants, floors, 0.3, h=h)
        errors.append(np.abs(fixed[:, 4:11] - exact[:, 4:11]).max())
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.1)


def test_a_gliding_robot_keeps_its_world_velocity_only_with_coriolis():
    constants = planar_constants(_gliding(), grip=0.0)
    start = _state((1.0, 0.5, 2.0))
    corrected, _ = _stepped(start, [0.0] * N, constants, _floors("pvc"), 2.0)
    yaw = corrected[:, -1]
    assert_allclose(yaw, 2.0 * np.arange(len(yaw)) * 1e-3, atol=1e-9)
    c, s = np.cos(yaw), np.sin(yaw)
    v_x, v_y = corrected[:, 8], corrected[:, 9]
    assert_allclose(c * v_x - s * v_y, 1.0, atol=1e-9)
    assert_allclose(s * v_x + c * v_y, 0.5, atol=1e-9)
    assert_allclose(corrected[-1, -3:-1], [2.0, 1.0], atol=1e-6)
    published, _ = _stepped(start, [0.0] * N, constants, _floors("pvc"), 2.0, published=True)
    assert_allclose(published[-1, 8:10], [1.0, 0.5])  # keeps its body velocity: turns without a force


def test_with_a_payload_the_centre_of_mass_glides_straight():
    constants = planar_constants(_gliding(), grip=0.0, payload=(6.0, 0.1, 0.05))
    com = constants.body[1:3]
    states, _ = _stepped(_state((0.4, -0.2, 3.0)), [0.0] * N, constants, _floors("pvc"), 1.0)
    c, s = np.cos(states[:, -1]), np.sin(states[:, -1])
    x = states[:, -3] + c * com[0] - s * com[1]
    y = states[:, -2] + s * com[0] + c * com[1]
    time = np.arange(len(x)) * 1e-3
    assert_allclose(x - x[0], time * (0.4 - 3.0 * com[1]), atol=1e-6)
    assert_allclose(y - y[0], time * (-0.2 + 3.0 * com[0]), atol=1e-6)


twists = st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-6.0, 6.0))
wheel_speeds = st.tuples(*[st.floats(-30.0, 30.0)] * N)
commands = st.tuples(*[st.floats(-1.5, 1.5)] * N)
bristles = st.tuples(*[st.floats(-0.002, 0.002)] * N)
payloads = st.sampled_from([(0.0, 0.0, 0.0), (4.0, 0.1, -0.1), (-2.0, 0.05, 0.0)])


@pytest.mark.slow
@given(twists, wheel_speeds, bristles, commands, payloads, st.sampled_from(["paperboard", "soft paperboard"]))
def test_power_balance(twist, wheel_speed, z, command, payload, name):
    """dT/dt = Σ T_i φ̇_i − Σ F_i V_r,i − Σ G_i v_lat,i, written afresh."""
    rolling = 0.01
    robot = dataclasses.replace(ROBOT, wheel=dataclasses.replace(ROBOT.wheel, rolling_resistance=rolling))
    constants, floor = planar_constants(robot, payload=payload), FLOORS[name].traction
    state = np.concatenate([z, wheel_speed, twist])
    rates = derivative(state, np.array(command), _model(constants, _floors(name)), 1e-4)
    r, wheel, motor, bearing = ROBOT.wheel.radius, ROBOT.wheel, ROBOT.motor, ROBOT.bearing
    mass, com_x, com_y, inertia = constants.body[:4]
    v_x, v_y, w = twist
    center = np.array([v_x - w * com_y, v_y + w * com_x])
    body = np.array([rates[8] - rates[10] * com_y, rates[9] + rates[10] * com_x])
    axle = wheel.inertia + motor.reflected_inertia
    growth = mass * center @ body + inertia * w * rates[10] + axle * np.dot(wheel_speed, rates[4:8])
    normal = _normal_forces(constants)
    u = ROBOT.drive_directions
    n = np.column_stack([-u[:, 1], u[:, 0]])
    along = rolling_matrix(ROBOT.wheel_positions, u) @ twist
    lateral = rolling_matrix(ROBOT.wheel_positions, n) @ twist
    power = 0.0
    for i in range(N):
        slip = r * wheel_speed[i] - along[i]
        rate = relaxation_rate(floor, slip, 1.0)
        p, u = max(abs(r * wheel_speed[i]), abs(along[i])), lateral[i]
        ahead, aside = (
            floor.rolling_resistance * math.hypot(x, 1e-3) / math.hypot(p, u, 1e-3) for x in (p, u)
        )
        dry = wheel.roller_dry + aside
        g = normal[i] * (dry * math.tanh(u / 1e-4) + wheel.roller_viscous * u)
        power -= normal[i] * force_ratio(floor, z[i], slip, rate) * slip + g * lateral[i]
        f_a = (normal[i] * (bearing.spacing + bearing.overhang) - g * r) / bearing.spacing
        f_b = (normal[i] * bearing.overhang - g * r) / bearing.spacing
        drag = bearing.dry * (abs(f_a) + abs(f_b)) * bearing.pitch_diameter / 2
        drag += (rolling + ahead) * normal[i] * r
        back_emf = motor.torque_constant * motor.gear_ratio * wheel_speed[i]
        high, low = [(volt - back_emf) / motor.resistance for volt in (motor.supply, -motor.supply)]
        forward, backward = drive_torque_bounds(MOTOR, max(low, min(high, command[i])), wheel_speed[i])
        share = 0.5 * (1.0 + math.tanh(r * wheel_speed[i] / 1e-4))
        power += wheel_speed[i] * (share * (forward - drag) + (1.0 - share) * (backward + drag))
    assert growth == pytest.approx(power, rel=1e-9, abs=1e-9)


def _stored(floor, z):
    """Energy of the bristles over F_N [m]."""
    if floor.sigma_0 > 0.0:
        return 0.5 * floor.sigma_0 * z**2
    deepest = floor.relaxation_length * 3.0 * floor.mu / floor.creep_stiffness
    sliding = np.minimum(np.abs(z) / deepest, 1.0)
    return floor.mu * deepest * (sliding - 0.25 * (1.0 - (1.0 - sliding) ** 4))


def _largest_rise(twist, wheel_speed, payload, floor, h):
    """Largest rise of energy in a millisecond, over the energy at the start."""
    constants = planar_constants(ROBOT, payload=payload)
    states, _ = _stepped(_state(twist, wheel_speed), [0.0] * N, constants, _floors(floor), 0.5, h=h)
    mass, com_x, com_y, inertia = constants.body[:4]
    v_x, v_y, w = states[:, 8], states[:, 9], states[:, 10]
    energy = 0.5 * mass * ((v_x - w * com_y) ** 2 + (v_y + w * com_x) ** 2) + 0.5 * inertia * w**2
    axle = ROBOT.wheel.inertia + ROBOT.motor.reflected_inertia
    energy += 0.5 * axle * np.sum(states[:, 4:8] ** 2, axis=1)
    normal = _normal_forces(constants)
    energy += _stored(FLOORS[floor].traction, states[:, :4]) @ normal
    energy += 0.5 * ROBOT.wheel.roller_bristle_stiffness * states[:, 15:19] ** 2 @ normal
    return np.diff(energy).max() / max(energy[0], 1e-3)


@settings(max_examples=25, deadline=None)
@given(twists, wheel_speeds, payloads, st.sampled_from(["natural_stone", "pvc", "paperboard", "nylon"]))
@example((0.0, 0.0, 0.25), (0.0,) * N, (0.0, 0.0, 0.0), "pvc")  # swings back on its bristles
def test_without_current_energy_only_falls(twist, wheel_speed, payload, floor):
    # back-EMF against the supply cannot drive either: 0 A is within reach below 29.6 rad/s
    assert _largest_rise(twist, wheel_speed, payload, floor, H / 2) <= 1e-6
    assert _largest_rise(twist, wheel_speed, payload, floor, H) <= 1e-4  # error of the plant's own step


@settings(max_examples=25, deadline=None)
@given(twists, wheel_speeds, payloads, st.sampled_from([*SOFT, "linoleum"]))
def test_without_current_energy_only_falls_on_soft_floors(twist, wheel_speed, payload, floor):
    assert _largest_rise(twist, wheel_speed, payload, floor, H / 4) <= 1e-5
    assert _largest_rise(twist, wheel_speed, payload, floor, H) <= 1e-3  # error of the plant's own step


@pytest.mark.parametrize("share", [0.9, -0.9])
def test_stiction_holds_below_breakaway(share):
    states, _ = _stepped(_state(), [share * BREAKAWAY] * N, PLAIN, _floors("natural_stone"), 2.0)
    assert np.all(states[:, :11] == 0.0)
    assert np.all(states[:, -3:] == 0.0)


def test_wheels_turn_above_breakaway():
    drag = 0.01 * _normal_forces(PLAIN)[0] * (0.03 + 2 * 0.02) / 0.03 * 0.006  # Eqs. 4.37-4.38 at G = 0
    motor = ROBOT.motor
    breakaway = BREAKAWAY + drag / (motor.gear_ratio * motor.gear_efficiency * motor.torque_constant)
    for share, turns in ((0.999, False), (1.02, True)):
        states, _ = _stepped(_state(), [share * breakaway] * N, PLAIN, _floors("natural_stone"), 2.0)
        assert bool(np.all(states[-1, 4:8] > 0.0)) is turns


def test_a_pushed_robot_stops_and_stays():
    states, outputs = _stepped(_state((0.4, 0.2, 0.5)), [0.0] * N, PLAIN, _floors("natural_stone"), 12.0)
    assert np.abs(states[-1, 8:11]).max() < 1e-6
    assert np.abs(states[-1, -3:] - states[-6000, -3:]).max() < 1e-4
    late = states[-4000:, 8:11]
    assert np.abs(np.diff(late, axis=0)).max() < 1e-6  # no chatter
    assert np.abs(outputs[-1, 16:]).max() < 1e-3


def test_a_robot_stands_on_a_slope_that_friction_holds_and_slides_off_a_steeper_one():
    gentle, steep = 0.005, 0.2
    for angle, moves in ((gentle, False), (steep, True)):
        constants = planar_constants(ROBOT, slope=(angle, 0.3))
        states, _ = _stepped(_state(), [0.0] * N, constants, _floors("natural_stone"), 8.0)
        speed = math.hypot(*states[-1, 8:10])
        assert (speed > 0.05) is moves
        if moves:
            assert states[-1, -3] > 0.1  # downhill is +x
        else:
            assert speed < 1e-6


def test_printed_no_load_torque_moves_a_robot_without_current():
    for published in (False, True):
        states, _ = _stepped(_state(), [0.0] * N, PLAIN, _floors("natural_stone"), 1.0, published)
        assert bool(abs(states[-1, 10]) > 0.1) is published
    quiet = MOTORS.copy()
    quiet[:, MotorParameters._fields.index("no_load_torque")] = 0.0  # it is this torque and nothing else
    states, _ = _stepped(_state(), [0.0] * N, PLAIN, _floors("natural_stone"), 1.0, True, motors=quiet)
    for row in states:
        planar_state(row).clock[:] = 0.0
    assert np.all(states == 0.0)


def test_roller_friction_settles_at_the_printed_force():
    constants = planar_constants(ROBOT)
    _, outputs = _stepped(_state((0.4, 0.0, 0.0)), [0.0] * N, constants, _floors("natural_stone"), 0.01)
    states, _ = _stepped(_state((0.4, 0.0, 0.0)), [0.0] * N, constants, _floors("natural_stone"), 0.009)
    speed = states[-1, 8]
    printed = ROBOT.body.mass * 9.81 / 4 * (0.02 + 0.02 * speed)  # Eq. 3.74
    # axle of wheel 1 points along +x, of wheel 3 along −x
    assert outputs[-1, 12] == pytest.approx(printed, rel=2e-3)
    assert outputs[-1, 14] == pytest.approx(-printed, rel=2e-3)


@settings(max_examples=25, deadline=None)
@given(twists, commands)
def test_a_quarter_turn_of_the_robot_changes_nothing(twist, command):
    """Wheels renumbered by one are the robot turned by −90°: same motion in a turned frame."""
    floors = _floors("pvc")
    a, _ = _stepped(_state(twist), command, PLAIN, floors, 0.2)
    v_x, v_y, w = twist
    b, _ = _stepped(_state((v_y, -v_x, w)), np.roll(command, 1), PLAIN, floors, 0.2)
    assert_allclose(b[-1, 8:11], [a[-1, 9], -a[-1, 8], a[-1, 10]], atol=1e-9)
    assert_allclose(b[-1, 4:8], np.roll(a[-1, 4:8], 1), atol=1e-7)


@settings(max_examples=25, deadline=None)
@given(twists, commands)
def test_a_mirrored_robot_moves_in_the_mirror(twist, command):
    floors = _floors("natural_stone")
    quiet = dataclasses.replace(ROBOT, bearing=dataclasses.replace(ROBOT.bearing, dry=0.0))
    constants = planar_constants(quiet)
    a, _ = _stepped(_state(twist), command, constants, floors, 0.2)
    v_x, v_y, w = twist
    mirrored = -np.array([command[0], command[3], command[2], command[1]])
    b, _ = _stepped(_state((v_x, -v_y, -w)), mirrored, constants, floors, 0.2)
    assert_allclose(b[-1, 8:11], a[-1, 8:11] * [1.0, -1.0, -1.0], atol=1e-9)


def test_three_wheels_at_120_degrees_obey_the_same_equations():
    angles = np.array([0.3, 0.3 + 2 * math.pi / 3, 0.3 + 4 * math.pi / 3])
    mounts = tuple(
        WheelMount(position=(0.2 * math.cos(a), 0.2 * math.sin(a)), drives_along=(-math.sin(a), math.cos(a)))
        for a in angles
    )
    constants = planar_constants(dataclasses.replace(ROBOT, wheels=mounts), payload=(2.0, 0.05, 0.02))
    motors, floors, command = MOTORS[:3], _floors("pvc")[:3], np.array([0.9, -0.6, 0.4])
    assert _normal_forces(constants).sum() == pytest.approx((ROBOT.body.mass + 2.0) * 9.81)
    model = _model(constants, floors, motors=motors)
    numbers = (model, 1e-4)
    exact = solve_ivp(
        lambda _, y: derivative(y, command, *numbers),
        (0.0, 1.0), np.zeros(12), method="LSODA", rtol=1e-9, atol=1e-9,
    ).y[:, -1]  # fmt: skip
    state, output = np.zeros(state_size(3)), np.zeros(output_size(3))
    step(state, command, model, H, 4000, output)
    assert_allclose(state[6:9], exact[6:9], atol=5e-3)
    assert np.abs(exact[6:9]).min() > 0.01


def test_stable_with_wheels_racing_at_any_speed():
    start = _state((1.0, -1.0, 3.0), (300.0, -300.0, 100.0, 0.0))
    for floor in FLOORS:
        states, _ = _stepped(start, [0.0] * N, PLAIN, _floors(floor), 1.0)
        assert np.all(np.isfinite(states))
        assert np.abs(states[-1, 4:8]).max() < 300.0


@pytest.mark.parametrize("floor", ["linoleum", "soft linoleum"])
@pytest.mark.parametrize("direction", [0.0, math.pi / 4.0])
def test_driving_straight_the_wheels_creep_as_traction_balances_the_drag_of_the_rollers(floor, direction):
    along = ROBOT.drive_directions @ (math.cos(direction), math.sin(direction))
    # to the speed at which the supply can drive no more
    states, outputs = _stepped(_state(), 1.5 * np.round(along, 12), PLAIN, _floors(floor), 6.0)
    law, normal = FLOORS[floor].traction, ROBOT.body.mass * 9.81 / 4.0
    speed = math.hypot(*states[-1, 8:10])
    assert speed > 0.3 and np.abs(states[-1, 8:11] - states[-101, 8:11]).max() < 1e-6
    driving = np.abs(along) > 0.1
    u = np.sqrt(1.0 - along**2) * speed  # of every wheel, on its rollers
    rim = np.abs(states[-1, 4:8]) * ROBOT.wheel.radius
    across = law.rolling_resistance * u / np.hypot(np.maximum(rim, np.abs(along) * speed), u)
    drag = normal * (ROBOT.wheel.roller_dry * (u > 0.0) + ROBOT.wheel.roller_viscous * u + across)
    pull = (drag * np.sqrt(1.0 - along**2)).sum() / np.abs(along).sum()
    creep = 3.0 * law.mu / law.creep_stiffness * (1.0 - (1.0 - pull / (normal * law.mu)) ** (1.0 / 3.0))
    slip = np.abs(outputs[-1, :4])[driving]
    assert slip == pytest.approx(creep * np.hypot(rim, u)[driving], rel=0.01)


@pytest.mark.parametrize("direction", [0.0, 0.3, math.pi / 4.0])
@pytest.mark.parametrize("floor", SOFT)
def test_a_robot_without_other_friction_stands_below_the_rolling_resistance_and_rolls_above(floor, direction):
    """In any direction, with the acceleration of a body that turns two wheels' worth of inertia."""
    inertia = ROBOT.wheel.inertia + ROBOT.motor.reflected_inertia
    moved = ROBOT.body.mass / (ROBOT.body.mass + 2.0 * inertia / ROBOT.wheel.radius**2)
    robot = _without_friction()
    motors = np.tile(np.array(motor_parameters(robot.motor)), (N, 1))
    for share in (0.9, 1.3):
        angle = math.atan(share * RESISTANCE)
        constants = planar_constants(robot, slope=(angle, direction))
        states, _ = _stepped(_state(), [0.0] * N, constants, _floors(floor), 4.0, motors=motors)
        speeds = np.hypot(states[:, 8], states[:, 9])
        if share < 1.0:
            assert speeds[-1] < 1e-6 and np.abs(states[-1, -3:] - states[-1001, -3:]).max() < 1e-6
        else:
            gained = (share - 1.0) * RESISTANCE * 9.81 * math.cos(angle) * moved
            assert speeds[-1] - speeds[-1001] == pytest.approx(gained, rel=5e-3)


@pytest.mark.parametrize("direction", [0.0, 0.3, math.pi / 4.0])
def test_a_coasting_robot_is_slowed_by_the_rolling_resistance_in_any_direction(direction):
    c, s = math.cos(direction), math.sin(direction)
    inertia = ROBOT.wheel.inertia + ROBOT.motor.reflected_inertia
    moved = ROBOT.body.mass / (ROBOT.body.mass + 2.0 * inertia / ROBOT.wheel.radius**2)
    robot = _without_friction()
    motors = np.tile(np.array(motor_parameters(robot.motor)), (N, 1))
    turning = tuple(ROBOT.drive_directions @ (c, s) / ROBOT.wheel.radius)
    constants = planar_constants(robot)
    floors = _floors("soft linoleum")
    states, _ = _stepped(_state((c, s, 0.0), turning), [0.0] * N, constants, floors, 1.0, motors=motors)
    speeds = np.hypot(states[:, 8], states[:, 9])
    assert speeds[200] - speeds[1000] == pytest.approx(0.8 * RESISTANCE * 9.81 * moved, rel=5e-3)


@pytest.mark.parametrize("floor", SOFT)
def test_rolling_purely_across_its_rollers_a_robot_loses_the_rolling_resistance_of_their_load(floor):
    """On wheels without grip, those that would drive ahead stand and slide, and those across roll."""
    constants = planar_constants(_gliding(), grip=0.0)
    states, _ = _stepped(_state((1.0, 0.0, 0.0)), [0.0] * N, constants, _floors(floor), 1.0)
    assert np.all(states[:, 4:8] == 0.0)
    lost = states[100, 8] - states[1000, 8]
    assert lost == pytest.approx(0.9 * 0.5 * RESISTANCE * 9.81, rel=1e-4)


@pytest.mark.parametrize("floor", SOFT)
def test_a_wheel_that_only_rolls_along_has_no_side_force(floor):
    command = np.array([0.0, -0.6, 0.0, 0.6])
    states, outputs = _stepped(_state(), command, planar_constants(_gliding()), _floors(floor), 2.0)
    assert states[-1, 8] > 0.3
    normal = ROBOT.body.mass * 9.81 / 4.0
    assert np.abs(outputs[-1, [13, 15]]).max() <= RESISTANCE * normal * 1e-3 / states[-1, 8]
    assert outputs[-1, [12, 14]] == pytest.approx([normal * RESISTANCE, -normal * RESISTANCE], rel=1e-3)


directions = st.tuples(st.floats(0.05, 1.5), st.floats(0.05, 1.5), st.sampled_from([1.0, -1.0]))


@given(directions, st.sampled_from(sorted(SOFT)))
def test_the_force_across_is_to_the_torque_on_the_wheel_as_the_rolling_across_to_that_along(rolling, floor):
    """Of the first wheel, by the difference that rolling resistance makes to the equations."""
    ahead, aside, sign = rolling
    u = ROBOT.drive_directions
    n = np.column_stack([-u[:, 1], u[:, 0]])
    v_x, v_y = ahead * u[0] + sign * aside * n[0]
    turning = u @ (v_x, v_y) / ROBOT.wheel.radius
    state, command = np.concatenate([np.zeros(N), turning, (v_x, v_y, 0.0)]), np.zeros(N)
    constants = planar_constants(_without_friction())
    motors = np.tile(np.array(motor_parameters(_without_friction().motor)), (N, 1))
    without, resisted = (
        derivative(state, command, _model(constants, _floors(name), motors=motors), 1e-4)
        for name in (floor.removeprefix("soft "), floor)
    )
    change = resisted - without
    inertia = ROBOT.wheel.inertia + ROBOT.motor.reflected_inertia
    torque = -inertia * change[N] / (RESISTANCE * ROBOT.wheel.radius * ROBOT.body.mass * 9.81 / 4.0)
    # wheels 1 and 3 roll alike, and so do 2 and 4, whose axles lie along the drive of the first
    across = -ROBOT.body.mass * change[2 * N : 2 * N + 2] @ n[0] * sign
    across /= 2.0 * RESISTANCE * ROBOT.body.mass * 9.81 / 4.0
    assert across / torque == pytest.approx(aside / ahead, rel=2e-3)
    assert math.hypot(across, torque) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("floor", SOFT)
def test_a_finer_step_converges_on_soft_floors(floor):
    start, command = _state((0.3, 0.1, -1.0), (5.0, 4.0, 6.0, 5.0)), [0.4, -0.7, 0.2, 0.9]
    coarse, fine, finest = (
        _stepped(start, command, PLAIN, _floors(floor), 1.0, h=h)[0][:, 8:11] for h in (H, H / 4, H / 16)
    )
    errors = [np.sqrt(np.mean((twists - finest) ** 2)) for twists in (coarse, fine)]
    assert errors[0] < 5e-4
    assert errors[1] < 0.5 * errors[0]
