"""Raw numbers to SI and back: gain, sign, offset, filter, wrap, and the hashes of both sides."""

import dataclasses
import hashlib
import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.errors import InputError
from omnimj.link.calibration import (
    Calibration,
    WheelMap,
    calibration_hash,
    canonical_text,
    channel_kinds,
    device_config,
    require_hardware,
    rounded_limits,
    wheel_speed_decoder,
)
from omnimj.link.codec.messages import ChannelKind, Limits, Quantity, Raw
from omnimj.link.device.config import limits_hash
from omnimj.parameters import read_robot
from omnimj.plant.interface import robot_channels
from omnimj.signals import CurrentCommand

WIRING = require_hardware(read_robot())
TURN = 2.0 * math.pi


def rewired(name, **changed):
    """The shipped wiring with one input changed."""
    inputs = tuple(dataclasses.replace(i, **changed) if i.name == name else i for i in WIRING.inputs)
    return dataclasses.replace(WIRING, inputs=inputs)


def on_wire(*outputs):
    """Wheel 1, 2, … at (channel, sign, gain) of a device."""
    found = [
        dataclasses.replace(o, channel=c, sign=s, gain=g, unit="A/A")
        for o, (c, s, g) in zip(WIRING.outputs, outputs, strict=True)
    ]
    return dataclasses.replace(WIRING, outputs=tuple(found))


PERMUTED = on_wire((2, 1, 1.0), (0, -1, 0.5), (3, 1, 2.0), (1, -1, 1.0))


def raw(**volts):
    """All channels at 0 but for these, by name."""
    found = [0.0] * 12
    for name, value in volts.items():
        found[robot_channels(4).index(name)] = value
    return found


def test_a_model_file_without_hardware_is_refused_for_a_wire():
    robot = dataclasses.replace(read_robot(), hardware=None)
    with pytest.raises(
        InputError, match=r"robot\.toml: there is no \[hardware\]; a plant behind a wire needs"
    ):
        require_hardware(robot)


def test_inputs_stand_in_the_order_of_the_robots_channels():
    assert tuple(i.name for i in WIRING.inputs) == robot_channels(4)


def test_every_channel_is_sign_gain_times_raw_less_offset_at_its_place():
    for k, name in enumerate(robot_channels(4)[:11]):
        wiring = rewired(name, sign=-1, gain=0.25, offset=1.5, channel=14)
        found = Calibration(wiring).convert(0.125, [0.0] * 14 + [7.5])
        values = [*found.current, *found.wheel_speed, *found.acceleration, found.yaw_rate, found.yaw]
        assert values[k] == -0.25 * (7.5 - 1.5)
        assert found.time == 0.125
        assert all(value == 0.0 for at, value in enumerate(values) if at != k)


@given(st.floats(-1e6, 1e6))
def test_the_heading_lies_within_one_turn(volts):
    yaw = Calibration(WIRING).convert(0.0, raw(yaw=volts)).yaw
    assert 0.0 <= yaw < TURN
    assert math.cos(yaw - volts * TURN / 10.0) == pytest.approx(1.0, abs=1e-9)


def test_the_end_of_the_turn_is_its_beginning():
    for volts in (10.0, 0.0, -1e-17, math.nextafter(0.0, -1.0)):
        assert Calibration(WIRING).convert(0.0, raw(yaw=volts)).yaw == 0.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", robot_channels(4))
def test_a_reading_that_is_not_finite_is_nan_and_spoils_no_other(name, bad):
    found = Calibration(WIRING).convert(0.0, raw(**{name: bad}))
    values = [*found.current, *found.wheel_speed, *found.acceleration, found.yaw_rate, found.yaw]
    assert [math.isnan(v) for v in values] == [n == name for n in robot_channels(4)]


def test_a_filter_is_of_first_order_over_the_samples_own_times():
    calibration = Calibration(rewired("yaw_rate", filter=0.01, gain=1.0))
    found = []
    for time, volts in ((0.0, 1.0), (0.01, 3.0), (0.01, 9.0), (0.04, math.nan), (0.06, 0.0)):
        found.append(calibration.convert(time, raw(yaw_rate=volts)).yaw_rate)
    second = 1.0 + 2.0 * (1.0 - math.exp(-1.0))
    assert found[:3] == pytest.approx([1.0, second, second])
    assert math.isnan(found[3])
    assert found[4] == pytest.approx(second * math.exp(-2.0))
    calibration.reset()
    assert calibration.convert(0.0, raw(yaw_rate=5.0)).yaw_rate == 5.0


