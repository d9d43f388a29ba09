"""The last gate, dense around every boundary, compiled and as plain Python."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.control.cascade import limits
from omnimj.control.cascade.limits import CurrentLimits, Reason, current_limits, limit_all, limited_current
from omnimj.parameters import read_robot

LIMITS = CurrentLimits(1.5, 1.0, 40.0)
FORMS = pytest.mark.parametrize("form", ["compiled", "python"])


def around(value):
    steps = [value, np.nextafter(value, np.inf), np.nextafter(value, -np.inf), value + 1e-6, value - 1e-6]
    return [float(v) for v in steps]


def one(form, *arguments):
    current, reason = (limited_current if form == "compiled" else limited_current.py_func)(LIMITS, *arguments)
    return current, Reason(int(reason))


def everything(form, wanted, last, speed, good):
    current, reason = np.full(len(wanted), 99.0), np.full(len(wanted), 99.0)
    function = limit_all if form == "compiled" else limit_all.py_func
    function(LIMITS, np.array(wanted), np.array(last), np.array(speed), good, current, reason)
    return current, [Reason(int(r)) for r in reason]


def test_limits_hold_the_change_per_step():
    control = read_robot().control
    expected = (control.current_limit, control.current_rate_limit * 1e-3, control.wheel_speed_limit)
    assert current_limits(control, 1e-3) == expected


@FORMS
def test_current_never_leaves_range_rate_or_speed_limit_and_passes_unchanged_inside(form):
    edges = [v for b in (-1.5, -0.5, 0.0, 0.5, 1.5, 2.5) for v in around(b)]
    lasts = [-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5]
    speeds = [v for b in (-40.0, 0.0, 40.0) for v in around(b)]
    for wanted, last, speed in itertools.product(edges, lasts, speeds):
        current, reason = one(form, wanted, last, speed)
        drives_on = abs(speed) > 40.0 and current * speed > 0.0
        assert abs(current) <= 1.5 and not drives_on
        assert abs(current - last) <= 1.0 + 1e-15 or (current == 0.0 and reason is Reason.OVERSPEED)
        allowed = abs(wanted) <= 1.5 and abs(wanted - last) <= 1.0
        allowed &= not (abs(speed) > 40.0 and wanted * speed > 0.0)
        assert (current == wanted and reason is Reason.NONE) == allowed


@FORMS
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_each_limit_gives_its_reason(form, sign):
    assert one(form, sign * 1.5, sign * 1.0, 0.0) == (sign * 1.5, Reason.NONE)
    assert one(form, sign * 1.6, sign * 1.0, 0.0) == (sign * 1.5, Reason.RANGE)
    assert one(form, sign * 1.1, 0.0, 0.0) == (sign * 1.0, Reason.RATE)
    assert one(form, sign * 0.5, 0.0, sign * 40.0) == (sign * 0.5, Reason.NONE)
    assert one(form, sign * 0.5, 0.0, sign * 40.1) == (0.0, Reason.OVERSPEED)
    assert one(form, -sign * 0.5, 0.0, sign * 40.1) == (-sign * 0.5, Reason.NONE)


@FORMS
def test_braking_a_wheel_that_is_too_fast_is_allowed_but_not_the_drive_left_by_the_rate_limit(form):
    # from 1.5 A towards −1.5 A the rate limit would leave 0.5 A of drive
    assert one(form, -1.5, 1.5, 41.0) == (0.0, Reason.OVERSPEED)
    assert one(form, -1.5, 0.5, 41.0) == (-0.5, Reason.RATE)


@FORMS
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("wheel", range(4))
def test_one_command_that_is_not_finite_stops_all_wheels_at_once(form, bad, wheel):
    wanted = [1.5, -1.5, 1.5, 0.0]
    wanted[wheel] = bad
    current, reasons = everything(form, wanted, [1.5, -1.5, 1.5, 0.0], [0.0] * 4, True)
    assert current.tolist() == [0.0] * 4
    assert reasons == [Reason.COMMAND_NOT_FINITE] * 4


@FORMS
def test_bad_measurement_stops_all_wheels_and_is_the_reason_even_for_a_bad_command(form):
    current, reasons = everything(form, [1.0, math.nan], [1.0, 1.0], [math.nan, 0.0], False)
    assert current.tolist() == [0.0, 0.0]
    assert reasons == [Reason.BAD_MEASUREMENT] * 2


@FORMS
def test_good_wheels_are_limited_each_for_itself(form):
    current, reasons = everything(
        form, [0.5, 2.0, 0.5, 0.2], [0.0, 1.0, -1.0, 0.0], [0.0, 0.0, 0.0, 50.0], True
    )
    assert current.tolist() == [0.5, 1.5, 0.0, 0.0]
    assert reasons == [Reason.NONE, Reason.RANGE, Reason.RATE, Reason.OVERSPEED]


ANY_FLOAT = st.floats(allow_nan=True, allow_infinity=True)


@given(
    st.lists(ANY_FLOAT, min_size=3, max_size=3), st.lists(ANY_FLOAT, min_size=3, max_size=3), st.booleans()
)
def test_no_command_and_speed_gives_a_current_beyond_the_limits(wanted, speed, good):
    good = good and bool(np.all(np.isfinite(speed)))
    current, reasons = everything("compiled", wanted, [1.5, 0.0, -1.5], speed, good)
    assert np.all(np.abs(current) <= 1.5)
    if not (good and np.all(np.isfinite(wanted))):
        assert not current.any() and Reason.NONE not in reasons


def test_reasons_in_the_kernels_are_those_of_the_enumeration():
    for name in ("RANGE", "RATE", "OVERSPEED", "COMMAND_NOT_FINITE", "BAD_MEASUREMENT"):
        assert getattr(limits, name) == Reason[name]
