"""The command path of an armed device: what passes, what is refused, what cuts the current and is latched."""

import math

import pytest
from device_bench import PERIOD, ZERO, Bench, codes, faults, with_limits

from omnimj.link.codec.frames import encode
from omnimj.link.codec.messages import Command, Fault, FaultCode, Ping, Pong, ResetFault, Status, Stop
from omnimj.link.device.state_machine import Outbox


def flows(bench):
    return bench.device.output.currents


def expect_latched(bench, code):
    """No current, not armed, the fault told in every telemetry; only reset-fault, zero and arm help."""
    assert flows(bench) == ZERO and bench.device.output.brake == 0
    assert not bench.device.armed and bench.device.fault is code
    bench.tick()
    assert bench.telemetry.fault is code
    assert bench.telemetry.status == Status.FAULT
    assert codes(bench.command((0.5, 0.0, 0.0))) == [FaultCode.NOT_ARMED]
    assert bench.command() == ()
    assert codes(bench.arm()) == [FaultCode.ARM_FAULTY]
    bench.tick()
    assert flows(bench) == ZERO
    assert bench.give(ResetFault()) == ()
    assert not bench.device.armed and bench.device.fault is FaultCode.NONE
    assert codes(bench.command((0.5, 0.0, 0.0))) == [FaultCode.NOT_ARMED]
    assert bench.arm() == ()
    assert bench.command((0.5, 0.0, 0.0)) == ()
    bench.tick()
    assert flows(bench) == (0.5, 0.0, 0.0)
    assert bench.telemetry.status == Status.ARMED | Status.CURRENT_FLOWS
    assert bench.telemetry.fault is FaultCode.NONE


def test_a_command_flows_from_the_next_tick_on():
    bench = Bench().armed()
    bench.command((0.5, -0.25, 0.125), brake=2)
    assert flows(bench) == ZERO
    bench.tick()
    assert flows(bench) == (0.5, -0.25, 0.125) and bench.device.output.brake == 2
    assert bench.telemetry.status == Status.ARMED | Status.CURRENT_FLOWS | Status.BRAKED
    assert bench.telemetry.acknowledged == bench.sequence
    assert bench.telemetry.command_age == PERIOD
    bench.tick()
    assert bench.telemetry.command_age == 2 * PERIOD
    assert flows(bench) == (0.5, -0.25, 0.125)


def test_a_brake_alone_is_told_as_such():
    bench = Bench().driving(ZERO, brake=7)
    assert bench.device.output.brake == 7
    assert bench.telemetry.status == Status.ARMED | Status.BRAKED


def test_of_several_commands_between_two_ticks_the_last_one_flows():
    bench = Bench().armed()
    bench.command((0.5, 0.0, 0.0))
    bench.command((0.25, 0.0, 0.0))
    bench.tick()
    assert flows(bench) == (0.25, 0.0, 0.0)


@pytest.mark.parametrize(
    ("currents", "code", "wheel", "value", "limit"),
    [
        ((0.0, math.inf, 0.0), FaultCode.NOT_FINITE, 2, math.inf, 1.5),
        ((0.5, 0.0, 1.6), FaultCode.CURRENT, 3, 1.6, 1.5),
        ((-0.75, 0.0, 0.0), FaultCode.CURRENT_RATE, 1, 1.25, 1.0),
    ],
)
def test_a_command_beyond_a_limit_is_refused_and_latched(currents, code, wheel, value, limit):
    bench = Bench().driving((0.5, 0.0, 0.0))
    (fault,) = faults(bench.command(currents))
    assert fault == Fault(code, wheel, value, limit, bench.sequence, latched=True)
    assert bench.device.refused == 1
    expect_latched(bench, code)


@pytest.mark.parametrize("valid_for", [0.0, -1.0, math.nextafter(0.25, 1.0), math.nan])
def test_a_valid_for_that_may_not_be_is_refused_and_latched(valid_for):
    bench = Bench().driving()
    code = FaultCode.NOT_FINITE if math.isnan(valid_for) else FaultCode.VALID_FOR
    assert codes(bench.command(valid_for=valid_for)) == [code]
    expect_latched(bench, code)


