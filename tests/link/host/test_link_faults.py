"""What goes wrong on a link, in simulated time: motion ends within valid-for, with a reason, for good."""

from __future__ import annotations

import random

import numpy as np
import pytest
from nightly import checkerboard
from simulated_wire import WireFaults
from wired_devices import PERIOD, WIRING, World

from omnimj.errors import InputError, LinkLost
from omnimj.link.codec.frames import decode, encode
from omnimj.link.codec.messages import Arm, Command, FaultCode, Frame, Hello, Ping, Stop
from omnimj.link.device.server import is_stop
from omnimj.link.host.link import LinkMode
from omnimj.link.host.plant import HardwarePlant
from omnimj.link.host.state_machine import COMMAND_VALIDITY, HostState
from omnimj.signals import CurrentCommand

MOVE = CurrentCommand(np.full(4, 0.3))
LATEST = COMMAND_VALIDITY + 2.0 * PERIOD
KEY, OTHER_KEY = random.Random(1).randbytes(32), random.Random(2).randbytes(32)


def drive(world: World, steps: int) -> str:
    """So many steps; why they ended early, or nothing."""
    try:
        for _ in range(steps):
            world.plant.step(MOVE)
    except LinkLost as lost:
        return str(lost)
    return ""


def driving(**changed) -> World:
    world = World(**changed)
    world.plant.reset()
    assert drive(world, 30) == "" and world.moves
    return world


def expect_ended(world: World, since: float, within: float = LATEST) -> None:
    """No current since then, whatever the controller commands, and nothing moves again without a request."""
    world.advance(within + 0.01)
    assert world.last_motion() <= since + within
    for _ in range(3):
        with pytest.raises(LinkLost):
            world.plant.step(MOVE)
        world.advance(0.05)
    world.wire.set_faults(WireFaults(), WireFaults())
    world.advance(1.0)
    assert world.last_motion() <= since + within and not world.device.armed


@pytest.mark.slow
@pytest.mark.parametrize("way", ["to_device", "to_host", "both"])
def test_a_cut_of_a_second_ends_motion_within_valid_for_and_for_good(way):
    world = driving()
    begin = world.wire.now
    cut = WireFaults(cuts=((begin, begin + 1.0),))
    world.wire.set_faults(cut if way != "to_host" else None, cut if way != "to_device" else None)
    reason = drive(world, 300)
    words = {
        "to_device": ("acknowledged", "too old"),
        "to_host": ("telemetry is",),
        "both": ("telemetry is",),
    }
    assert any(word in reason for word in words[way]), reason
    assert world.wire.now - begin < 0.06
    expect_ended(world, begin)
    if way != "to_host":
        assert world.device.fault is FaultCode.COMMAND_TOO_OLD
    world.close()


def test_a_host_that_is_killed_leaves_a_robot_that_stands_within_valid_for():
    world = driving()
    begin = world.wire.now
    world.advance(1.0)  # not a frame more
    assert begin < world.last_motion() <= begin + LATEST
    assert world.device.fault is FaultCode.COMMAND_TOO_OLD and not world.device.armed
    world.close()


def test_a_device_that_restarts_gets_no_command_and_its_host_stops():
    world = driving()
    begin = world.wire.now
    world.power_up()
    reason = drive(world, 300)
    assert "telemetry is" in reason and world.wire.now - begin < 0.03
    assert not world.device.armed and world.device.session == 0
    expect_ended(world, begin, within=PERIOD)
    world.close()


@pytest.mark.slow
@pytest.mark.parametrize(("loss", "seed"), checkerboard((0.0, 0.01, 0.1, 0.3), (1, 2)))
def test_losses_either_let_the_robot_be_driven_or_stop_it_with_a_reason(loss, seed):
    world = driving(seed=seed)
    world.wire.set_faults(WireFaults(loss=loss), WireFaults(loss=loss))
    reason = drive(world, 1500)
    end = world.wire.now
    if loss == 0.0:
        assert reason == "" and world.plant.record.lost == 0
    elif loss == 0.3:
        assert "were lost" in reason or "acknowledged" in reason or "telemetry is" in reason, reason
    if reason:
        expect_ended(world, end)
    world.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("delay", "jitter"), [(0.002, 0.0), (0.005, 0.002), (0.1, 0.0), (0.0, 0.1), (0.05, 0.05)]
)
def test_delay_beyond_20_ms_stops_the_robot_and_a_little_does_not(delay, jitter):
    world = driving()
    begin = world.wire.now
    faults = WireFaults(delay=delay, jitter=jitter)
    world.wire.set_faults(faults, faults)
    reason = drive(world, 400)
    if max(delay, jitter) < 0.02 and jitter == 0.0:
        assert reason == ""
    if max(delay, jitter) > 0.02:
        assert reason != "" and world.wire.now - begin < 0.1
    if reason:
        # the stop itself is under way for as long as the wire delays it
        expect_ended(world, world.wire.now, within=max(LATEST, delay + jitter + PERIOD))
    world.close()


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.03, 0.1])
def test_a_link_that_is_slow_from_the_beginning_is_never_armed(delay):
    world = World(to_device=WireFaults(delay=delay), to_host=WireFaults(delay=delay))
    with pytest.raises(LinkLost, match=r"recent telemetry|does not"):
        world.plant.reset()
        world.plant.step(MOVE)
    world.advance(1.0)
    assert world.last_motion() < 0.0 and not world.device.armed
    world.close()


def test_a_host_with_another_key_or_none_gets_no_session():
    for own in (OTHER_KEY, None):
        world = World(key=own, device_key=KEY)
        with pytest.raises(LinkLost, match="does not answer"):
            world.plant.reset()
        assert world.device.session == 0 and world.device.dropped > 0
        world.close()


