"""Two-way freshness: nothing is kept or sent for a sender that has not returned a cookie and then spoken."""

from __future__ import annotations

import dataclasses

import pytest
from device_driver import CALIBRATION_HASH, IDENTITY, PERIOD, ZERO, DeviceDriver, codes
from sample_frames import KEY

from omnimj.link.codec.frames import encode
from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    Challenge,
    Command,
    Fault,
    FaultCode,
    Frame,
    Hello,
    Ping,
    Stop,
    Telemetry,
)
from omnimj.link.device.state_machine import SESSION_TIMEOUT

HOST, OTHER = b"host", b"other"


def test_a_first_hello_gets_a_challenge_and_leaves_no_trace():
    driver = DeviceDriver()
    for nonce in range(100):
        (answer,) = driver.give(Hello(nonce), session=0)
        assert isinstance(answer.message, Challenge)
        assert (answer.message.nonce, answer.message.device) == (nonce, IDENTITY)
        assert (answer.session, answer.sequence, driver.device.session) == (0, 0, 0)
    assert driver.tick(periods=5) == ()


@pytest.mark.parametrize("key", [None, KEY])
def test_no_answer_to_a_sender_without_cookie_is_longer_than_its_hello(key):
    hello = Frame(Hello(1), 0, 1, 0)
    busy = Frame(Fault(FaultCode.BUSY, 0, 0.0, 0.0, 0, False), 0, 0, 0)
    challenge = Frame(Challenge(1, 2, 3), 0, 0, 0)
    assert len(encode(challenge, key)) == len(encode(hello, key)) > len(encode(busy, key))


def test_a_cookie_is_good_for_its_sender_nonce_and_device_only():
    driver = DeviceDriver()
    right = driver.ask(peer=HOST)
    wrong = [
        (right, OTHER),
        (right, b""),
        (dataclasses.replace(right, nonce=8), HOST),
        (dataclasses.replace(right, cookie=right.cookie ^ 1), HOST),
        (dataclasses.replace(right, device=IDENTITY ^ 1), HOST),
    ]
    for hello, peer in wrong:
        (answer,) = driver.enter(hello, peer)
        assert isinstance(answer.message, Challenge) and driver.device.session == 0
    (answer,) = driver.enter(right, HOST)
    assert isinstance(answer.message, Capabilities)


def test_a_cookie_expires():
    for waited, expected in ((2.0, Capabilities), (4.0, Challenge)):
        driver = DeviceDriver()
        hello = driver.ask()
        driver.now += waited
        (answer,) = driver.enter(hello)
        assert isinstance(answer.message, expected)


def test_a_recorded_handshake_begins_nothing_once_it_has_been_used_or_after_power_up():
    driver = DeviceDriver()
    recorded = driver.ask(peer=HOST)
    driver.enter(recorded, HOST)
    driver.give(Ping(1), HOST)
    session = driver.device.session
    for peer in (HOST, OTHER):
        for _ in range(50):
            (answer,) = driver.device.on_frame(driver.now, Frame(recorded, 0, 1, 0), peer)
            assert isinstance(answer.message, Challenge)
    assert driver.device.session == session
    again = DeviceDriver()
    again.device._handshake._secret = b"drawn at the next power-up"
    (answer,) = again.enter(recorded, HOST)
    assert isinstance(answer.message, Challenge)


def test_replayed_hellos_neither_take_the_session_nor_keep_its_host_from_arming():
    driver = DeviceDriver(keyed=True)
    first = driver.frame(Hello(3), session=0)
    for _ in range(50):
        assert isinstance(driver.deliver(first, OTHER)[0].message, Challenge)
    driver.hello(peer=HOST)
    driver.give(Ping(0), HOST)
    for _ in range(10):
        driver.tick()
        assert isinstance(driver.deliver(first, OTHER)[0].message, Challenge)
    driver.give(Command(ZERO, 0.05, 0, driver.newest), HOST)
    driver.give(Arm(driver.limits_hash, CALIBRATION_HASH, driver.newest), HOST)
    assert driver.device.armed


def test_a_session_is_silent_until_its_host_has_spoken():
    driver = DeviceDriver()
    driver.hello()
    assert driver.tick(periods=100) == ()
    driver.give(Ping(0), authentic=False, sequence=0)  # an old number is no valid frame
    assert driver.tick() == ()
    driver.give(Ping(0))
    assert isinstance(driver.tick()[0].message, Telemetry)


def test_a_stream_ends_a_second_after_the_last_valid_frame():
    driver = DeviceDriver().begin()
    last = driver.now
    while driver.tick():
        pass
    assert last + SESSION_TIMEOUT < driver.now <= last + SESSION_TIMEOUT + 2.0 * PERIOD
    assert driver.device.session == 0 and not driver.device.armed
    dropped = driver.device.dropped
    assert driver.give(Ping(1)) == () and driver.device.dropped == dropped + 1


def test_frames_that_are_not_of_the_session_do_not_keep_it_alive():
    driver = DeviceDriver(keyed=True).begin()
    for _ in range(1100):
        driver.tick()
        driver.give(Ping(0), authentic=False)
        driver.give(Ping(0), session=driver.session ^ 1)
        driver.give(Ping(0), OTHER)
        driver.give(Stop(), authentic=False)
        driver.device.on_invalid_packet(driver.now)
    assert driver.device.session == 0


def test_frames_of_the_session_from_another_address_are_dropped():
    driver = DeviceDriver()
    driver.hello(peer=HOST)
    driver.give(Ping(0), HOST)
    driver.tick()
    assert driver.give(Command(ZERO, 0.05, 0, driver.newest), OTHER) == ()
    driver.tick()
    assert (driver.telemetry.acknowledged, driver.telemetry.dropped) == (0, 1)
    driver.give(Stop(), OTHER)
    assert driver.device.stopped


def test_busy_takes_a_cookie_and_with_a_key_a_tag():
    driver = DeviceDriver(keyed=True).driving()
    assert driver.give(Hello(5), session=0, authentic=False) == ()
    (answer,) = driver.give(Hello(5), session=0)
    assert isinstance(answer.message, Challenge)
    found = answer.message
    with_cookie = Hello(5, found.cookie, found.device)
    assert driver.enter(with_cookie, authentic=False) == ()
    assert codes(driver.enter(with_cookie)) == [FaultCode.BUSY]
    assert driver.device.armed


def test_the_connection_changes_with_every_session_and_every_power_up():
    seen = set()
    for _ in range(3):
        driver = DeviceDriver()
        driver.device._handshake._secret = bytes([len(seen)]) * 32
        for nonce in (1, 1, 2):
            driver.begin(nonce)
            seen.add(driver.device.connection)
            assert driver.device.connection[:8] == IDENTITY.to_bytes(8, "little")
    assert len(seen) == 9