@pytest.mark.parametrize(
    ("currents", "brake"),
    [((0.0, 0.0), 0), ((0.0,) * 4, 0), ((), 0), (ZERO, 8), (ZERO, -1)],
)
def test_a_command_for_another_number_of_wheels_is_malformed(currents, brake):
    bench = Bench().driving()
    (fault,) = faults(bench.command(currents, brake=brake))
    expected = Fault(FaultCode.MALFORMED, 0, float(len(currents)), 3.0, bench.sequence, latched=True)
    assert fault == expected
    expect_latched(bench, FaultCode.MALFORMED)


def test_a_refused_command_is_not_acknowledged():
    bench = Bench().driving()
    taken = bench.sequence
    bench.command((9.0, 0.0, 0.0))
    bench.tick()
    assert bench.telemetry.acknowledged == taken
    assert bench.telemetry.refused == 1


def test_a_command_holds_for_as_long_as_it_said_and_then_the_device_is_off_and_says_so():
    for by_tick in (True, False):
        bench = Bench().driving((0.5, 0.0, 0.0), valid_for=4 * PERIOD)
        bench.tick(periods=3)  # its age is now four periods
        assert flows(bench) == (0.5, 0.0, 0.0)
        if by_tick:
            answer = bench.tick()
            age = 5 * PERIOD
        else:
            bench.now = math.nextafter(bench.now, math.inf)
            age = bench.now - 1 * PERIOD
            answer = bench.give(Ping(1))  # any frame shows that time has gone on
        assert faults(answer) == [Fault(FaultCode.COMMAND_TOO_OLD, 0, age, 4 * PERIOD, 0, latched=True)]
        expect_latched(bench, FaultCode.COMMAND_TOO_OLD)


def test_a_command_that_comes_after_the_one_before_has_expired_comes_too_late():
    bench = Bench().driving((0.5, 0.0, 0.0), valid_for=0.5 * PERIOD + PERIOD)
    bench.now += PERIOD
    answer = bench.command((0.5, 0.0, 0.0))
    assert codes(answer) == [FaultCode.COMMAND_TOO_OLD, FaultCode.NOT_ARMED]


def test_what_is_no_frame_lets_time_go_on_too():
    bench = Bench().driving((0.5, 0.0, 0.0), valid_for=2 * PERIOD)
    bench.now += 2 * PERIOD
    bench.device.on_invalid_packet(bench.now)
    assert flows(bench) == ZERO
    assert codes(bench.tick()) == [FaultCode.COMMAND_TOO_OLD]


def test_a_disarmed_device_lets_commands_grow_old_in_peace():
    bench = Bench()
    bench.hello()
    bench.command(valid_for=PERIOD)
    bench.tick(periods=100)
    assert bench.device.fault is FaultCode.NONE
    assert [f for f in bench.said if isinstance(f.message, Fault)] == []


def test_an_armed_device_whose_host_falls_silent_is_off_after_valid_for():
    bench = Bench().armed()
    bench.tick(periods=64)
    assert bench.device.armed
    assert codes(bench.tick()) == [FaultCode.COMMAND_TOO_OLD]
    expect_latched(bench, FaultCode.COMMAND_TOO_OLD)


@pytest.mark.parametrize("wheel", [0, 1, 2])
def test_a_wheel_that_turns_too_fast_cuts_the_current_at_that_tick(wheel):
    for speed in (40.0, -40.0):
        bench = Bench().driving()
        bench.tick(tuple(speed if w == wheel else 0.0 for w in range(3)))
        assert bench.device.armed
    for speed in (math.nextafter(40.0, 99.0), -math.nextafter(40.0, 99.0)):
        bench = Bench().driving()
        answer = bench.tick(tuple(speed if w == wheel else 0.0 for w in range(3)))
        assert faults(answer) == [Fault(FaultCode.WHEEL_SPEED, wheel + 1, speed, 40.0, 0, latched=True)]
        assert bench.telemetry.fault is FaultCode.WHEEL_SPEED  # already in the telemetry of this tick
        assert bench.telemetry.raw[wheel] == speed
        expect_latched(bench, FaultCode.WHEEL_SPEED)


