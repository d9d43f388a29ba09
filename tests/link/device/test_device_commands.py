"""The command path of an armed device: what passes, what is refused, what cuts the current and is latched."""

import math

import pytest
from device_driver import PERIOD, ZERO, DeviceDriver, codes, faults, with_limits

from omnimj.link.codec.frames import encode
from omnimj.link.codec.messages import Command, Fault, FaultCode, Ping, Pong, Status, Stop
from omnimj.link.device.state_machine import Outbox


def flows(driver):
    return driver.device.output.currents


def expect_latched(driver, code):
    """No current, not armed, the fault in every telemetry; only reset, zero and arm help."""
    assert flows(driver) == ZERO and driver.device.output.brake == 0
    assert not driver.device.armed and driver.device.fault is code
    driver.tick()
    assert driver.telemetry.fault is code
    assert driver.telemetry.status == Status.FAULT
    assert codes(driver.command((0.5, 0.0, 0.0))) == [FaultCode.NOT_ARMED]
    assert driver.command() == ()
    assert codes(driver.arm()) == [FaultCode.ARM_FAULTY]
    driver.tick()
    assert flows(driver) == ZERO
    assert driver.reset() == ()
    assert not driver.device.armed and driver.device.fault is FaultCode.NONE
    assert codes(driver.command((0.5, 0.0, 0.0))) == [FaultCode.NOT_ARMED]
    assert driver.arm() == ()
    assert driver.command((0.5, 0.0, 0.0)) == ()
    driver.tick()
    assert flows(driver) == (0.5, 0.0, 0.0)
    assert driver.telemetry.status == Status.ARMED | Status.CURRENT_FLOWS
    assert driver.telemetry.fault is FaultCode.NONE


def test_a_command_flows_from_the_next_tick_on():
    driver = DeviceDriver().armed()
    driver.command((0.5, 0.0, 0.125), brake=2)
    assert flows(driver) == ZERO
    driver.tick()
    assert flows(driver) == (0.5, 0.0, 0.125) and driver.device.output.brake == 2
    assert driver.telemetry.status == Status.ARMED | Status.CURRENT_FLOWS | Status.BRAKED
    assert driver.telemetry.acknowledged == driver.sequence
    assert driver.telemetry.command_age == PERIOD
    driver.tick()
    assert driver.telemetry.command_age == 2 * PERIOD
    assert flows(driver) == (0.5, 0.0, 0.125)


def test_a_brake_alone_is_reported_as_such():
    driver = DeviceDriver().driving(ZERO, brake=7)
    assert driver.device.output.brake == 7
    assert driver.telemetry.status == Status.ARMED | Status.BRAKED


def test_of_several_commands_between_two_ticks_the_last_one_flows():
    driver = DeviceDriver().armed()
    driver.command((0.5, 0.0, 0.0))
    driver.command((0.25, 0.0, 0.0))
    driver.tick()
    assert flows(driver) == (0.25, 0.0, 0.0)


@pytest.mark.parametrize(
    ("currents", "code", "wheel", "value", "limit"),
    [
        ((0.0, math.inf, 0.0), FaultCode.NOT_FINITE, 2, math.inf, 1.5),
        ((0.5, 0.0, 1.6), FaultCode.CURRENT, 3, 1.6, 1.5),
        ((-0.75, 0.0, 0.0), FaultCode.CURRENT_RATE, 1, 1.25, 1.0),
    ],
)
def test_a_command_beyond_a_limit_is_refused_and_latched(currents, code, wheel, value, limit):
    driver = DeviceDriver().driving((0.5, 0.0, 0.0))
    (fault,) = faults(driver.command(currents))
    assert fault == Fault(code, wheel, value, limit, driver.sequence, latched=True)
    assert driver.device.refused == 1
    expect_latched(driver, code)


@pytest.mark.parametrize("valid_for", [0.0, -1.0, math.nextafter(0.25, 1.0), math.nan])
def test_a_valid_for_that_may_not_be_is_refused_and_latched(valid_for):
    driver = DeviceDriver().driving()
    code = FaultCode.NOT_FINITE if math.isnan(valid_for) else FaultCode.VALID_FOR
    assert codes(driver.command(valid_for=valid_for)) == [code]
    expect_latched(driver, code)


