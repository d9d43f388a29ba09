"""Fault tables read with care, and what faults make of a plant over time."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import read_floors, read_robot
from omnimj.physics.motor import (
    achievable_current,
    drive_torque_bounds,
    motor_parameters,
    stick_or_slip,
    winding_current,
)
from omnimj.plant.faults import FAULT_KINDS, Fault, conditions_at, event_times, fault_record, read_fault
from omnimj.plant.interface import RIG_CHANNELS, robot_channels
from omnimj.plant.sensors import RigSensors, RobotSensors

ROBOT = read_robot()
MOTOR = ROBOT.motor
FLOORS = tuple(read_floors())


def read(table, wheels=4, duration=10.0):
    return read_fault(table, "drive.toml: faults.0", wheels, FLOORS, duration)


def held(*faults, time=1.0):
    return conditions_at(faults, time, MOTOR, 4)


EXAMPLES = (
    {"kind": "motor", "wheel": 1, "loss": 0.57},
    {"kind": "motor", "wheel": 2, "braking_torque": 0.02},
    {"kind": "free", "wheel": 3},
    {"kind": "locked", "wheel": 4},
    {"kind": "hard_over", "wheel": 1, "current": -1.0},
    {"kind": "hard_over", "wheel": 1},
    {"kind": "slip", "wheel": 1, "grip": 0.1},
    {"kind": "slip", "wheel": 1, "floor": "nylon"},
    {"kind": "all_wheel_slip", "grip": 0.0},
    {"kind": "all_wheel_slip", "floor": "oil"},
    {"kind": "misalignment", "wheel": 1, "angle": -0.05},
    {"kind": "wheel_radius", "wheel": 1, "scale": 1.02},
    {"kind": "payload", "mass": 3.0, "x": 0.1, "y": -0.1},
    {"kind": "slope", "angle": 0.05, "direction": 1.0},
    {"kind": "sensor", "channel": "yaw", "mode": "freeze"},
    {"kind": "sensor", "channel": "wheel_speed_4", "mode": "scale", "size": 0.9},
)

# --- reading ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("own", EXAMPLES)
def test_record_of_a_fault_is_its_table(own):
    table = {**own, "onset": 2, "end": 4.5}
    fault = read(table)
    assert fault_record(fault) == {"wheel": None, **table}
    assert pickle.loads(pickle.dumps(fault)) == fault
    json.dumps(fault_record(fault), allow_nan=False)
    assert fault_record(read({**own, "onset": 0}))["end"] is None


def test_every_kind_has_an_example():
    assert {own["kind"] for own in EXAMPLES} == set(FAULT_KINDS)


def test_what_may_be_left_out_gets_its_default():
    assert read({"kind": "payload", "onset": 0, "mass": 2.0}).numbers == {"mass": 2.0, "x": 0.0, "y": 0.0}
    assert read({"kind": "slope", "onset": 0, "angle": 0.1}).numbers == {"angle": 0.1, "direction": 0.0}
    assert read({"kind": "hard_over", "onset": 0, "wheel": 1}).numbers == {}


MOTOR_LOSS = {"kind": "motor", "wheel": 1, "onset": 1.0, "loss": 0.5}
SENSOR = {"kind": "sensor", "channel": "yaw", "mode": "bias", "onset": 1.0, "size": 0.1}
BAD = (
    ({**MOTOR_LOSS, "kind": "moter"}, "unknown kind 'moter'; did you mean 'motor'.*all_wheel_slip, free"),
    ({"wheel": 1, "onset": 1.0}, "'kind' is missing; choices: all_wheel_slip"),
    ({**MOTOR_LOSS, "kind": ["motor"]}, "unknown kind"),
    ({**MOTOR_LOSS, "losss": 0.5}, "unknown key of a 'motor' fault 'losss'; did you mean 'loss'"),
    ({**MOTOR_LOSS, "wheel": 5}, r"faults.0.wheel: found 5; must be at least 1 and at most 4"),
    ({**MOTOR_LOSS, "wheel": 0}, "must be at least 1"),
    ({**MOTOR_LOSS, "wheel": 1.5}, "must be a whole number"),
    ({**MOTOR_LOSS, "wheel": True}, "found True; a number is needed"),
    ({"kind": "free", "onset": 1.0}, "'wheel' is missing"),
    ({"kind": "slope", "onset": 1.0, "angle": 0.1, "wheel": 1}, "unknown key of a 'slope' fault 'wheel'"),
    ({"kind": "free", "wheel": 1}, "'onset' is missing"),
    ({**MOTOR_LOSS, "onset": -0.1}, "onset: found -0.1; must be at least 0 and at most 10"),
    ({**MOTOR_LOSS, "onset": 10.1}, "must be at least 0 and at most 10"),
    ({**MOTOR_LOSS, "onset": float("nan")}, "onset: found nan"),
    ({**MOTOR_LOSS, "onset": 10**400}, r"onset: found 10+…; must be at least 0"),
    ({**MOTOR_LOSS, "end": 1.0}, "end: found 1.0; must be above 1"),
    ({**MOTOR_LOSS, "loss": 0.0}, "loss: found 0.0; must be above 0 and at most 1"),
    ({**MOTOR_LOSS, "loss": 1.01}, "must be above 0 and at most 1"),
    ({**MOTOR_LOSS, "loss": "half"}, "found 'half'; a number is needed"),
    ({**MOTOR_LOSS, "braking_torque": 0.1}, "found loss and braking_torque; exactly one is needed"),
    ({"kind": "motor", "wheel": 1, "onset": 1.0}, "exactly one is needed; choices: braking_torque, loss"),
    ({"kind": "slip", "wheel": 1, "onset": 1.0}, "exactly one is needed; choices: floor, grip"),
    ({"kind": "slip", "wheel": 1, "onset": 1.0, "grip": 1.1}, "grip: found 1.1; must be at least 0"),
    ({"kind": "slip", "wheel": 1, "onset": 1.0, "floor": "nilon"}, "unknown floor 'nilon'.*'nylon'.*choices"),
    ({"kind": "slip", "wheel": 1, "onset": 1.0, "floor": {}}, "unknown floor"),
    ({"kind": "misalignment", "wheel": 1, "onset": 1.0, "angle": 0.6}, "at least -0.5 and at most 0.5"),
    ({"kind": "wheel_radius", "wheel": 1, "onset": 1.0, "scale": 0.4}, "at least 0.5 and at most 2"),
    ({"kind": "payload", "onset": 1.0, "mass": -10.0}, "must be above -10"),
    ({"kind": "payload", "onset": 1.0}, "'mass' is missing"),
    ({**SENSOR, "channel": "current_5"}, "unknown channel 'current_5'.*choices: acceleration_x"),
    ({**SENSOR, "mode": "stuck"}, "unknown mode 'stuck'.*choices: bias, drift, freeze, noise, scale"),
    ({**SENSOR, "mode": "freeze"}, "size: found 0.1; 'freeze' takes no size"),
    ({**SENSOR, "mode": "noise", "size": -1.0}, "size: found -1.0; must be at least 0"),
    ({"kind": "sensor", "channel": "yaw", "mode": "bias", "onset": 1.0}, "'size' is missing"),
    ([MOTOR_LOSS], "a table is needed"),
    (None, "a table is needed"),
)


@pytest.mark.parametrize(("table", "message"), BAD)
def test_bad_table_is_refused_with_place_value_and_rule(table, message):
    with pytest.raises(InputError, match=message) as caught:
        read(table)
    assert str(caught.value).startswith("drive.toml: faults.0")
    assert "\n" not in str(caught.value)


def test_channels_are_those_of_the_plant():
    for channel in RIG_CHANNELS:
        assert read({**SENSOR, "channel": channel}, wheels=1).numbers["channel"] == channel
    for channel in robot_channels(3):
        assert read({**SENSOR, "channel": channel}, wheels=3).numbers["channel"] == channel
    with pytest.raises(UnknownNameError, match="carriage_speed"):
        read(SENSOR, wheels=1)
    with pytest.raises(UnknownNameError):
        read({**SENSOR, "channel": "current_4"}, wheels=3)


@pytest.mark.parametrize("mode", ["bias", "freeze", "drift", "noise", "scale"])
def test_whatever_can_be_read_the_sensors_accept(mode):
    own = {"mode": mode} if mode == "freeze" else {"mode": mode, "size": 0.5}
    for channel in robot_channels(4):
        table = {"kind": "sensor", "onset": 0.0, "channel": channel, **own}
        RobotSensors(ROBOT.sensors, MOTOR, 4, 1e-3, 0, [read(table)])
    table = {"kind": "sensor", "onset": 0.0, "channel": "carriage_speed", **own}
    RigSensors(ROBOT.sensors, MOTOR, 1e-3, 0, [read(table, wheels=1)])


KEYS = sorted(
    {"kind", "wheel", "onset", "end", "weel", *(k for kind in FAULT_KINDS.values() for k in kind.own_keys)}
)
LEAF = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 12),
    st.integers(),
    st.just(10**400),
    st.floats(),
    st.floats(-1, 2),
    st.text(max_size=4),
    st.sampled_from([*FAULT_KINDS, *FLOORS, *robot_channels(4), "bias", "freeze", "noise"]),
    st.lists(st.integers(), max_size=2),
    st.dictionaries(st.text(max_size=2), st.integers(), max_size=1),
)
HOSTILE = st.one_of(LEAF, st.dictionaries(st.sampled_from(KEYS) | st.text(max_size=3), LEAF, max_size=6))
SPOILED = st.tuples(
    st.sampled_from(EXAMPLES), st.dictionaries(st.sampled_from(KEYS), LEAF, max_size=3), st.sampled_from(KEYS)
)


def check(table):
    try:
        fault = read(table)
    except InputError as error:
        assert str(error).startswith("drive.toml: faults.0")
        return
    assert fault.kind in FAULT_KINDS and 0.0 <= fault.onset <= 10.0
    assert fault.end is None or fault.onset < fault.end < np.inf
    assert (fault.wheel is None) != FAULT_KINDS[fault.kind].on_wheel
    # a fault that was read can be applied at any time
    for time in (0.0, fault.onset, 1e6):
        found = conditions_at([fault], time, MOTOR, 4)
        assert np.isfinite(found.motor_rows).all() and found.grip.min() >= 0.0


@settings(max_examples=300, deadline=None)
@given(HOSTILE)
def test_hostile_table_is_a_fault_or_an_input_error(table):
    check(table)


@settings(max_examples=300, deadline=None)
@given(SPOILED)
def test_spoiled_table_is_a_fault_or_an_input_error(parts):
    own, changes, gone = parts
    table = {"onset": 1.0, **own, **changes}
    check(table)
    table.pop(gone, None)
    check(table)


# --- over time ----------------------------------------------------------------------------------------


def test_fault_holds_from_onset_until_before_its_end():
    fault = Fault("free", 1.0, 2.0, 1)
    states = [held(fault, time=t).motors[0].override for t in (0.0, 0.999, 1.0, 1.5, 1.999, 2.0, 3.0)]
    assert states == [0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0]
    assert held(Fault("free", 1.0, None, 1), time=1e9).motors[0].override == 1.0


@pytest.mark.parametrize("steps", [300, 1300])
def test_time_summed_up_from_steps_meets_onset_and_end(steps):
    time, exact = 0.0, steps / 1000
    for _ in range(steps):
        time += 1e-3
    assert time != exact  # 300 steps end late, 1300 early
    assert Fault("free", exact).holds_at(time) and not Fault("free", 0.0, exact).holds_at(time)
    assert not Fault("free", exact).holds_at(time - 1e-3) and Fault("free", 0.0, exact).holds_at(time - 1e-3)


def test_events_are_the_sorted_times_between_which_nothing_changes():
    faults = [
        Fault("slip", 4.0, 6.0, 1, {"grip": 0.1}),
        Fault("motor", 2.0, None, 2, {"loss": 0.5}),
        Fault("slip", 4.0, 5.0, 3, {"grip": 0.2}),
        Fault("sensor", 1.0, 9.0, None, {"channel": "yaw", "mode": "freeze"}),
    ]
    times = event_times(faults)
    assert times == (2.0, 4.0, 5.0, 6.0)
    assert event_times([]) == ()
    for begin, end in zip((0.0, *times), (*times, 20.0), strict=True):
        first, middle, last = (
            conditions_at(faults, t, MOTOR, 4) for t in (begin, (begin + end) / 2, end - 1e-6)
        )
        for other in (middle, last):
            assert np.array_equal(first.grip, other.grip)
            assert np.array_equal(first.motor_rows, other.motor_rows)


def test_without_faults_the_plant_is_healthy_and_arrays_are_fresh():
    healthy = held()
    assert healthy.motors == (motor_parameters(MOTOR),) * 4
    assert np.array_equal(healthy.grip, np.ones(4)) and np.array_equal(healthy.radius_scale, np.ones(4))
    assert np.array_equal(healthy.misalignment, np.zeros(4))
    assert healthy.floors == (None,) * 4
    assert healthy.payload == (0.0, 0.0, 0.0) and healthy.slope == (0.0, 0.0)
    healthy.grip[:] = 0.0
    assert held().grip[0] == 1.0


def test_only_the_faulty_wheel_changes():
    for own in EXAMPLES:
        fault = read({"onset": 0.0, **own})
        if fault.wheel is None:
            continue
        found, healthy, others = held(fault), held(), np.arange(1, 5) != fault.wheel
        for name in ("motor_rows", "grip", "misalignment", "radius_scale"):
            assert np.array_equal(getattr(found, name)[others], getattr(healthy, name)[others])
        assert all(name is None for name, other in zip(found.floors, others, strict=True) if other)


def test_each_kind_sets_its_own_conditions():
    assert held(Fault("motor", 0, None, 2, {"loss": 0.57})).motors[1].torque_scale == pytest.approx(0.43)
    motor = held(Fault("motor", 0, None, 2, {"braking_torque": 0.02})).motors[1]
    assert motor.parallel_torque == pytest.approx(0.02 + MOTOR.no_load_torque)
    motor = held(Fault("hard_over", 0, None, 1)).motors[0]
    assert (motor.override, motor.override_current) == (2.0, MOTOR.current_limit)
    motor = held(Fault("hard_over", 0, None, 1, {"current": -0.7})).motors[0]
    assert (motor.override, motor.override_current) == (2.0, -0.7)
    assert held(Fault("slip", 0, None, 3, {"grip": 0.2})).grip.tolist() == [1.0, 1.0, 0.2, 1.0]
    assert held(Fault("slip", 0, None, 3, {"floor": "nylon"})).floors == (None, None, "nylon", None)
    assert held(Fault("all_wheel_slip", 0, None, None, {"grip": 0.2})).grip.tolist() == [0.2] * 4
    assert held(Fault("all_wheel_slip", 0, None, None, {"floor": "oil"})).floors == ("oil",) * 4
    assert held(Fault("misalignment", 0, None, 1, {"angle": 0.1})).misalignment.tolist() == [0.1, 0, 0, 0]
    assert held(Fault("wheel_radius", 0, None, 4, {"scale": 1.1})).radius_scale.tolist() == [1, 1, 1, 1.1]
    assert held(Fault("payload", 0, numbers={"mass": 2.0, "x": 0.1, "y": 0.2})).payload == (2.0, 0.1, 0.2)
    assert held(Fault("slope", 0, numbers={"angle": 0.1, "direction": 2.0})).slope == (0.1, 2.0)


def test_motor_kernels_act_as_the_faults_state():
    free, over, lost, second, locked = (
        held(Fault(kind, 0, None, 1, numbers)).motors[0]
        for kind, numbers in (
            ("free", {}),
            ("hard_over", {}),
            ("motor", {"loss": 1.0}),
            ("motor", {"braking_torque": 0.01}),
            ("locked", {}),
        )
    )
    assert achievable_current(free, 1.0, 0.0) == 0.0
    assert achievable_current(over, -1.0, 0.0) == MOTOR.current_limit
    low, high = drive_torque_bounds(lost, 1.5, 0.0)
    assert low == pytest.approx(-high)  # only friction is left
    # the second motor takes no more than its two dry torques over K_t
    eaten = 1.5 - winding_current(second, 1.5, 0.0)
    assert eaten == pytest.approx((0.01 + MOTOR.no_load_torque) / MOTOR.torque_constant)
    low, high = drive_torque_bounds(locked, 1.5, 0.0)
    for pull in (-50.0, 50.0):
        assert stick_or_slip(low, high, 0.0, 1e-3, pull, 1e-3) == -pull  # held exactly


def test_faults_at_once_combine():
    two = held(
        Fault("motor", 0.0, None, 1, {"loss": 0.5}),
        Fault("motor", 0.0, None, 1, {"loss": 0.2}),
        Fault("motor", 0.0, None, 1, {"braking_torque": 0.01}),
        Fault("motor", 0.0, None, 1, {"braking_torque": 0.02}),
        Fault("slip", 0.0, None, 1, {"grip": 0.5}),
        Fault("all_wheel_slip", 0.0, None, None, {"grip": 0.4}),
        Fault("misalignment", 0.0, None, 1, {"angle": 0.1}),
        Fault("misalignment", 0.0, None, 1, {"angle": -0.3}),
        Fault("wheel_radius", 0.0, None, 1, {"scale": 1.1}),
        Fault("wheel_radius", 0.0, None, 1, {"scale": 0.9}),
        Fault("locked", 0.0, None, 1),
        Fault("free", 0.0, None, 1),
    )
    motor = two.motors[0]
    assert motor.torque_scale == pytest.approx(0.4)
    assert motor.parallel_torque == pytest.approx(0.03 + MOTOR.no_load_torque)
    assert motor.override == 1.0 and motor.brake > 10.0
    assert two.grip == pytest.approx([0.2, 0.4, 0.4, 0.4])
    assert two.misalignment[0] == pytest.approx(-0.2)
    assert two.radius_scale[0] == pytest.approx(0.99)


@pytest.mark.parametrize("reverse", [False, True])
def test_of_two_that_exclude_each_other_the_latest_wins_and_the_first_comes_back(reverse):
    faults = [
        Fault("free", 1.0, None, 1),
        Fault("hard_over", 2.0, 3.0, 1, {"current": 1.0}),
        Fault("all_wheel_slip", 1.0, None, None, {"floor": "oil"}),
        Fault("slip", 2.0, 3.0, 1, {"floor": "nylon"}),
    ]
    order = faults[::-1] if reverse else faults
    for time, override, floor in ((1.5, 1.0, "oil"), (2.5, 2.0, "nylon"), (3.5, 1.0, "oil")):
        found = held(*order, time=time)
        assert found.motors[0].override == override
        assert found.floors == (floor, "oil", "oil", "oil")