def test_a_replayed_capture_moves_nothing():
    world = driving(key=KEY)
    captured = [packet for _, packet in world.wire.host.sent]
    world.link.stop()
    world.advance(0.1)
    begin = world.wire.now
    for _ in range(3):
        for packet in captured:
            world.wire.inject(packet)
            world.advance(PERIOD / 4.0)
    assert world.last_motion() < begin and not world.device.armed
    # nor while the robot is driven: old numbers are dropped, and the host keeps the device
    world = driving(key=KEY)
    session, moves = world.device.session, world.device.output
    for packet in captured:
        if not is_stop(packet):
            world.wire.inject(packet)
    assert drive(world, 20) == ""
    assert world.device.session == session and world.device.output == moves
    assert world.device.dropped >= len(captured) // 2
    world.close()


def test_a_second_host_is_refused_as_the_device_is_busy_and_stops_nothing():
    world = driving()
    frames = [Frame(Hello(99), 0, 1, 0), Frame(Ping(1), 0, 2, 0), Frame(Command((0.0,) * 4, 0.05), 7, 3, 0)]
    for frame in [*frames, Frame(Arm(0, 0, 0), 7, 4, 0)]:
        world.wire.inject(encode(frame))
        assert drive(world, 3) == ""
    assert world.moves and world.link.host.state is HostState.ARMED
    # a link that finds the device busy leaves without the stop that would be obeyed
    second = world.host_link(world.wire.reconnect_host())
    before = len(world.wire.host.sent)
    with pytest.raises(LinkLost, match="another host"):
        second.connect()
    second.close()
    sent = [decode(packet) for _, packet in world.wire.host.sent[before:]]
    assert not any(isinstance(f, Frame) and isinstance(f.message, Stop) for f in sent)
    world.close()


def test_any_sender_may_stop_it_and_the_host_reports_it():
    world = driving()
    begin = world.wire.now
    world.wire.inject(encode(Frame(Stop(), 0, 0, 0)))
    assert drive(world, 30) in (
        "the device is no longer armed",
        "the device reports: not armed (0, limit 0)",  # of the command that was under way
    )
    expect_ended(world, begin, within=2.0 * PERIOD)
    world.close()


def test_only_a_new_request_drives_again_and_a_fault_must_be_reset():
    world = driving()
    world.advance(0.2)
    with pytest.raises(LinkLost):
        drive_on = HardwarePlant(world.host_link(world.wire.host), WIRING)
        drive_on.reset()
    drive_on.close()
    assert world.device.fault is FaultCode.COMMAND_TOO_OLD
    world.plant = HardwarePlant(world.host_link(world.wire.host), WIRING, reset_fault=True)
    world.plant.reset()
    assert not world.moves and drive(world, 30) == "" and world.moves
    world.close()


def test_a_rehearsing_host_commands_no_motion():
    world = World(mode=LinkMode.DRY_RUN)
    world.plant.reset()
    assert drive(world, 300) == "" and world.plant.step(MOVE).time > 0.25
    world.close()
    for _, packet in world.wire.host.sent:
        frame = decode(packet)
        assert isinstance(frame, Frame) and isinstance(frame.message, Hello | Ping | Command)
        assert not isinstance(frame.message, Command) or not any(frame.message.currents)
    assert world.last_motion() < 0.0 and not world.device.armed


@pytest.mark.parametrize("mode", [LinkMode.READONLY, LinkMode.DRY_RUN])
def test_in_lock_step_time_stands_still_for_a_host_that_does_not_drive(mode):
    with pytest.raises(InputError, match="lock-step"):
        World(mode=mode, lock_step=True)


def test_closing_stops_three_times_and_once_more_does_nothing():
    world = driving()
    before = len(world.wire.host.sent)
    world.plant.close()
    world.plant.close()
    sent = [decode(packet) for _, packet in world.wire.host.sent[before:]]
    assert [type(f.message) for f in sent if isinstance(f, Frame)] == [Stop] * 3
    world.advance(2.0 * PERIOD)
    assert not world.moves and not world.device.armed
    world.robot.close()


# --- in lock-step


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3])
def test_in_lock_step_losses_and_delays_change_nothing_but_the_time_it_takes(loss):
    runs = []
    for faults in (WireFaults(), WireFaults(loss=loss, delay=0.01, jitter=0.1 * (loss > 0.2))):
        world = World(lock_step=True, seed=4)
        first = world.plant.reset()
        world.wire.set_faults(faults, faults)
        run = [first, *(world.plant.step(MOVE) for _ in range(60))]
        runs.append([(m.time, *m.wheel_speed.tolist(), *m.current.tolist()) for m in run])
        assert (world.link.resent > 0) == (faults.loss > 0.0 or faults.jitter > 0.0)
        world.close()
    assert runs[0] == runs[1]


def test_in_lock_step_a_cut_is_waited_for_and_a_device_that_is_gone_is_not():
    world = World(lock_step=True)
    world.plant.reset()
    begin = world.wire.now
    cut = WireFaults(cuts=((begin, begin + 1.0),))
    world.wire.set_faults(cut, cut)
    assert drive(world, 3) == "" and world.wire.now - begin > 1.0
    world.power_up()
    assert "does not answer" in drive(world, 1)
    with pytest.raises(LinkLost):
        world.plant.step(MOVE)
    assert not world.moves
    world.close()


def test_in_lock_step_a_killed_host_keeps_the_device_for_five_seconds_only():
    world = World(lock_step=True)
    world.plant.reset()
    second = world.host_link(world.wire.reconnect_host())
    with pytest.raises(LinkLost, match="another host"):
        second.connect()
    world.advance(5.1)
    third = world.host_link(world.wire.reconnect_host())
    assert third.connect().lock_step
    assert not world.device.armed
    world.close()