@pytest.mark.parametrize(
    ("currents", "brake"),
    [((0.0, 0.0), 0), ((0.0,) * 4, 0), ((), 0), (ZERO, 8), (ZERO, -1)],
)
def test_a_command_for_another_number_of_wheels_is_malformed(currents, brake):
    driver = DeviceDriver().driving()
    (fault,) = faults(driver.command(currents, brake=brake))
    expected = Fault(FaultCode.MALFORMED, 0, float(len(currents)), 3.0, driver.sequence, latched=True)
    assert fault == expected
    expect_latched(driver, FaultCode.MALFORMED)


def test_a_refused_command_is_not_acknowledged():
    driver = DeviceDriver().driving()
    taken = driver.sequence
    driver.command((9.0, 0.0, 0.0))
    driver.tick()
    assert driver.telemetry.acknowledged == taken
    assert driver.telemetry.refused == 1


def test_a_command_holds_for_its_stated_time_and_then_the_device_is_off_and_reports_it():
    for by_tick in (True, False):
        driver = DeviceDriver().driving((0.5, 0.0, 0.0), valid_for=4 * PERIOD)
        driver.tick(periods=3)  # its age is now four periods
        assert flows(driver) == (0.5, 0.0, 0.0)
        if by_tick:
            answer = driver.tick()
            age = 5 * PERIOD
        else:
            driver.now = math.nextafter(driver.now, math.inf)
            age = driver.now - 1 * PERIOD
            answer = driver.give(Ping(1))  # any frame shows that time has gone on
        assert faults(answer) == [Fault(FaultCode.COMMAND_TOO_OLD, 0, age, 4 * PERIOD, 0, latched=True)]
        expect_latched(driver, FaultCode.COMMAND_TOO_OLD)


def test_a_command_that_comes_after_the_one_before_has_expired_comes_too_late():
    driver = DeviceDriver().driving((0.5, 0.0, 0.0), valid_for=0.5 * PERIOD + PERIOD)
    driver.now += PERIOD
    answer = driver.command((0.5, 0.0, 0.0))
    assert codes(answer) == [FaultCode.COMMAND_TOO_OLD, FaultCode.NOT_ARMED]


def test_what_is_no_frame_lets_time_go_on_too():
    driver = DeviceDriver().driving((0.5, 0.0, 0.0), valid_for=2 * PERIOD)
    driver.now += 2 * PERIOD
    driver.device.on_invalid_packet(driver.now)
    assert flows(driver) == ZERO
    assert codes(driver.tick()) == [FaultCode.COMMAND_TOO_OLD]


def test_expired_commands_are_no_fault_of_a_disarmed_device():
    driver = DeviceDriver()
    driver.begin().tick()
    driver.command(valid_for=PERIOD)
    driver.tick(periods=100)
    assert driver.device.fault is FaultCode.NONE
    assert [f for f in driver.received if isinstance(f.message, Fault)] == []


def test_an_armed_device_without_new_commands_is_off_after_valid_for():
    driver = DeviceDriver().armed()
    driver.tick(periods=64)
    assert driver.device.armed
    assert codes(driver.tick()) == [FaultCode.COMMAND_TOO_OLD]
    expect_latched(driver, FaultCode.COMMAND_TOO_OLD)


@pytest.mark.parametrize("wheel", [0, 1, 2])
def test_a_wheel_that_turns_too_fast_cuts_the_current_at_that_tick(wheel):
    for speed in (40.0, -40.0):
        driver = DeviceDriver().driving()
        driver.tick(tuple(speed if w == wheel else 0.0 for w in range(3)))
        assert driver.device.armed
    for speed in (math.nextafter(40.0, 99.0), -math.nextafter(40.0, 99.0)):
        driver = DeviceDriver().driving()
        answer = driver.tick(tuple(speed if w == wheel else 0.0 for w in range(3)))
        assert faults(answer) == [Fault(FaultCode.WHEEL_SPEED, wheel + 1, speed, 40.0, 0, latched=True)]
        assert driver.telemetry.fault is FaultCode.WHEEL_SPEED  # already in the telemetry of this tick
        assert driver.telemetry.raw[wheel] == speed
        expect_latched(driver, FaultCode.WHEEL_SPEED)


def test_a_broken_speed_sensor_cuts_the_current():
    driver = DeviceDriver().driving()
    assert codes(driver.tick((0.0, math.nan, 0.0))) == [FaultCode.SENSOR]
    expect_latched(driver, FaultCode.SENSOR)


