"""The device's last gate, dense around every boundary: equal to a limit passes, the next number does not."""

import dataclasses
import itertools
import math
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.errors import InputError
from omnimj.link.codec.messages import Command, FaultCode, Limits
from omnimj.link.device import limits as gate
from omnimj.link.device.limits import AmplifierState, Refusal

LIMITS = Limits(
    current=1.5,
    current_rate=1024.0,
    continuous_current=0.5,
    heating=1.75,
    wheel_speed=40.0,
    message_rate=4000.0,
    valid_for=0.25,
)
PERIOD = 2.0**-10  # [s]: a power of two, so that rate × period and its boundary are exact
COLD = (0.0, 0.0, 0.0)


def above(x):
    return math.nextafter(x, math.inf)


def below(x):
    return math.nextafter(x, -math.inf)


def around(x):
    return (below(x), x, above(x))


def refused(currents=COLD, valid_for=0.0625, flows=COLD, since=0.0, heat=COLD, now=PERIOD) -> Any:
    return gate.check_command(
        LIMITS, PERIOD, AmplifierState(flows, since, heat), Command(currents, valid_for), now
    )


def at(wheel, current):
    return tuple(current if w == wheel else 0.0 for w in (1, 2, 3))


WHEELS = pytest.mark.parametrize("wheel", [1, 2, 3])
SIGNS = pytest.mark.parametrize("sign", [1.0, -1.0])


def test_a_command_within_all_limits_passes():
    assert refused() is None


@WHEELS
@SIGNS
def test_a_current_passes_up_to_its_limit_and_not_one_number_further(wheel, sign):
    for size in around(1.5):
        current = sign * size
        found = refused(at(wheel, current), flows=at(wheel, current))
        if size <= 1.5:
            assert found is None
        else:
            assert found == Refusal(FaultCode.CURRENT, wheel, current, 1.5)


@WHEELS
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_one_current_that_is_not_finite_refuses_the_command(wheel, bad):
    found = refused(at(wheel, bad))
    assert (found.code, found.wheel, found.limit) == (FaultCode.NOT_FINITE, wheel, 1.5)
    assert repr(found.value) == repr(bad)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_valid_for_that_is_not_finite_refuses_the_command(bad):
    found = refused(valid_for=bad)
    assert (found.code, found.wheel, found.limit) == (FaultCode.NOT_FINITE, 0, 0.25)
    assert repr(found.value) == repr(bad)


def test_valid_for_lies_above_zero_and_at_most_at_its_limit():
    for valid_for in (above(0.0), 0.05, below(0.25), 0.25):
        assert refused(valid_for=valid_for) is None
    for valid_for in (-0.0, 0.0, below(0.0), -1.0, above(0.25), 1e30):
        assert refused(valid_for=valid_for) == Refusal(FaultCode.VALID_FOR, 0, valid_for, 0.25)


@WHEELS
@SIGNS
def test_the_change_passes_up_to_rate_times_time_and_not_one_number_further(wheel, sign):
    # (time since the command before, change that is allowed); less than a period counts as one
    for since, now, allowed in (
        (0.0, PERIOD, 1.0),
        (5.0, 5.0, 1.0),
        (5.0, 4.0, 1.0),
        (1.0, 1.0 + 1.25 * PERIOD, 1.25),
    ):
        for size in around(allowed):
            found = refused(at(wheel, sign * size), since=since, now=now)
            if size <= allowed:
                assert found is None
            else:
                assert found == Refusal(FaultCode.CURRENT_RATE, wheel, size, allowed)


@SIGNS
def test_the_change_is_counted_from_the_current_that_flows_across_zero_too(sign):
    assert refused(at(2, sign * 0.5), flows=at(2, sign * -0.5)) is None
    found = refused(at(2, sign * 0.75), flows=at(2, sign * -0.5))
    assert found == Refusal(FaultCode.CURRENT_RATE, 2, 1.25, 1.0)
    found = refused(at(2, sign * 0.125), flows=at(2, sign * 1.25))
    assert found == Refusal(FaultCode.CURRENT_RATE, 2, 1.125, 1.0)


