"""Model of all that can happen in a session: a host, a second one, an attacker, and the real device.

A state is the device with what the others know. Time goes in whole periods. The property is judged by what
was sent and when, never by what the device believes.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

from device_driver import CALIBRATION_HASH, CHANNELS, IDENTITY, ZERO, with_limits

from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    Challenge,
    Command,
    Fault,
    Frame,
    Hello,
    Message,
    Ping,
    Reset,
    Stop,
    Telemetry,
)
from omnimj.link.device.config import DeviceConfig, limits_hash
from omnimj.link.device.limits import MAX_TELEMETRY_AGE, round_to_float32
from omnimj.link.device.state_machine import SESSION_TIMEOUT, Device

PERIOD = 2.0**-7
"""Longer than any robot's, so that few periods make a limit [s]."""
VALID_FOR = 3
"""Lifetime of every command [periods]."""
MOVE = (0.25, 0.0, 0.0)
LIMITS = with_limits(valid_for=VALID_FOR * PERIOD, heating=1e6, message_rate=1e6)
HASHES = limits_hash(round_to_float32(LIMITS)), CALIBRATION_HASH
SILENCE = round(SESSION_TIMEOUT / PERIOD) + 1
RECORDED = 8
"""Number of frames that the attacker keeps."""
HOST, SECOND = b"host", b"second"
SESSIONS = itertools.count(1)
T = TypeVar("T")
LONGEST_AGE = max(VALID_FOR, math.floor(MAX_TELEMETRY_AGE / PERIOD)) + 2
"""Older telemetries and commands are all alike [periods]."""


def powered_up(number: int, now: int) -> Device:
    """The device after power-up `number`, with a secret and session numbers that it has not had before."""
    config = DeviceConfig(3, PERIOD, CHANNELS, LIMITS, CALIBRATION_HASH, keyed=True, identity=IDENTITY)
    secret = number.to_bytes(32, "little")
    return Device(config, lambda now, raw: tuple(raw), lambda: next(SESSIONS), now * PERIOD, secret=secret)


def alike(thing: T) -> T:
    """Shallow copy of an object without slots; `copy.copy` takes half the time of a search."""
    new = object.__new__(type(thing))
    new.__dict__.update(thing.__dict__)
    return new


def copied(device: Device) -> Device:
    """A device with the same state; parts that never change are shared."""
    new = alike(device)
    for name in ("_outbox", "_handshake", "_limiter", "_hello_limiter"):
        setattr(new, name, alike(getattr(device, name)))
    new._outbox._queue = list(device._outbox._queue)
    new._outbox._telemetry_times = device._outbox._telemetry_times.copy()
    return new


def kind(frame: Frame) -> str:
    """Type of a frame of the host; commands of other currents are of another type."""
    currents = frame.message.currents if isinstance(frame.message, Command) else ""
    return f"{type(frame.message).__name__} {currents}"


@dataclass
class Permission:
    """What may flow by the rules, from what was sent: an account beside the device."""

    must_reset: bool = False
    is_armed: bool = False
    move_answers: int | None = None
    """Time of the newest telemetry that a move command since arming has answered [periods]."""

    def withdraw(self, must_reset: bool) -> None:
        self.must_reset, self.is_armed, self.move_answers = self.must_reset or must_reset, False, None


