"""Every fault shows in the twin by its physics between its onset and its end."""

import math

import numpy as np
import pytest

from omnimj.parameters.floor import find_floor
from omnimj.plant.faults import Fault
from omnimj.plant.ground import Patch
from omnimj.plant.mujoco.twin import RigTwin, RobotTwin
from omnimj.signals import CurrentCommand

AHEAD = np.array([0.0, -0.9, 0.0, 0.9])


def fault(kind, onset=0.0, end=None, wheel=None, **numbers):
    return Fault(kind, onset, end, wheel, numbers)


def drive(robot, faults, current=AHEAD, seconds=0.6, patches=(), floor="natural_stone"):
    """Measurements and truth of a drive with constant currents."""
    twin = RobotTwin(robot, find_floor(floor, "test"), faults=faults, patches=patches, ideal_sensors=True)
    twin.reset()
    command = CurrentCommand(np.asarray(current, float))
    measured, truth = [], []
    for _ in range(round(seconds / twin.period)):
        measured.append(twin.step(command))
        truth.append(twin.truth())
    return measured, np.array(truth)


def mean_traction(truth, first, last):
    return truth[first:last, 14:18].mean(axis=0)


def test_a_motor_loss_takes_its_share_of_traction(robot):
    _, whole = drive(robot, ())
    _, lost = drive(robot, (fault("motor", wheel=4, loss=0.57),))
    healthy, weak = mean_traction(whole, 20, 120)[3], mean_traction(lost, 20, 120)[3]
    m = robot.motor
    share = (0.43 * m.torque_constant * 0.9 - m.no_load_torque) / (m.torque_constant * 0.9 - m.no_load_torque)
    assert weak / healthy == pytest.approx(share, abs=0.06)
    assert mean_traction(lost, 20, 120)[1] == pytest.approx(mean_traction(whole, 20, 120)[1], rel=0.06)


def test_a_second_motor_in_parallel_eats_measured_current(robot):
    measured, truth = drive(robot, (fault("motor", wheel=4, braking_torque=0.004),), seconds=3.0)
    _, whole = drive(robot, (), seconds=3.0)
    assert measured[100].current[3] == pytest.approx(0.9, abs=0.01)
    # at cruise T/K_t of the second motor, (5 + 4) mN.m over 40 mN.m/A, on top of what the wheel needs
    assert measured[-1].current[3] + measured[-1].current[1] == pytest.approx(0.225, abs=0.03)
    assert mean_traction(truth, 60, 160)[3] < 0.8 * mean_traction(whole, 60, 160)[3]


def test_a_free_motor_pulls_no_current_and_a_locked_wheel_does_not_turn(robot):
    measured, _ = drive(robot, (fault("free", wheel=2),))
    assert measured[-1].current[1] == pytest.approx(0.0, abs=1e-9)
    measured, truth = drive(robot, (fault("locked", onset=0.3, wheel=4),))
    assert abs(measured[250].wheel_speed[3]) > 3.0
    # the encoder's speed is filtered; 0.3 s later nothing of it is left
    assert abs(measured[-1].wheel_speed[3]) < 1e-3
    assert truth[330, 9] < -0.1  # it drags: slower than the ground


def test_a_hard_over_motor_runs_without_a_command(robot):
    measured, _ = drive(robot, (fault("hard_over", wheel=1, onset=0.1),), current=np.zeros(4), seconds=0.4)
    assert abs(measured[80].wheel_speed).max() < 1e-3
    assert measured[-1].current[0] > 1.0
    assert measured[-1].wheel_speed[0] > 5.0


@pytest.mark.parametrize("end", [None, 0.2])
def test_slip_by_grip_acts_from_onset_to_end(robot, end):
    _, truth = drive(robot, (fault("slip", 0.1, end, 4, grip=0.1),), seconds=0.4)
    slips = truth[:, 9]
    assert slips[60:95].mean() < 0.2
    assert slips[180] > 0.3
    assert (slips[-1] > 0.3) == (end is None)


def test_a_wheel_on_oil_by_time_equals_a_wheel_on_an_oil_patch(robot):
    _, by_time = drive(robot, (fault("slip", wheel=4, floor="oil"),), seconds=0.15)
    patch = Patch("oil", (0.0, 0.25), (0.3, 0.06))
    _, by_place = drive(robot, (), seconds=0.15, patches=(patch,))
    assert np.allclose(by_time, by_place, atol=1e-9)


def test_all_wheels_on_oil_equal_a_floor_of_oil(robot):
    _, by_fault = drive(robot, (fault("all_wheel_slip", floor="oil"),), seconds=0.3)
    _, by_floor = drive(robot, (), seconds=0.3, floor="oil")
    assert np.allclose(by_fault, by_floor, atol=1e-9)