def test_time_that_runs_backwards_leaves_a_filter_where_it_is():
    calibration = Calibration(rewired("yaw_rate", filter=0.01, gain=1.0))
    calibration.convert(1.0, raw(yaw_rate=1.0))
    assert calibration.convert(0.5, raw(yaw_rate=3.0)).yaw_rate == 1.0


def test_a_filtered_heading_goes_the_short_way_round():
    calibration = Calibration(rewired("yaw", filter=0.01, gain=1.0))
    calibration.convert(0.0, raw(yaw=6.2))
    found = calibration.convert(0.01, raw(yaw=0.1)).yaw
    expected = 6.2 + (0.1 + TURN - 6.2) * (1.0 - math.exp(-1.0))
    assert found == pytest.approx(expected % TURN)


def angle_wiring(**changed):
    facts = {"quantity": "wheel_angle", "raw": "counts", "sign": -1, "gain": 0.001, "wrap": 65536.0}
    return rewired("wheel_speed_2", **{**facts, **changed})


@given(
    st.lists(st.tuples(st.integers(-30000, 30000), st.floats(1e-4, 1.0)), max_size=20), st.integers(0, 65535)
)
def test_a_wheel_speed_out_of_a_counter_that_wraps_is_its_difference_over_time(turns, start):
    calibration, count, time = Calibration(angle_wiring()), start, 0.0
    assert calibration.convert(time, raw(wheel_speed_2=start)).wheel_speed[1] == 0.0
    for turned, elapsed in turns:
        count, then = (count + turned) % 65536, time
        time += elapsed
        found = calibration.convert(time, raw(wheel_speed_2=count)).wheel_speed[1]
        assert found == pytest.approx(-0.001 * turned / (time - then), rel=1e-12)


def test_a_counter_of_32_bits_wraps_from_its_largest_to_its_smallest_number():
    calibration = Calibration(angle_wiring(wrap=2.0**32, sign=1))
    calibration.convert(0.0, raw(wheel_speed_2=2.0**31 - 10))
    assert calibration.convert(0.5, raw(wheel_speed_2=-(2.0**31) + 10)).wheel_speed[1] == 0.001 * 20 / 0.5


def test_an_angle_that_never_wraps_is_differenced_as_it_is():
    calibration = Calibration(angle_wiring(wrap=0.0, raw="volts", sign=1))
    calibration.convert(0.0, raw(wheel_speed_2=-1e6))
    assert calibration.convert(0.5, raw(wheel_speed_2=1e6)).wheel_speed[1] == 0.001 * 2e6 / 0.5


def test_at_a_time_that_does_not_rise_the_speed_stays_and_a_lost_count_is_made_up_for():
    calibration = Calibration(angle_wiring(sign=1))
    speeds = [
        float(calibration.convert(time, raw(wheel_speed_2=count)).wheel_speed[1])
        for time, count in ((0.0, 0), (1.0, 100), (1.0, 900), (0.5, 900), (2.0, math.nan), (3.0, 500))
    ]
    assert speeds[:4] == [0.0, 0.1, 0.1, 0.1]
    assert math.isnan(speeds[4])
    assert speeds[5] == pytest.approx(0.001 * 400 / 2.0)
    calibration.reset()
    assert calibration.convert(9.0, raw(wheel_speed_2=7)).wheel_speed[1] == 0.0


@given(st.lists(st.floats(-1.5, 1.5, width=32), min_size=4, max_size=4), st.sets(st.integers(1, 4)))
def test_currents_and_brakes_come_back_from_the_device_as_they_went(currents, brake):
    wheels = WheelMap.from_hardware(PERMUTED)
    sent, bits = wheels.to_device(CurrentCommand(np.array(currents), tuple(sorted(brake))))
    back = wheels.from_device(sent, bits)
    assert back.current.tolist() == currents
    assert back.brake == tuple(sorted(brake))