def test_a_wheel_turned_by_hand_is_no_fault_of_a_disarmed_device():
    driver = DeviceDriver()
    driver.begin()
    driver.tick((99.0, math.nan, 0.0))
    assert driver.device.fault is FaultCode.NONE


def heated(driver, current, periods):
    """Keeps a current flowing."""
    for _ in range(periods):
        answer = driver.command((0.0, current, 0.0))
        if answer:
            return answer
        driver.tick()
    return ()


def test_a_motor_is_not_heated_beyond_its_limit():
    # 1.5 A heat by 2 A² net: 1.75 A²s are full after 896 periods of 2⁻¹⁰ s
    driver = DeviceDriver().armed()
    for current in (0.75, 1.5):
        driver.command((0.0, current, 0.0))
    assert driver.device.fault is FaultCode.CURRENT_RATE  # in one go it is too quick
    driver = DeviceDriver().driving((0.0, 0.5, 0.0))
    assert heated(driver, 1.5, 896) == ()
    (fault,) = faults(driver.command((0.0, 1.5, 0.0)) + driver.tick())
    assert fault == Fault(FaultCode.HEATING, 2, 1.75 + PERIOD * 2.0, 1.75, 0, latched=True)


def test_a_held_command_is_cut_before_it_overheats_a_motor():
    driver = DeviceDriver(limits=with_limits(heating=16 * PERIOD * 2.0)).driving((0.0, 0.5, 0.0))
    driver.command((0.0, 1.5, 0.0), valid_for=0.25)
    driver.tick(periods=16)  # the first one begins it
    assert flows(driver) == (0.0, 1.5, 0.0)
    answer = driver.tick()
    expected = Fault(FaultCode.HEATING, 2, 17 * PERIOD * 2.0, 16 * PERIOD * 2.0, 0, latched=True)
    assert faults(answer) == [expected]
    assert flows(driver) == ZERO


def test_a_motor_cools_down_and_neither_fault_nor_session_resets_its_heat():
    driver = DeviceDriver(limits=with_limits(heating=16 * PERIOD * 2.0)).driving((0.0, 0.5, 0.0))
    heated(driver, 1.5, 16)
    assert codes(driver.command((0.0, 1.0, 0.0)) + driver.tick()) == [FaultCode.HEATING]
    driver.tick()
    driver.reset()
    driver.begin(nonce=9)
    # full: 32 periods A²; one period of rest gives back 0.25, one of 1 A takes 0.75
    for rest, passes in ((1, False), (2, True)):
        driver.device.fault = FaultCode.NONE
        driver.tick(periods=rest)
        driver.command()
        assert driver.arm() == ()
        assert (codes(driver.command((0.0, 1.0, 0.0))) == []) == passes


def test_the_change_of_current_is_held_against_what_flows_and_against_times_of_arrival():
    driver = DeviceDriver().driving((0.5, 0.0, 0.0))
    driver.tick()  # two periods since the command that flows
    assert driver.command((-1.5, 0.0, 0.0)) == ()
    driver = DeviceDriver().driving((0.5, 0.0, 0.0))
    driver.command((0.5, 0.0, 0.0))
    driver.tick()
    assert codes(driver.command((-1.0, 0.0, 0.0))) == [FaultCode.CURRENT_RATE]


def test_after_arming_the_change_is_held_against_the_zero_command():
    driver = DeviceDriver()
    driver.begin()
    driver.tick(periods=100)
    driver.command()
    driver.arm()
    assert codes(driver.command((1.25, 0.0, 0.0))) == [FaultCode.CURRENT_RATE]
    driver = DeviceDriver()
    driver.begin()
    driver.tick(periods=100)
    driver.command()
    driver.tick()
    driver.arm()
    driver.now += 0.5 * PERIOD
    assert driver.command((1.5, 0.0, 0.0)) == ()


def test_the_first_fault_is_kept():
    driver = DeviceDriver().driving()
    driver.command((9.0, 0.0, 0.0))
    driver.command(valid_for=9.0)
    assert codes(driver.received) == [FaultCode.CURRENT, FaultCode.VALID_FOR]
    assert [f.latched for f in faults(driver.received)] == [True, True]
    assert driver.device.fault is FaultCode.CURRENT