def test_a_broken_speed_sensor_cuts_the_current():
    bench = Bench().driving()
    assert codes(bench.tick((0.0, math.nan, 0.0))) == [FaultCode.SENSOR]
    expect_latched(bench, FaultCode.SENSOR)


def test_a_wheel_turned_by_hand_is_no_fault_of_a_disarmed_device():
    bench = Bench()
    bench.hello()
    bench.tick((99.0, math.nan, 0.0))
    assert bench.device.fault is FaultCode.NONE


def heated(bench, current, periods):
    """Keeps a current flowing."""
    for _ in range(periods):
        answer = bench.command((0.0, current, 0.0))
        if answer:
            return answer
        bench.tick()
    return ()


def test_a_motor_is_not_heated_beyond_its_limit():
    # 1.5 A heat by 2 A² net: 1.75 A²s are full after 896 periods of 2⁻¹⁰ s
    bench = Bench().armed()
    for current in (0.75, 1.5):
        bench.command((0.0, current, 0.0))
    assert bench.device.fault is FaultCode.CURRENT_RATE  # in one go it is too quick
    bench = Bench().driving((0.0, 0.5, 0.0))
    assert heated(bench, 1.5, 896) == ()
    (fault,) = faults(bench.command((0.0, 1.5, 0.0)) + bench.tick())
    assert fault == Fault(FaultCode.HEATING, 2, 1.75 + PERIOD * 2.0, 1.75, 0, latched=True)


def test_a_held_command_is_cut_before_it_overheats_a_motor():
    bench = Bench(limits=with_limits(heating=16 * PERIOD * 2.0)).driving((0.0, 0.5, 0.0))
    bench.command((0.0, 1.5, 0.0), valid_for=0.25)
    bench.tick(periods=16)  # the first one begins it
    assert flows(bench) == (0.0, 1.5, 0.0)
    answer = bench.tick()
    expected = Fault(FaultCode.HEATING, 2, 17 * PERIOD * 2.0, 16 * PERIOD * 2.0, 0, latched=True)
    assert faults(answer) == [expected]
    assert flows(bench) == ZERO


def test_a_motor_cools_down_and_neither_fault_nor_session_makes_it_forget():
    bench = Bench(limits=with_limits(heating=16 * PERIOD * 2.0)).driving((0.0, 0.5, 0.0))
    heated(bench, 1.5, 16)
    assert codes(bench.command((0.0, 1.0, 0.0)) + bench.tick()) == [FaultCode.HEATING]
    bench.give(ResetFault())
    bench.hello(nonce=9)
    # full: 32 periods A²; one period of rest gives back 0.25, one of 1 A takes 0.75
    for rest, passes in ((1, False), (2, True)):
        bench.device.fault = FaultCode.NONE
        bench.tick(periods=rest)
        bench.command()
        assert bench.arm() == ()
        assert (codes(bench.command((0.0, 1.0, 0.0))) == []) == passes


def test_the_change_of_current_is_held_against_what_flows_and_against_times_of_arrival():
    bench = Bench().driving((0.5, 0.0, 0.0))
    bench.tick()  # two periods since the command that flows
    assert bench.command((-1.5, 0.0, 0.0)) == ()
    bench = Bench().driving((0.5, 0.0, 0.0))
    bench.command((0.5, 0.0, 0.0))
    bench.tick()
    assert codes(bench.command((-1.0, 0.0, 0.0))) == [FaultCode.CURRENT_RATE]


def test_after_arming_the_change_is_held_against_the_zero_command():
    bench = Bench()
    bench.hello()
    bench.tick(periods=100)
    bench.command()
    bench.arm()
    assert codes(bench.command((1.25, 0.0, 0.0))) == [FaultCode.CURRENT_RATE]
    bench = Bench()
    bench.hello()
    bench.tick(periods=100)
    bench.command()
    bench.tick()
    bench.arm()
    bench.now += 0.5 * PERIOD
    assert bench.command((1.5, 0.0, 0.0)) == ()


def test_the_first_fault_is_kept():
    bench = Bench().driving()
    bench.command((9.0, 0.0, 0.0))
    bench.command(valid_for=9.0)
    assert codes(bench.said) == [FaultCode.CURRENT, FaultCode.VALID_FOR]
    assert [f.latched for f in faults(bench.said)] == [True, True]
    assert bench.device.fault is FaultCode.CURRENT