@SIGNS
def test_a_change_to_zero_current_is_never_too_fast(sign):
    assert refused((0.0, -0.0, 0.0), flows=(sign * 1.5,) * 3) is None


def test_heat_is_the_integral_of_what_a_motor_may_not_carry_for_ever_and_never_below_zero():
    assert gate.heat_after(LIMITS, 0.25, 1.5, 0.125) == 0.25 + (2.25 - 0.25) * 0.125
    assert gate.heat_after(LIMITS, 0.25, -1.5, 0.125) == 0.25 + (2.25 - 0.25) * 0.125
    assert gate.heat_after(LIMITS, 0.25, 0.5, 100.0) == 0.25
    assert gate.heat_after(LIMITS, 0.25, 0.0, 0.5) == 0.125
    assert gate.heat_after(LIMITS, 0.25, 0.0, 1.0) == 0.0
    assert gate.heat_after(LIMITS, 0.25, 0.0, 2.0) == 0.0


@WHEELS
@SIGNS
def test_one_more_period_may_heat_a_motor_up_to_its_limit_and_not_one_number_further(wheel, sign):
    step = 2.0 * PERIOD  # of 1.5 A
    for start in around(1.75 - step):
        currents, heat = at(wheel, sign * 1.5), at(wheel, start)
        found = refused(currents, flows=currents, heat=heat)
        assert gate.check_heating(LIMITS, PERIOD, heat, currents) == found
        if start <= 1.75 - step:
            assert found is None
        else:
            assert found == Refusal(FaultCode.HEATING, wheel, start + step, 1.75)


@WHEELS
@SIGNS
def test_a_motor_that_is_too_hot_may_still_carry_what_it_may_carry_for_ever(wheel, sign):
    heat = at(wheel, 3.0)
    assert gate.check_heating(LIMITS, PERIOD, heat, at(wheel, sign * 0.5)) is None
    found: Any = gate.check_heating(LIMITS, PERIOD, heat, at(wheel, sign * above(0.5)))
    assert (found.code, found.wheel, found.limit) == (FaultCode.HEATING, wheel, 1.75)
    assert found.value >= 3.0


@WHEELS
@SIGNS
def test_a_wheel_may_turn_up_to_its_speed_limit_and_not_one_number_faster(wheel, sign):
    for size in around(40.0):
        found = gate.check_wheel_speeds(LIMITS, at(wheel, sign * size))
        assert found == (None if size <= 40.0 else Refusal(FaultCode.WHEEL_SPEED, wheel, sign * size, 40.0))


@WHEELS
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_an_unknown_wheel_speed_is_a_fault_of_the_sensor(wheel, bad):
    found: Any = gate.check_wheel_speeds(LIMITS, at(wheel, bad))
    assert (found.code, found.wheel, found.limit) == (FaultCode.SENSOR, wheel, 40.0)
    assert repr(found.value) == repr(bad)


def test_a_command_may_grow_as_old_as_it_states_and_not_one_number_older():
    for age in around(0.0625):
        found = gate.check_command_age(age, 0.0625)
        assert found == (None if age <= 0.0625 else Refusal(FaultCode.COMMAND_TOO_OLD, 0, age, 0.0625))


def test_as_many_frames_come_at_once_as_come_in_the_time_of_a_burst():
    assert gate.BURST_DURATION == 0.05
    assert gate.max_credit(LIMITS) == 200.0
    assert gate.max_credit(dataclasses.replace(LIMITS, message_rate=2.0)) == 1.0
    for rate in around(20.0):
        assert gate.max_credit(dataclasses.replace(LIMITS, message_rate=rate)) == max(1.0, 0.05 * rate)