def test_frames_beyond_the_message_rate_are_refused_and_reported_once():
    driver = DeviceDriver().driving()
    driver.tick(periods=60)  # a full burst again: 200 frames
    driver.command(valid_for=0.25)
    for _ in range(199):
        driver.give(Ping(1))
    assert driver.device.armed
    (fault,) = faults(driver.give(Ping(1)))
    assert fault == Fault(FaultCode.MESSAGE_RATE, 0, 0.0, 4000.0, driver.sequence, latched=True)
    assert driver.give(Ping(1)) == ()
    assert driver.device.refused == 2
    driver.tick()
    expect_latched(driver, FaultCode.MESSAGE_RATE)


def test_frames_at_the_message_rate_are_answered_for_ever():
    driver = DeviceDriver()
    driver.begin()
    for _ in range(1000):
        driver.now += 0.00025
        assert len(driver.give(Ping(1))) == 1


def test_time_that_runs_backwards_gives_no_credit_and_no_heat():
    driver = DeviceDriver()
    driver.begin()
    for _ in range(200):
        driver.give(Ping(1))
    for _ in range(10):
        driver.now -= 1.0
        driver.give(Ping(1))
        driver.now += 1.0
        driver.give(Ping(1))
    assert driver.device.fault is FaultCode.MESSAGE_RATE
    assert driver.device.refused == 21


def test_other_hosts_have_a_separate_message_budget_that_bounds_their_answers():
    driver = DeviceDriver().driving()
    hello = driver.ask(nonce=5)
    answered = sum(len(driver.enter(hello)) for _ in range(300))
    # two hellos were the host's own, one asked for the cookie, and ticks of periods have given some back
    assert answered == 199
    assert driver.device.dropped == 101
    assert driver.device.refused == 199
    assert driver.device.armed
    assert driver.command((0.25, 0.0, 0.0)) == ()


def test_stops_are_not_limited_by_the_message_rate():
    driver = DeviceDriver().driving()
    for _ in range(1000):
        driver.give(Stop())
    assert (driver.device.dropped, driver.device.refused, driver.device.fault) == (0, 0, FaultCode.NONE)


def test_arming_again_with_zero_changes_nothing_and_while_driving_is_refused_without_harm():
    driver = DeviceDriver().armed()
    driver.tick()
    assert driver.arm() == ()
    assert driver.device.armed
    driver.command((0.5, 0.0, 0.0))
    driver.tick()
    assert codes(driver.arm()) == [FaultCode.ARM_NOT_ZERO]
    assert driver.device.armed and flows(driver) == (0.5, 0.0, 0.0)


# --- lock-step: the device's time is the plant's


def stepped(driver, currents=ZERO, **rest):
    """One command and the period that it moves the plant by."""
    answer = driver.command(currents, **rest)
    assert driver.device.step_due
    return answer + driver.tick()


def lock_step():
    driver = DeviceDriver(lock_step=True)
    driver.begin()
    assert driver.device.tick(driver.now, (1.0, 2.0, 3.0)) == ()  # the readings at the start
    return driver


def test_in_lock_step_nothing_moves_before_the_session_has_been_armed():
    driver = lock_step()
    (answer,) = driver.command()
    assert answer.message.raw == (1.0, 2.0, 3.0)
    assert answer.message.status == Status.LOCK_STEP
    assert not driver.device.step_due
    (answer,) = driver.arm()
    assert answer.message.status == Status.LOCK_STEP | Status.ARMED
    assert not driver.device.step_due


def test_in_lock_step_every_new_command_moves_one_period_and_gets_one_telemetry():
    driver = lock_step()
    driver.command()
    driver.arm()
    for k in range(1, 5):
        driver.speeds = (float(k), 0.0, 0.0)
        (answer,) = stepped(driver, (0.25 * k, 0.0, 0.0))
        assert answer.message.raw == driver.speeds
        assert answer.message.acknowledged == driver.sequence
        assert answer.message.command_age == PERIOD
        assert flows(driver) == (0.25 * k, 0.0, 0.0)
        assert answer.time == round(k * PERIOD * 1e6)
        assert not driver.device.step_due