def test_each_wheel_has_its_place_sign_and_gain():
    wheels = WheelMap.from_hardware(PERMUTED)
    sent, bits = wheels.to_device(CurrentCommand(np.array([1.0, 0.5, 0.25, 0.125]), (2, 3)))
    assert sent == (-0.25, -0.125, 1.0, 0.5)
    assert bits == 0b1001


def test_behind_an_analog_box_the_device_has_the_wheels_in_their_order_and_volts_are_the_boxs():
    outputs = tuple(dataclasses.replace(o, channel=9 - o.wheel, sign=-1) for o in WIRING.outputs)
    wheels = WheelMap.from_hardware(dataclasses.replace(WIRING, outputs=outputs))
    assert wheels.channels == (0, 1, 2, 3) and wheels.factors == (-1.0,) * 4


def test_a_device_has_its_wheel_speeds_in_its_own_order():
    volts = raw(wheel_speed_1=1.0, wheel_speed_2=2.0, wheel_speed_3=3.0, wheel_speed_4=-4.0)
    gain = WIRING.inputs[4].gain
    assert wheel_speed_decoder(PERMUTED)(0.0, volts) == (2.0 * gain, -4.0 * gain, 1.0 * gain, 3.0 * gain)


def test_the_device_describes_each_channel_and_indices_left_out_are_unused():
    kinds = channel_kinds(rewired("yaw", channel=13, raw="counts"))
    assert kinds[0] == ChannelKind(Quantity.CURRENT, 1, Raw.VOLTS)
    assert kinds[7] == ChannelKind(Quantity.WHEEL_SPEED, 4, Raw.VOLTS)
    assert kinds[13] == ChannelKind(Quantity.YAW, 0, Raw.COUNTS)
    assert kinds[11] == kinds[12] == ChannelKind(Quantity.OTHER, 0, Raw.VOLTS)
    assert len(kinds) == 14


def test_a_device_set_up_for_this_wiring_confirms_it():
    device = device_config(WIRING, 0.002, lock_step=True, keyed=True)
    assert (device.wheels, device.period, device.lock_step, device.keyed) == (4, 0.002, True, True)
    assert device.channels == channel_kinds(WIRING)
    assert device.calibration_hash == calibration_hash(WIRING)
    assert device.limits == rounded_limits(WIRING)
    plain = device_config(WIRING, 0.001)
    assert (plain.lock_step, plain.keyed) == (False, False)


def test_the_limits_hash_is_of_seven_floats():
    limits = Limits(1.5, 2000.0, 0.75, 8.0, 41.0, 4000.0, 0.2)
    digest = hashlib.blake2s(struct.pack("<fffffff", 1.5, 2000.0, 0.75, 8.0, 41.0, 4000.0, 0.2)).digest()
    assert limits_hash(limits) == struct.unpack("<Q", digest[:8])[0]
    assert limits_hash(limits) == 4543933000860868742  # for whoever writes a firmware


def test_the_canonical_text_is_as_documented():
    text = canonical_text(angle_wiring(offset=0.1))
    lines = text.split("\n")
    assert lines[0] == "omnimj calibration 1"
    assert lines[1] == "input current_1 current volts 0 1 0.5 0 0 0"
    assert lines[6] == ("input wheel_speed_2 wheel_angle counts 5 -1 0.001 0.10000000000000001 0 65536")
    assert lines[13] == "output 1 0 1 2 V/A"
    assert (len(lines), lines[-1]) == (18, "")
    digest = hashlib.blake2s(text.encode()).digest()
    assert calibration_hash(angle_wiring(offset=0.1)) == int.from_bytes(digest[:8], "little")


def test_every_change_of_the_wiring_changes_the_hash_and_its_order_does_not():
    changes = [
        {"sign": -1},
        {"gain": 0.51},
        {"offset": 0.1},
        {"filter": 0.1},
        {"channel": 15},
        {"raw": "counts"},
    ]
    hashes = {calibration_hash(rewired("current_1", **c)) for c in changes}
    hashes |= {calibration_hash(WIRING), calibration_hash(PERMUTED), calibration_hash(angle_wiring())}
    assert len(hashes) == len(changes) + 3
    shuffled = dataclasses.replace(WIRING, inputs=WIRING.inputs[::-1], outputs=WIRING.outputs[::-1])
    assert calibration_hash(shuffled) == calibration_hash(WIRING)