@dataclass
class State:
    """Device, host, attacker, and what is permitted."""

    device: Device
    now: int = 0
    power_ups: int = 1
    session: int = 0
    """Session of the host, 0: none."""
    sequence: int = 0
    seen: tuple[tuple[int, int], ...] = ()
    """Sequences and times of the newest and the oldest telemetry that the host has received."""
    held: Frame | None = None
    """A move command that is under way."""
    recorded: tuple[Frame, ...] = ()
    """Newest delivered frame of each kind and session."""
    permission: Permission = dataclasses.field(default_factory=Permission)

    def copy(self) -> State:
        new = alike(self)
        new.device, new.permission = copied(self.device), alike(self.permission)
        return new

    # --- delivery

    def give(self, frame: Frame, peer: bytes = HOST) -> tuple[Frame, ...]:
        answer = self.device.on_frame(self.now * PERIOD, frame, peer)
        self.account(answer)
        return answer

    def deliver(self, frame: Frame) -> tuple[Frame, ...]:
        """A frame of the host arrives, and the attacker records it."""
        others = [one for one in self.recorded if (kind(one), one.session) != (kind(frame), frame.session)]
        self.recorded = (*others, frame)[-RECORDED:]
        self.permit(frame)
        return self.give(frame)

    def permit(self, frame: Frame) -> None:
        """What a frame of the host, delivered for the first time, permits at most."""
        permission, message = self.permission, frame.message
        if frame.session != self.device.session:
            return
        if isinstance(message, Reset):
            permission.must_reset = False
        elif isinstance(message, Arm) and not permission.must_reset:
            permission.is_armed = True
        elif isinstance(message, Command) and message.currents == MOVE and permission.is_armed:
            before = permission.move_answers
            permission.move_answers = frame.time if before is None else max(before, frame.time)

    def account(self, answer: tuple[Frame, ...]) -> None:
        """Latched faults and new sessions withdraw every permission."""
        for frame in answer:
            if isinstance(frame.message, Fault) and frame.message.latched:
                self.permission.withdraw(must_reset=True)
            if isinstance(frame.message, Capabilities) and frame.sequence == 1:
                self.permission.withdraw(must_reset=False)

    def say(self, message: Message) -> None:
        if self.session:
            self.deliver(self.framed(message))

    def framed(self, message: Message) -> Frame:
        """A new frame; its time, which no device looks at, is that of the telemetry that it answers."""
        self.sequence += 1
        answers = dict(self.seen).get(getattr(message, "telemetry", 0), -SILENCE)
        return Frame(message, self.session, self.sequence, answers, authentic=True)

    def elapse(self, periods: int, is_heard: bool = True) -> None:
        """Periods in which the device ticks, and the host receives telemetry or not."""
        for _ in range(periods):
            self.now += 1
            self.tick(is_heard)

    def tick(self, is_heard: bool = True) -> None:
        answer = self.device.tick(self.now * PERIOD, ZERO)
        self.account(answer)
        news = [(f.sequence, self.now) for f in answer if isinstance(f.message, Telemetry)]
        if news and is_heard and self.device.session == self.session:
            self.seen = (news[-1], self.seen[-1] if self.seen else news[-1])

    # --- judgement

    def is_right(self) -> bool:
        """No current without a fresh command of the armed session."""
        if not any(self.device.output.currents):
            return True
        answers = self.permission.move_answers
        return self.permission.is_armed and answers is not None and self.now - answers <= VALID_FOR

    def key(self) -> tuple:
        """All that decides about the future; numbers that are only compared count by their order."""
        d, now = self.device, self.now

        def age(time: float) -> int:
            return min(round(now - time / PERIOD), LONGEST_AGE)

        times = {number: age(time) for number, time in d._outbox._telemetry_times}
        known = tuple((times.get(n, LONGEST_AGE), n > d._latched_at) for n, _ in self.seen)
        permission = self.permission
        allowed = -1 if permission.move_answers is None else min(now - permission.move_answers, LONGEST_AGE)
        return (
            *(d.armed, d.stopped, d.fault, d._currents, d._command.currents, d._command.valid_for > 0.0),
            *(age(d._lives_from), d.session == self.session, d.session != 0, d._is_confirmed),
            *(d._handshake.peer, known, frozenset(self.fate(f) for f in self.recorded)),
            self.held and (self.fate(self.held), times.get(self.held.message.telemetry, LONGEST_AGE)),
            *(permission.must_reset, permission.is_armed, allowed),
        )

    def fate(self, frame: Frame) -> tuple:
        """What a frame would meet that is delivered now; those of other sessions are all alike."""
        is_new = frame.sequence > self.device._last_sequence
        return (kind(frame), is_new) if frame.session == self.device.session else ()


# --- what can happen


def connect(state: State, peer: bytes = HOST) -> None:
    """Hello, challenge, hello with the cookie; the recorded hello is the one that began the session."""
    state.sequence += 1
    nonce = 100 * state.power_ups + state.sequence
    answer = state.give(Frame(Hello(nonce), 0, 1, 0, authentic=True), peer)
    (challenge,) = (f.message for f in answer if isinstance(f.message, Challenge))
    hello = Frame(Hello(nonce, challenge.cookie, challenge.device), 0, 2, 0, authentic=True)
    answer = state.deliver(hello) if peer == HOST else state.give(hello, peer)
    for frame in answer:
        if isinstance(frame.message, Capabilities) and peer == HOST:
            state.session, state.sequence, state.seen, state.held = frame.session, 0, (), None


def second_host(state: State) -> None:
    """Another host with the key connects and tries to drive at once."""
    before = state.device.session
    connect(state, SECOND)
    if state.device.session not in (0, before):
        for sequence, message in enumerate((Ping(0), Command(MOVE, VALID_FOR * PERIOD, 0, 1)), start=1):
            state.give(Frame(message, state.device.session, sequence, 0, authentic=True), SECOND)