def test_frames_beyond_the_message_rate_are_refused_and_told_once():
    bench = Bench().driving()
    bench.tick(periods=60)  # a full burst again: 200 frames
    bench.command(valid_for=0.25)
    for _ in range(199):
        bench.give(Ping(1))
    assert bench.device.armed
    (fault,) = faults(bench.give(Ping(1)))
    assert fault == Fault(FaultCode.MESSAGE_RATE, 0, 0.0, 4000.0, bench.sequence, latched=True)
    assert bench.give(Ping(1)) == ()
    assert bench.device.refused == 2
    bench.tick()
    expect_latched(bench, FaultCode.MESSAGE_RATE)


def test_frames_at_the_message_rate_are_answered_for_ever():
    bench = Bench()
    bench.hello()
    for _ in range(1000):
        bench.now += 0.00025
        assert len(bench.give(Ping(1))) == 1


def test_time_that_runs_backwards_gives_no_credit_and_no_heat():
    bench = Bench()
    bench.hello()
    for _ in range(200):
        bench.give(Ping(1))
    for _ in range(10):
        bench.now -= 1.0
        bench.give(Ping(1))
        bench.now += 1.0
        bench.give(Ping(1))
    assert bench.device.fault is FaultCode.MESSAGE_RATE
    assert bench.device.refused == 20


def test_strangers_use_up_a_budget_of_their_own_and_get_no_more_answers_than_it_holds():
    bench = Bench().driving()
    answered = sum(len(bench.hello(nonce=5)) for _ in range(300))
    # one hello was the host's own, and a tick of a period has given four back
    assert answered == 200
    assert bench.device.dropped == 100
    assert bench.device.refused == 200
    assert bench.device.armed
    assert bench.command((0.25, 0.0, 0.0)) == ()


def test_stops_are_never_too_many():
    bench = Bench().driving()
    for _ in range(1000):
        bench.give(Stop())
    assert (bench.device.dropped, bench.device.refused, bench.device.fault) == (0, 0, FaultCode.NONE)


def test_arming_again_with_zero_changes_nothing_and_while_driving_is_refused_without_harm():
    bench = Bench().armed()
    bench.tick()
    assert bench.arm() == ()
    assert bench.device.armed
    bench.command((0.5, 0.0, 0.0))
    bench.tick()
    assert codes(bench.arm()) == [FaultCode.ARM_NOT_ZERO]
    assert bench.device.armed and flows(bench) == (0.5, 0.0, 0.0)


# --- lock-step: the device's time is the plant's


def stepped(bench, currents=ZERO, **rest):
    """One command and the period that it moves the plant by."""
    answer = bench.command(currents, **rest)
    assert bench.device.step_due
    return answer + bench.tick()


def lock_step():
    bench = Bench(lock_step=True)
    bench.hello()
    assert bench.device.tick(bench.now, (1.0, 2.0, 3.0)) == ()  # the readings at the start
    return bench


def test_in_lock_step_nothing_moves_before_the_session_has_been_armed():
    bench = lock_step()
    (answer,) = bench.command()
    assert answer.message.raw == (1.0, 2.0, 3.0)
    assert answer.message.status == Status.LOCK_STEP
    assert not bench.device.step_due
    (answer,) = bench.arm()
    assert answer.message.status == Status.LOCK_STEP | Status.ARMED
    assert not bench.device.step_due


def test_in_lock_step_every_new_command_moves_one_period_and_gets_one_telemetry():
    bench = lock_step()
    bench.command()
    bench.arm()
    for k in range(1, 5):
        bench.speeds = (float(k), 0.0, 0.0)
        (answer,) = stepped(bench, (0.25 * k, 0.0, 0.0))
        assert answer.message.raw == bench.speeds
        assert answer.message.acknowledged == bench.sequence
        assert answer.message.command_age == PERIOD
        assert flows(bench) == (0.25 * k, 0.0, 0.0)
        assert answer.time == round(k * PERIOD * 1e6)
        assert not bench.device.step_due