def test_in_lock_step_the_same_command_again_gets_the_same_answer_and_moves_nothing():
    driver = lock_step()
    driver.command()
    armed = driver.arm()
    again = driver.frame(Command((0.5, 0.0, 0.0), 0.0625))
    assert driver.deliver(again) == ()
    assert driver.deliver(again) == ()  # the period is not over yet
    assert driver.device.step_due
    answer = driver.tick()
    assert driver.deliver(again) == answer
    assert driver.deliver(again) == answer
    assert not driver.device.step_due
    assert driver.device.dropped == 0
    changed = driver.frame(Command((0.25, 0.0, 0.0), 0.0625), sequence=again.sequence)
    assert driver.deliver(changed) == ()
    assert driver.device.dropped == 1
    assert armed[0].message.status == Status.LOCK_STEP | Status.ARMED


def test_in_lock_step_a_refusal_is_repeated_too_and_a_real_time_device_repeats_nothing():
    for lock in (True, False):
        driver = DeviceDriver(lock_step=lock)
        driver.begin()
        driver.tick()
        frame = driver.frame(Command((9.0, 0.0, 0.0), 0.0625, 0, driver.newest))
        first = driver.deliver(frame)
        assert codes(first) == [FaultCode.NOT_ARMED]
        assert driver.deliver(frame) == (first if lock else ())
        assert driver.device.dropped == (0 if lock else 1)
        assert driver.device.refused == 1


def test_in_lock_step_a_robot_that_was_stopped_rolls_out_under_zero_commands():
    driver = lock_step()
    driver.command()
    driver.arm()
    stepped(driver, (0.5, 0.0, 0.0))
    driver.give(Stop())
    assert flows(driver) == ZERO
    (answer,) = stepped(driver)
    assert answer.message.status == Status.LOCK_STEP | Status.STOPPED
    assert codes(driver.command((0.5, 0.0, 0.0))) == [FaultCode.NOT_ARMED]
    assert not driver.device.step_due
    driver.reset()
    driver.command()
    driver.tick()
    assert len(driver.arm()) == 1
    assert driver.device.armed


def test_in_lock_step_reset_fault_is_answered():
    driver = lock_step()
    driver.command()
    driver.arm()
    answer = driver.command((9.0, 0.0, 0.0))
    assert codes(answer) == [FaultCode.CURRENT]
    stepped(driver)
    (answer,) = driver.reset()
    assert answer.message.fault is FaultCode.NONE


def test_in_lock_step_a_wheel_that_turns_too_fast_is_reported_with_the_telemetry_of_that_step():
    driver = lock_step()
    driver.command()
    driver.arm()
    driver.command((0.5, 0.0, 0.0))
    answer = driver.tick((99.0, 0.0, 0.0))
    assert codes(answer) == [FaultCode.WHEEL_SPEED]
    assert answer[-1].message.fault is FaultCode.WHEEL_SPEED
    assert flows(driver) == ZERO


def test_in_lock_step_the_limits_hold_in_simulated_time():
    driver = lock_step()
    driver.command()
    driver.arm()
    for current in (1.0, 0.0, -1.0):
        stepped(driver, (current, 0.0, 0.0))
    assert codes(driver.command((0.25, 0.0, 0.0))) == [FaultCode.CURRENT_RATE]
    driver = DeviceDriver(lock_step=True, limits=with_limits(heating=16 * PERIOD * 2.0))
    driver.begin()
    driver.command()
    driver.device.tick(driver.now, ZERO)
    driver.command()
    driver.arm()
    stepped(driver, (0.0, 0.5, 0.0))
    for _ in range(16):
        stepped(driver, (0.0, 1.5, 0.0))
    assert codes(driver.command((0.0, 1.5, 0.0))) == [FaultCode.HEATING]


def test_in_lock_step_there_is_no_message_rate_since_time_stands_still():
    driver = lock_step()
    for k in range(1000):
        assert len(driver.give(Ping(k))) == 1
        assert len(driver.hello(nonce=k)) == 1


def test_after_49_days_of_telemetry_a_frame_still_has_a_number_that_its_field_holds():
    outbox = Outbox(keyed=False)
    outbox.start_session(5)
    outbox._sequence = 2**32 - 2
    for _ in range(3):
        outbox.put(0.0, Pong(1))
    frames = outbox.drain()
    assert [frame.sequence for frame in frames] == [2**32 - 1, 0, 1]
    assert all(encode(frame) for frame in frames)