def restart(state: State) -> None:
    """The supply fails; the device's clock begins where the model's is."""
    state.power_ups += 1
    state.device = powered_up(state.power_ups, state.now)
    state.permission = Permission()


def stop(state: State) -> None:
    state.permission.withdraw(must_reset=True)
    state.give(Frame(Stop(), 0, 0, 0))


def silence(state: State) -> None:
    state.now += SILENCE
    state.tick()


def replay(state: State) -> None:
    """The attacker sends all that was recorded, in its order, from the host's address."""
    for frame in state.recorded:
        state.give(frame)


def move(state: State, answers: int = 0) -> None:
    if state.seen:
        state.say(Command(MOVE, VALID_FOR * PERIOD, 0, state.seen[answers][0]))


def hold(state: State) -> None:
    if state.seen and state.session:
        state.held = state.framed(Command(MOVE, VALID_FOR * PERIOD, 0, state.seen[0][0]))


def release(state: State) -> None:
    if state.held is not None:
        frame, state.held = state.held, None
        state.deliver(frame)


def newest(state: State) -> int:
    return state.seen[0][0] if state.seen else 0


EVENTS: dict[str, Callable[[State], None]] = {
    "hello": connect,
    "ping": lambda state: state.say(Ping(0)),
    "zero command": lambda state: state.say(Command(ZERO, VALID_FOR * PERIOD, 0, newest(state))),
    "arm": lambda state: state.say(Arm(*HASHES, newest(state))),
    "move": move,
    "move that answers an old telemetry": lambda state: move(state, -1),
    "command beyond a limit": lambda state: state.say(
        Command((9.0, 0.0, 0.0), VALID_FOR * PERIOD, 0, newest(state))
    ),
    "move is delayed": hold,
    "delayed move arrives": release,
    "reset": lambda state: state.say(Reset(newest(state))),
    "stop": stop,
    "period": lambda state: state.elapse(1),
    "period whose telemetry is lost": lambda state: state.elapse(1, is_heard=False),
    "loss for longer than valid_for": lambda state: state.elapse(VALID_FOR + 1, is_heard=False),
    "silence": silence,
    "replay": replay,
    "second host": second_host,
    "restart": restart,
}


def mode(device: Device) -> str:
    """State of the device in one word."""
    if device.armed:
        return "driving" if any(device.output.currents) else "armed"
    if device.session == 0:
        return "idle"
    return "faulty" if device.fault else "stopped" if device.stopped else "disarmed"


@dataclass
class Exploration:
    """Result of an exhaustive search."""

    states: int
    moving: int
    """States in which current flows."""
    counterexample: tuple[str, ...]
    """Shortest sequence of events to a forbidden state; empty if there is none."""
    events: frozenset[str]
    """Events that have led to a state that was not known."""
    transitions: frozenset[tuple[str, str, str]]
    """Mode before, event, mode after, where they differ."""


def at_power_up() -> State:
    return State(powered_up(1, 0))


def driving() -> State:
    """Shortest way to a moving robot, where the search begins besides power-up."""
    state = State(powered_up(1, 0))
    for name in ("hello", "ping", "period", "zero command", "arm", "move", "period"):
        EVENTS[name](state)
    assert any(state.device.output.currents)
    return state


def explore(depth: int, begin: Callable[[], State]) -> Exploration:
    """Breadth-first search over all sequences of events; states with the same key are visited once."""
    first = begin()
    queue: deque[tuple[State, tuple[str, ...]]] = deque([(first, ())])
    known, moving, fruitful, transitions = {first.key()}, 0, set(), set()
    while queue:
        state, path = queue.popleft()
        for name, after in _followers(state):
            if not after.is_right():
                return Exploration(
                    len(known), moving, (*path, name), frozenset(fruitful), frozenset(transitions)
                )
            if (before := mode(state.device)) != (then := mode(after.device)):
                transitions.add((before, name, then))
            key = after.key()
            if key in known:
                continue
            known.add(key)
            fruitful.add(name)
            moving += any(after.device.output.currents)
            if len(path) + 1 < depth:
                queue.append((after, (*path, name)))
    return Exploration(len(known), moving, (), frozenset(fruitful), frozenset(transitions))


@functools.cache
def explored(depth: int, begin: Callable[[], State]) -> Exploration:
    """What `explore` finds of the device as it is, searched once for all that ask."""
    return explore(depth, begin)


def _followers(state: State) -> Iterator[tuple[str, State]]:
    for name, happen in EVENTS.items():
        after = state.copy()
        happen(after)
        yield name, after
