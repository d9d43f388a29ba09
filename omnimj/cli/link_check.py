"""`omnimj link check`: what a careful person does with a new robot before it drives, in the right order."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import ADDRESS, ROBOT_MODEL, add_clock, add_key
from omnimj.cli.terminal import format_table
from omnimj.errors import InputError, LinkLost

if TYPE_CHECKING:
    from omnimj.link.check.wiring import WiringFinding
    from omnimj.link.host.link import Link
    from omnimj.link.host.plant import HardwarePlant
    from omnimj.parameters import Robot

HELP = "check a robot on the bench: link, watchdog, stop, and sign and gain of every channel"
EXAMPLE = """examples:
  omnimj link check --plant serial:/dev/ttyACM0?baud=921600
  omnimj link check --plant udp:127.0.0.1:9750 --on-floor --yes

With the wheels off the floor you are asked which way each wheel turns: no channel can tell a motor that turns
the other way from a sensor that reads the other way. With --on-floor the body tells: leave half a metre."""
DEFAULT_CURRENT = 0.8
"""Largest current of the small motions unless told otherwise [A]."""
_RESTS = 0.5  # [s]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the sub-command."""
    parser.add_argument("--plant", metavar="P", required=True, help=ADDRESS)
    add_key(parser)
    add_clock(parser)
    words = "the robot stands on the floor and may move by a few centimetres, and turn by some degrees"
    parser.add_argument("--on-floor", action="store_true", help=words)
    words = "ask nothing: the robot is ready, and nobody looks which way its wheels turn"
    parser.add_argument("--yes", action="store_true", help=words)
    words = f"largest current (default {DEFAULT_CURRENT:g} A, at most the device's limit)"
    parser.add_argument("--current", metavar="A", type=_current, default=DEFAULT_CURRENT, help=words)
    words = "the fault that the device has latched has been seen and may be reset"
    parser.add_argument("--reset-fault", action="store_true", help=words)
    parser.add_argument("--model", metavar="FILE", type=Path, help=ROBOT_MODEL)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def _current(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value <= 10.0:
        raise argparse.ArgumentTypeError(f"found {text[:40]!r}; must be above 0 and at most 10")
    return value


def run(arguments: Any) -> int:
    """Checks, step by step; what can break something comes last.

    Returns:
      0 when all is as it should be, else 1.

    Raises:
      InputError: No wire at that address, no [hardware], or nobody who could be asked.
    """
    from omnimj.parameters import read_robot
    from omnimj.simulate.plants import is_link_address

    if not is_link_address(arguments.plant):
        raise InputError("--plant", f"found {arguments.plant!r}", f"must be {ADDRESS}")
    robot = read_robot(arguments.model)
    if not arguments.yes:
        _require_ready(arguments.on_floor)
    check = _Check(arguments, robot)
    try:
        check.all()
    finally:
        check.close()
    return check.tell()


def _require_ready(on_floor: bool) -> None:
    """Asks whether the robot may be moved.

    Raises:
      InputError: It may not, or there is nobody to be asked.
    """
    if not sys.stdin.isatty():
        raise InputError("link check", "there is no terminal to ask at", "--yes says that the robot is ready")
    words = "half a metre of room around it, on the floor" if on_floor else "its wheels off the floor"
    if _prompt(f"Is the robot at rest, with {words}, and a hand at the switch? [y/n] ") != "y":
        raise InputError("link check", "the robot is not ready", "nothing was moved")


def _prompt(question: str) -> str:
    print(question, end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower()[:1]


class _Check:
    """The steps, and what they found: name, what was found, whether it is right (None: not judged)."""

    def __init__(self, arguments: Any, robot: Robot):
        from omnimj.link.calibration import require_hardware
        from omnimj.link.host.link import open_link
        from omnimj.link.host.plant import HardwarePlant

        self._arguments, self._robot, self._hardware = arguments, robot, require_hardware(robot)
        self._rows: list[tuple[str, str, bool | None]] = []
        self._findings: list[WiringFinding] = []
        self._link: Link = open_link(
            arguments.plant, robot, key_file=arguments.key_file, lock_step=arguments.lock_step
        )
        self._plant: HardwarePlant = HardwarePlant(self._link, self._hardware)

    def close(self) -> None:
        """Stops and ends the link."""
        self._plant.close()

    def all(self) -> None:
        """Every step; one that fails ends the check, since the next would rely on it."""
        steps = (self._session, self._rates, self._stop, self._silence, self._wiring)
        for step in steps:
            try:
                step()
            except LinkLost as error:
                self._add(step.__name__.strip("_"), str(error), False)
                return

    def _add(self, name: str, found: str, is_right: bool | None) -> None:
        self._rows.append((name, found, is_right))
        print(f"{name}: {found}", file=sys.stderr, flush=True)

    def _session(self) -> None:
        found = self._link.connect()
        limits = found.limits
        words = f"{found.wheels} wheels, {len(found.channels)} channels, {1e3 * found.period:g} ms; "
        words += (
            f"limits {limits.current:g} A, {limits.wheel_speed:g} rad/s, valid for {limits.valid_for:g} s"
        )
        self._add("session", words, True)
        fault = self._link.reading.telemetry.fault
        if fault:
            words = fault.name.lower().replace("_", " ")
            if not self._arguments.reset_fault:
                self._link.stop(f"{words} is latched; --reset-fault says that it has been seen")
                self._link.host.require_link()
            self._link.reset_fault()
            self._add("latched fault", f"{words}, reset", None)
        if self._arguments.current > limits.current:
            raise InputError(
                "--current", f"found {self._arguments.current:g}", f"at most {limits.current:g} A"
            )

    def _rates(self) -> None:
        from omnimj.link.check.communication import measure_rates

        if self._arguments.lock_step:
            return self._add("rates, stop, silence", "not judged: in lock-step time stands still", None)
        rates = measure_rates(self._link)
        words = f"{rates.received} of {rates.expected:.0f} readings in {1.0:g} s, {rates.lost} lost, "
        words += f"longest gap {1e3 * rates.longest:.3g} ms, round trip {1e3 * rates.round_trip:.3g} ms"
        self._add("rates", words, 0.98 * rates.expected <= rates.received and rates.lost <= 2)
        return None

    def _stop(self) -> None:
        from omnimj.link.check.communication import TIME_TOLERANCE, check_stop

        if not self._arguments.lock_step:
            trip = check_stop(self._link)
            words = f"disarmed {1e3 * trip.after:.3g} ms after the stop was sent"
            self._add("stop", words, trip.after < TIME_TOLERANCE and not trip.flows)
            self._link.connect()

    def _silence(self) -> None:
        from omnimj.link.check.communication import TIME_TOLERANCE, check_watchdog, is_fault_latched
        from omnimj.link.codec.messages import FaultCode
        from omnimj.link.host.state_machine import COMMAND_VALIDITY

        if self._arguments.lock_step:
            return
        trip = check_watchdog(self._link)
        words = (
            f"current ended {1e3 * trip.after:.3g} ms after the last command, valid for "
            f"{1e3 * COMMAND_VALIDITY:g}"
        )
        is_right = trip.fault is FaultCode.COMMAND_TOO_OLD and not trip.flows
        self._add("silence", words, is_right and trip.after < COMMAND_VALIDITY + TIME_TOLERANCE)
        latched = is_fault_latched(self._link)
        self._add("latched", "arm is refused until the fault is reset" if latched else "it is not", latched)
        self._link.connect()
        self._link.reset_fault()

    def _wiring(self) -> None:
        from omnimj.link.check.motions import MotionSequence
        from omnimj.link.check.wiring import judge_wiring

        pulses = MotionSequence(
            self._plant, self._arguments.current, lambda words: print(words, file=sys.stderr)
        )
        still = pulses.rest(_RESTS)
        single, seen = [], {}
        for wheel in range(len(self._robot.wheels)):
            single += [pulses.one(wheel, 1.0)]
            if not self._arguments.on_floor and not self._arguments.yes:
                answer = self._asked(wheel)
                seen |= {} if answer is None else {wheel: answer}
            single += [pulses.one(wheel, -1.0)]
        turns = [pulses.turn(sign) for sign in (1.0, -1.0)] if self._arguments.on_floor else []
        self._findings = judge_wiring(self._robot, still, single, turns, seen)
        for finding in self._findings:
            self._add(finding.place, finding.words, False)
        if not self._findings:
            self._add("wiring", "every channel and motor has the right sign, and gains agree", True)
        if not turns:
            self._add("yaw rate, yaw, acceleration", "signs not judged: the body did not move", None)
        self._add("gain of the accelerometer", "not judged", None)

    def _asked(self, wheel: int) -> int | None:
        """What a person saw; meanwhile the robot is stopped, since nobody talks to it."""
        where = _direction(*self._robot.wheels[wheel].drives_along)
        self._plant.link.stop("a person is asked")
        answer = _prompt(
            f"Did wheel {wheel + 1} turn as if to push the robot {where}? [y/n, Enter: not seen] "
        )
        self._plant.reset()
        return {"y": 1, "n": -1}.get(answer)

    def tell(self) -> int:
        """Prints the result.

        Returns:
          The exit code.
        """
        wrong = sum(is_right is False for *_, is_right in self._rows)
        if self._arguments.json:
            steps = [{"step": n, "found": f, "ok": ok} for n, f, ok in self._rows]
            wiring = [{"place": f.place, "kind": f.kind, "words": f.words} for f in self._findings]
            print(json.dumps({"passed": not wrong, "steps": steps, "wiring": wiring}, indent=2))
        else:
            marks = {True: "ok", False: "WRONG", None: ""}
            print(format_table(("step", "found", ""), [(n, f, marks[ok]) for n, f, ok in self._rows]))
            print(f"\nfailed: {wrong} of {len(self._rows)} steps" if wrong else "\npassed")
        return 1 if wrong else 0


def _direction(x: float, y: float) -> str:
    """A direction of the body in words."""
    names = ("ahead", "to the left", "back", "to the right")
    quarter = math.atan2(y, x) / (0.5 * math.pi)
    if abs(quarter - round(quarter)) < 0.1:
        return names[round(quarter) % 4]
    return f"at {math.degrees(math.atan2(y, x)):.0f}° to the left of ahead"