def test_credit_comes_back_at_the_message_rate_up_to_a_burst_and_time_that_runs_backwards_takes_none():
    assert gate.credit_after(LIMITS, 10.0, 0.0) == 10.0
    assert gate.credit_after(LIMITS, 10.0, 0.015625) == 10.0 + 62.5
    assert gate.credit_after(LIMITS, 10.0, 1.0) == 200.0
    assert gate.credit_after(LIMITS, 10.0, -1.0) == 10.0


def test_the_first_broken_limit_in_the_order_of_the_list_is_reported():
    hot = (1.75,) * 3
    assert refused((math.nan, 9.0, 1.25), 9.0, heat=hot).code is FaultCode.NOT_FINITE
    assert refused((9.0, 9.0, math.nan), 9.0, heat=hot).wheel == 3
    assert refused((9.0, 9.0, 1.25), math.nan, heat=hot).code is FaultCode.NOT_FINITE
    assert refused((9.0, 9.0, 1.25), 9.0, heat=hot).code is FaultCode.VALID_FOR
    assert refused((1.25, 9.0, 1.25), heat=hot) == Refusal(FaultCode.CURRENT, 2, 9.0, 1.5)
    assert refused((0.75, 1.25, 1.25), heat=hot) == Refusal(FaultCode.CURRENT_RATE, 2, 1.25, 1.0)
    assert refused((0.5, 0.75, 1.0), heat=hot).code is FaultCode.HEATING
    assert refused((0.5, 0.75, 1.0), heat=hot).wheel == 2


def test_all_limits_hold_wherever_a_command_passes_on_a_dense_grid():
    edges = [s * v for b in (0.0, 0.25, 0.5, 1.0, 1.25, 1.5) for v in around(b) for s in (1.0, -1.0)]
    flows = (-1.5, -0.5, 0.0, 0.5, 1.5)
    heats = (0.0, 1.7, 1.75 - 2.0 * PERIOD, 1.75, 2.5)
    for current, flow, heat, now in itertools.product(edges, flows, heats, (PERIOD, 1.5 * PERIOD)):
        passes = refused((current,), flows=(flow,), heat=(heat,), now=now) is None
        quick = abs(current - flow) > 1024.0 * now and current != 0.0
        hot = heat + (current**2 - 0.25) * PERIOD > 1.75 and abs(current) > 0.5
        assert passes == (abs(current) <= 1.5 and not quick and not hot)


def test_limits_are_rounded_to_what_travels():
    odd = Limits(1.6, 1000.1, 0.61, 2.03, 41.9, 4000.3, 0.2)
    expected = struct.unpack("<7f", struct.pack("<7f", *dataclasses.astuple(odd)))
    assert dataclasses.astuple(gate.round_to_float32(odd)) == expected != dataclasses.astuple(odd)
    assert gate.round_to_float32(LIMITS) == LIMITS


@given(st.floats(0.0009765625, 1e30, width=64))
def test_a_commanded_current_as_large_as_the_limit_passes_after_both_have_travelled(limit):
    limits = gate.round_to_float32(dataclasses.replace(LIMITS, current=limit))
    (rounded,) = struct.unpack("<f", struct.pack("<f", limit))
    command, before = Command((rounded,), 0.05), AmplifierState((rounded,), 0.0, (0.0,))
    found = gate.check_command(dataclasses.replace(limits, heating=math.inf), PERIOD, before, command, 0.0)
    assert found is None


@pytest.mark.parametrize("name", [f.name for f in dataclasses.fields(Limits)])
@pytest.mark.parametrize("bad", [0.0, -1.0, 1e-60, 1e60, math.nan, math.inf])
def test_a_limit_that_is_no_number_above_zero_in_float32_is_refused_by_name(name, bad):
    with pytest.raises(InputError) as caught:
        gate.round_to_float32(dataclasses.replace(LIMITS, **{name: bad}))
    assert str(caught.value) == f"limits.{name}: found {bad!r}; must be finite and above 0"


def test_the_smallest_and_the_largest_float32_are_limits():
    for value in (2.0**-149, (2.0 - 2.0**-23) * 2.0**127):
        assert gate.round_to_float32(dataclasses.replace(LIMITS, heating=value)).heating == value
