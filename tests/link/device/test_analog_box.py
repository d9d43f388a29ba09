"""The dissertation's robot at an analog box: the same rules, volts out and volts in."""

import dataclasses
import itertools
import math

import pytest

from omnimj.errors import InputError
from omnimj.link.calibration import require_hardware
from omnimj.link.codec.messages import Arm, Command, FaultCode, Frame, Hello, Ping, Stop, Telemetry
from omnimj.link.device.analog import AnalogDevice
from omnimj.parameters import read_robot

WIRING = require_hardware(read_robot())
PERIOD = 0.001


class FakeBox:
    def __init__(self):
        self.inputs, self.outputs, self.broken = [0.0] * 16, None, False

    def read(self):
        if self.broken:
            raise OSError("unplugged")
        return self.inputs

    def write(self, volts):
        self.outputs = list(volts)


class Session:
    """Arms the device at a box and talks to it."""

    def __init__(self, wiring=WIRING):
        self.box, self.now, self.sequence = FakeBox(), 0.0, 0
        sessions = itertools.count(5)
        self.analog = AnalogDevice(self.box, wiring, PERIOD, lambda: next(sessions))
        (answer,) = self.analog.on_frame(0.0, Frame(Hello(1), 0, 1, 0))
        hello = Hello(1, answer.message.cookie, answer.message.device)
        (answer,) = self.analog.on_frame(0.0, Frame(hello, 0, 2, 0))
        self.capabilities, self.session = answer.message, answer.session
        self.give(Ping(0))
        (self.telemetry,) = self.tick()
        self.give(Command((0.0,) * 4, 0.05))
        capabilities = self.capabilities
        self.give(Arm(capabilities.limits_hash, capabilities.calibration_hash, self.telemetry.sequence))
        assert self.analog.device.armed

    def give(self, message):
        self.sequence += 1
        if isinstance(message, Command):
            message = dataclasses.replace(message, telemetry=self.newest)
        return self.analog.on_frame(self.now, Frame(message, self.session, self.sequence, 0))

    def tick(self):
        self.now += PERIOD
        answer = self.analog.tick(self.now)
        self.newest = answer[-1].sequence
        return answer


def test_at_first_the_outputs_are_at_zero():
    box = FakeBox()
    AnalogDevice(box, WIRING, PERIOD, lambda: 1)
    assert box.outputs == [0.0] * 4


def test_currents_become_volts_at_their_channels():
    outputs = tuple(dataclasses.replace(o, channel=o.wheel + 1, sign=-1) for o in WIRING.outputs)
    session = Session(dataclasses.replace(WIRING, outputs=outputs))
    session.give(Command((0.5, -0.25, 0.125, 1.0), 0.05))
    assert session.box.outputs == [0.0] * 6
    session.tick()
    assert session.box.outputs == [0.0, 0.0, 1.0, -0.5, 0.25, 2.0]


def test_readings_travel_as_volts():
    session = Session()
    session.box.inputs[:12] = [0.5 * k for k in range(12)]
    (frame,) = session.tick()
    assert isinstance(frame.message, Telemetry)
    assert frame.message.raw == tuple(0.5 * k for k in range(12))


def test_a_braked_wheel_gets_no_current_since_the_box_has_no_relays():
    session = Session()
    session.give(Command((0.0, 0.5, 0.0, 0.0), 0.05, brake=1))
    session.tick()
    assert session.box.outputs == [0.0, 1.0, 0.0, 0.0]


def test_a_stop_is_at_the_amplifiers_at_once():
    session = Session()
    session.give(Command((0.5,) * 4, 0.05))
    session.tick()
    assert session.box.outputs == [1.0] * 4
    session.analog.on_frame(session.now, Frame(Stop(), 0, 0, 0))
    assert session.box.outputs == [0.0] * 4


@pytest.mark.parametrize("cause", ["overspeed", "unplugged", "short"])
def test_a_wheel_that_is_too_fast_or_unknown_cuts_the_volts(cause):
    session = Session()
    session.give(Command((0.5,) * 4, 0.05))
    session.tick()
    if cause == "overspeed":
        session.box.inputs[6] = 9.95
    elif cause == "unplugged":
        session.box.broken = True
    else:
        session.box.inputs = session.box.inputs[:5]
    answer = session.tick()
    assert session.box.outputs == [0.0] * 4
    expected = FaultCode.WHEEL_SPEED if cause == "overspeed" else FaultCode.SENSOR
    assert session.analog.device.fault is expected
    assert len(answer[-1].message.raw) == 12
    assert math.isnan(answer[-1].message.raw[11]) == (cause != "overspeed")


def test_closing_leaves_zero_volts():
    session = Session()
    session.give(Command((0.5,) * 4, 0.05))
    session.tick()
    session.analog.close()
    session.analog.close()
    assert session.box.outputs == [0.0] * 4


def test_a_wiring_for_a_wire_is_refused():
    outputs = tuple(dataclasses.replace(o, unit="A/A") for o in WIRING.outputs)
    with pytest.raises(InputError, match=r"found a gain in A/A; an analog box needs V/A"):
        AnalogDevice(FakeBox(), dataclasses.replace(WIRING, outputs=outputs), PERIOD, lambda: 1)