def test_in_lock_step_the_same_command_again_gets_the_same_answer_and_moves_nothing():
    bench = lock_step()
    bench.command()
    armed = bench.arm()
    again = bench.frame(Command((0.5, 0.0, 0.0), 0.0625))
    assert bench.deliver(again) == ()
    assert bench.deliver(again) == ()  # the period is not over yet
    assert bench.device.step_due
    answer = bench.tick()
    assert bench.deliver(again) == answer
    assert bench.deliver(again) == answer
    assert not bench.device.step_due
    assert bench.device.dropped == 0
    changed = bench.frame(Command((0.25, 0.0, 0.0), 0.0625), sequence=again.sequence)
    assert bench.deliver(changed) == ()
    assert bench.device.dropped == 1
    assert armed[0].message.status == Status.LOCK_STEP | Status.ARMED


def test_in_lock_step_a_refusal_is_repeated_too_and_a_real_time_device_repeats_nothing():
    for lock in (True, False):
        bench = Bench(lock_step=lock)
        bench.hello()
        bench.tick()
        frame = bench.frame(Command((9.0, 0.0, 0.0), 0.0625))
        first = bench.deliver(frame)
        assert codes(first) == [FaultCode.NOT_ARMED]
        assert bench.deliver(frame) == (first if lock else ())
        assert bench.device.dropped == (0 if lock else 1)
        assert bench.device.refused == 1


def test_in_lock_step_a_robot_that_was_stopped_rolls_out_under_zero_commands():
    bench = lock_step()
    bench.command()
    bench.arm()
    stepped(bench, (0.5, 0.0, 0.0))
    bench.give(Stop())
    assert flows(bench) == ZERO
    (answer,) = stepped(bench)
    assert answer.message.status == Status.LOCK_STEP
    assert codes(bench.command((0.5, 0.0, 0.0))) == [FaultCode.NOT_ARMED]
    assert not bench.device.step_due
    bench.command()
    bench.tick()
    assert len(bench.arm()) == 1
    assert bench.device.armed


def test_in_lock_step_reset_fault_is_answered():
    bench = lock_step()
    bench.command()
    bench.arm()
    answer = bench.command((9.0, 0.0, 0.0))
    assert codes(answer) == [FaultCode.CURRENT]
    (answer,) = bench.give(ResetFault())
    assert answer.message.fault is FaultCode.NONE


def test_in_lock_step_a_wheel_that_turns_too_fast_is_told_with_the_telemetry_of_that_step():
    bench = lock_step()
    bench.command()
    bench.arm()
    bench.command((0.5, 0.0, 0.0))
    answer = bench.tick((99.0, 0.0, 0.0))
    assert codes(answer) == [FaultCode.WHEEL_SPEED]
    assert answer[-1].message.fault is FaultCode.WHEEL_SPEED
    assert flows(bench) == ZERO


def test_in_lock_step_the_limits_hold_in_simulated_time():
    bench = lock_step()
    bench.command()
    bench.arm()
    for current in (1.0, 0.0, -1.0):
        stepped(bench, (current, 0.0, 0.0))
    assert codes(bench.command((0.25, 0.0, 0.0))) == [FaultCode.CURRENT_RATE]
    bench = Bench(lock_step=True, limits=with_limits(heating=16 * PERIOD * 2.0))
    bench.hello()
    bench.command()
    bench.device.tick(bench.now, ZERO)
    bench.command()
    bench.arm()
    stepped(bench, (0.0, 0.5, 0.0))
    for _ in range(16):
        stepped(bench, (0.0, 1.5, 0.0))
    assert codes(bench.command((0.0, 1.5, 0.0))) == [FaultCode.HEATING]


def test_in_lock_step_there_is_no_message_rate_since_time_stands_still():
    bench = lock_step()
    for k in range(1000):
        assert len(bench.give(Ping(k))) == 1
        assert len(bench.hello(nonce=k)) == 1


def test_after_49_days_of_telemetry_a_frame_still_has_a_number_that_its_field_holds():
    voice = Outbox(keyed=False)
    voice.begin(5)
    voice._said = 2**32 - 2  # at 1 kHz nobody waits for it
    for _ in range(3):
        voice.say(0.0, Pong(1))
    frames = voice.take()
    assert [frame.sequence for frame in frames] == [2**32 - 1, 0, 1]
    assert all(encode(frame) for frame in frames)