def test_a_misaligned_axle_turns_the_robot_s_path(robot):
    angle = 0.05
    faults = tuple(fault("misalignment", wheel=i, angle=angle) for i in (2, 4))
    _, truth = drive(robot, faults)
    # the wheels at the sides resist, so that the path turns by less than the axles
    assert 0.2 * angle < math.atan2(truth[-1, 1], truth[-1, 0]) < angle
    faults = tuple(fault("misalignment", wheel=i, angle=angle) for i in (1, 2, 3, 4))
    _, truth = drive(robot, faults)
    assert math.atan2(truth[-1, 1], truth[-1, 0]) == pytest.approx(angle, rel=0.05)


def test_a_larger_wheel_rolls_further_per_turn(robot):
    faults = tuple(fault("wheel_radius", wheel=i, scale=1.04) for i in (1, 2, 3, 4))
    measured, truth = drive(robot, faults, seconds=2.5)
    rolled = truth[-1, 3] / measured[-1].wheel_speed[3]
    assert rolled == pytest.approx(1.04 * robot.wheel.radius, rel=0.006)


def test_payload_adds_weight_where_it_stands(robot):
    _, truth = drive(robot, (fault("payload", mass=3.0, x=0.15, y=0.0),), current=np.zeros(4), seconds=2.0)
    normal = truth[-1, 10:14]
    assert normal.sum() == pytest.approx((robot.body.mass + 3.0) * 9.81, rel=2e-3)
    # moments about the y axis: wheels 1 and 3 stand on their outer rows, 11 mm beyond their mid planes
    arm = 0.25 + robot.wheel.row_offset
    assert (normal[0] - normal[2]) * arm == pytest.approx(3.0 * 9.81 * 0.15, rel=0.04)


def test_a_slope_pulls_a_free_robot_downhill(robot):
    _, truth = drive(
        robot, (fault("slope", angle=0.2, direction=math.pi / 2),), current=np.zeros(4), seconds=1.0
    )
    assert truth[-1, 1] > 0.1
    assert abs(truth[-1, 0]) < 0.01


def test_a_fault_that_ends_leaves_no_trace_in_the_model(robot):
    faults = (
        fault("misalignment", 0.1, 0.2, 1, angle=0.1),
        fault("payload", 0.1, 0.2, mass=2.0, x=0.1, y=0.1),
        fault("wheel_radius", 0.1, 0.2, 3, scale=0.95),
        fault("slope", 0.1, 0.2, angle=0.1, direction=0.0),
        fault("motor", 0.1, 0.2, 2, loss=0.5),
    )
    twin = RobotTwin(robot, find_floor("pvc", "test"), faults=faults)
    twin.reset()
    names = ("body_mass", "body_ipos", "body_inertia", "body_quat", "body_pos", "geom_size", "actuator_user")
    before = {name: getattr(twin.mj_model, name).copy() for name in names}
    gravity = twin.mj_model.opt.gravity.copy()
    changed = False
    for k in range(300):
        twin.step(CurrentCommand(AHEAD))
        changed |= k == 150 and not np.array_equal(before["body_mass"], twin.mj_model.body_mass)
    assert changed
    assert np.array_equal(gravity, twin.mj_model.opt.gravity)
    for name, array in before.items():
        assert np.array_equal(array, getattr(twin.mj_model, name)), name


def test_the_same_seed_gives_the_same_run_and_another_seed_another(robot):
    runs = []
    for seed in (1, 1, 2):
        twin = RobotTwin(robot, find_floor("natural_stone", "test"), seed=seed)
        rows = [twin.reset().wheel_speed]
        rows += [twin.step(CurrentCommand(AHEAD)).wheel_speed for _ in range(200)]
        runs.append(np.array(rows))
    assert np.array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_reset_repeats_the_run_with_its_faults(robot):
    twin = RobotTwin(
        robot, find_floor("pvc", "test"), faults=(fault("motor", 0.05, None, 4, loss=0.8),), seed=3
    )
    runs = []
    for _ in range(2):
        twin.reset()
        runs.append(np.array([twin.step(CurrentCommand(AHEAD)).acceleration for _ in range(150)]))
    assert np.array_equal(*runs)


def test_the_rig_stops_at_the_rail_s_end(rig, floors):
    twin = RigTwin(rig, floors["natural_stone"], ideal_sensors=True)
    twin.reset()
    for _ in range(2500):
        twin.step(CurrentCommand(np.array([1.5])))
    end = rig.rig.rail_length - rig.rig.start_position
    assert twin.truth()[0] == pytest.approx(end, abs=0.02)


def test_nylon_under_the_rig_s_wheel_slips_more_the_higher_the_current(rig, floors):
    slips = []
    for current in (0.45, 0.75, 1.2):
        twin = RigTwin(rig, floors["natural_stone"], faults=(fault("slip", wheel=1, floor="nylon"),))
        twin.reset()
        peak = 0.0
        for _ in range(300):
            twin.step(CurrentCommand(np.array([current])))
            peak = max(peak, twin.truth()[5])
        slips.append(peak)
    assert slips[0] < slips[1] < slips[2]
