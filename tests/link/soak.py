"""Random schedules of everything that goes wrong on a link, in simulated time.

A schedule drives a robot and, at random times, loses, delays, duplicates and reorders packets, cuts the wire,
restarts the device, lets the host fall silent, and lets others without the key replay what they recorded,
forge stops and ask for the session. What may flow is judged by what the host has sent, never by what the
device believes.
"""

from __future__ import annotations

import random
from dataclasses import dataclass

import numpy as np
from simulated_wire import WireFaults
from wired_devices import PERIOD, World

from omnimj.errors import LinkLost
from omnimj.link.codec.frames import encode
from omnimj.link.codec.messages import Arm, Command, Frame, Hello, Stop
from omnimj.link.host.state_machine import COMMAND_VALIDITY
from omnimj.signals import CurrentCommand

LATEST = COMMAND_VALIDITY + PERIOD + World.QUANTUM
"""From the host's last command to zero current: valid_for and one period, seen once per quantum [s]."""
KEY = random.Random(5).randbytes(32)
MOVE = CurrentCommand(np.full(4, 0.25))
_STEPS, _QUIET = 400, 30
_EVENTS = ("faults", "clear", "cut", "restart", "replay", "stop", "other host", "silence")


@dataclass
class Outcome:
    """What one schedule showed."""

    events: tuple[str, ...]
    unasked: float = 0.0
    """Longest time for which current flowed after the host's last move command had ended [s]."""
    steps: int = 0
    """Commands of the host that moved the robot."""
    reason: str = ""
    """Why the host stopped; empty if it drove to the end."""


def _faults(rng: random.Random) -> WireFaults:
    return WireFaults(
        loss=rng.choice((0.0, 0.02, 0.2, 0.6)),
        delay=rng.choice((0.0, 0.002, 0.02, 0.3)),
        jitter=rng.choice((0.0, 0.003, 0.05)),
        duplication=rng.choice((0.0, 0.3)),
    )


class Schedule:
    """One random schedule."""

    def __init__(self, seed: int):
        self._rng = random.Random(seed)
        self.world = World(key=KEY, seed=seed)
        self.asked: list[float] = []
        """Times of the host's move commands [s]."""

    def run(self) -> Outcome:
        rng, world = self._rng, self.world
        found = Outcome(())
        try:
            world.plant.reset()
            for step in range(_STEPS):
                if step > _QUIET and rng.random() < 0.02:
                    found.events += (self._happen(rng.choice(_EVENTS)),)
                self.asked.append(world.wire.now)
                world.plant.step(MOVE)
                self.asked.append(world.wire.now)
                found.steps += world.moves
        except LinkLost as lost:
            found.reason = str(lost)
        for name in rng.sample(_EVENTS, 3):  # and afterwards, when nothing may move
            self._happen(name)
            world.advance(0.15)
        found.unasked = self._unasked()
        world.close()
        return found

    def _happen(self, name: str) -> str:
        rng, world, now = self._rng, self.world, self.world.wire.now
        if name == "faults":
            world.wire.set_faults(_faults(rng), _faults(rng))
        elif name == "clear":
            world.wire.set_faults(WireFaults(), WireFaults())
        elif name == "cut":
            cut = WireFaults(cuts=((now, now + rng.uniform(0.005, 0.2)),))
            world.wire.set_faults(*rng.choice(((cut, None), (None, cut), (cut, cut))))
        elif name == "restart":
            world.power_up()
        elif name == "replay":
            recorded = world.wire.host.sent
            for _, packet in rng.sample(recorded, min(len(recorded), 40)):
                world.wire.inject(packet)
        elif name == "stop":
            world.wire.inject(encode(Frame(Stop(), rng.getrandbits(32), rng.getrandbits(31), 0)))
        elif name == "other host":
            self._ask_without_the_key()
        else:
            world.advance(rng.uniform(0.0, 0.2))
        return name

    def _ask_without_the_key(self) -> None:
        rng, device = self._rng, self.world.device
        messages = (
            Hello(rng.getrandbits(64), rng.getrandbits(64), rng.getrandbits(64)),
            Arm(rng.getrandbits(64), rng.getrandbits(64), rng.getrandbits(32)),
            Command((0.3,) * 4, 0.05, 0, rng.getrandbits(32)),
        )
        for message in messages:
            session = rng.choice((device.session, rng.getrandbits(32)))
            self.world.wire.inject(encode(Frame(message, session, rng.getrandbits(31), 0)))

    def _unasked(self) -> float:
        """Longest time for which current flowed beyond the life of the last command before it [s]."""
        asked, worst = np.array([-1e9, *self.asked]), 0.0
        for time, flows in self.world.flowed:
            if flows:
                last = asked[np.searchsorted(asked, time, side="right") - 1]
                worst = max(worst, time - last - LATEST)
        return worst


def soak(seeds: range) -> list[Outcome]:
    """Run the schedules of some seeds."""
    return [Schedule(seed).run() for seed in seeds]
