"""`omnimj link check` and `omnimj link fuzz`: tests of the link to a robot."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import (
    ADDRESS,
    NO_ANSWER,
    ROBOT_MODEL,
    Command,
    add_clock,
    add_key,
    add_reset_fault,
    add_seed,
    exit_code,
    positive_number,
    whole_number,
)
from omnimj.cli.progress import progress_bar
from omnimj.cli.terminal import format_table
from omnimj.errors import InputError, LinkLost, NoAnswer

if TYPE_CHECKING:
    from omnimj.link.check.fuzz import FuzzReport
    from omnimj.link.check.wiring import WiringFinding
    from omnimj.link.host.link import Link
    from omnimj.link.host.plant import HardwarePlant
    from omnimj.parameters import Robot

DEFAULT_CURRENT = 0.8
"""Default largest current of the test motions [A]."""
_REST = 0.5  # [s] of rest before the motions


def add_check_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj link check`."""
    parser.add_argument("--plant", metavar="P", required=True, help=ADDRESS)
    add_key(parser)
    add_clock(parser)
    words = "the robot stands on the floor and may move by a few centimetres, and turn by some degrees"
    parser.add_argument("--on-floor", action="store_true", help=words)
    words = "ask no questions: the robot is ready, and nobody watches which way its wheels turn"
    parser.add_argument("--yes", action="store_true", help=words)
    words = f"largest current (default {DEFAULT_CURRENT:g} A, at most the device's limit)"
    parser.add_argument(
        "--current", metavar="A", type=positive_number(10.0), default=DEFAULT_CURRENT, help=words
    )
    add_reset_fault(parser)
    parser.add_argument("--model", metavar="FILE", type=Path, help=ROBOT_MODEL)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run_check(arguments: Any) -> int:
    """Check link and robot step by step, the riskiest step last; 1 if a step fails."""
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
    return check.print_result()


def _require_ready(on_floor: bool) -> None:
    """Ask the operator to confirm that the robot may move."""
    if not sys.stdin.isatty():
        raise InputError(
            "link check", "there is no terminal for questions", "--yes states that the robot is ready"
        )
    words = "half a metre of room around it, on the floor" if on_floor else "its wheels off the floor"
    if _prompt(f"Is the robot at rest, with {words}, and a hand at the switch? [y/n] ") != "y":
        raise InputError("link check", "the robot is not ready", "nothing was moved")


def _prompt(question: str) -> str:
    print(question, end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower()[:1]


class _Check:
    """Steps of the check and their results: rows of step, finding, and pass or fail (None: not judged)."""

    def __init__(self, arguments: Any, robot: Robot):
        from omnimj.link.calibration import require_hardware
        from omnimj.link.host.link import open_link
        from omnimj.link.host.plant import HardwarePlant

        self._arguments, self._robot, self._hardware = arguments, robot, require_hardware(robot)
        self._rows: list[tuple[str, str, bool | None]] = []
        self._findings: list[WiringFinding] = []
        self._is_silent = False
        self._link: Link = open_link(
            arguments.plant, robot, key_file=arguments.key_file, lock_step=arguments.lock_step
        )
        self._plant: HardwarePlant = HardwarePlant(self._link, self._hardware)

    def close(self) -> None:
        """Stop the robot and close the link."""
        self._plant.close()

    def all(self) -> None:
        """Run the steps in order; a lost link ends the check, since later steps depend on earlier ones."""
        steps = (self._session, self._rates, self._stop, self._silence, self._wiring)
        for step in steps:
            try:
                step()
            except LinkLost as error:
                self._add(step.__name__.strip("_"), str(error), False)
                self._is_silent = isinstance(error, NoAnswer)
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
                self._link.stop(f"{words} is latched; --reset-fault resets it")
                self._link.host.require_link()
            self._add("latched fault", f"{words}, reset", None)
        if self._link.is_latched:
            self._link.reset()
        if self._arguments.current > limits.current:
            raise InputError(
                "--current", f"found {self._arguments.current:g}", f"at most {limits.current:g} A"
            )

    def _rates(self) -> None:
        from omnimj.link.check.communication import measure_rates

        if self._arguments.lock_step:
            return self._add("rates, stop, silence", "not judged: lock-step has no wall-clock time", None)
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
            self._link.reset()

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
        self._add(
            "latched",
            "arm is refused until the fault is reset"
            if latched
            else "arm is accepted although a fault is latched",
            latched,
        )
        self._link.connect()
        self._link.reset()

    def _wiring(self) -> None:
        from omnimj.link.check.motions import MotionSequence
        from omnimj.link.check.wiring import judge_wiring

        pulses = MotionSequence(
            self._plant, self._arguments.current, lambda words: print(words, file=sys.stderr)
        )
        still = pulses.rest(_REST)
        single, seen = [], {}
        for wheel in range(len(self._robot.wheels)):
            single += [pulses.one(wheel, 1.0)]
            if not self._arguments.on_floor and not self._arguments.yes:
                answer = self._seen_direction(wheel)
                seen |= {} if answer is None else {wheel: answer}
            single += [pulses.one(wheel, -1.0)]
        turns = [pulses.turn(sign) for sign in (1.0, -1.0)] if self._arguments.on_floor else []
        self._findings = judge_wiring(self._robot, still, single, turns, seen)
        for finding in self._findings:
            self._add(finding.place, finding.description, False)
        if not self._findings:
            self._add("wiring", "every channel and motor has the right sign, and gains agree", True)
        if not turns:
            self._add("yaw rate, yaw, acceleration", "signs not judged: the body did not move", None)
        self._add("gain of the accelerometer", "not judged", None)

    def _seen_direction(self, wheel: int) -> int | None:
        """Stop the robot and ask the operator which way the wheel turned: 1, −1, or None if not seen."""
        where = _direction(*self._robot.wheels[wheel].drives_along)
        self._plant.link.stop("waiting for an answer")
        answer = _prompt(
            f"Did wheel {wheel + 1} turn as if to push the robot {where}? [y/n, Enter: not seen] "
        )
        self._plant.reset()
        return {"y": 1, "n": -1}.get(answer)

    def print_result(self) -> int:
        """Print the result of the check, and return the exit code."""
        wrong = sum(is_right is False for *_, is_right in self._rows)
        if self._arguments.json:
            steps = [{"step": n, "found": f, "ok": ok} for n, f, ok in self._rows]
            wiring = [{"place": f.place, "kind": f.kind, "words": f.description} for f in self._findings]
            print(json.dumps({"passed": not wrong, "steps": steps, "wiring": wiring}, indent=2))
        else:
            marks = {True: "ok", False: "WRONG", None: ""}
            print(format_table(("step", "found", ""), [(n, f, marks[ok]) for n, f, ok in self._rows]))
            print(f"\nfailed: {wrong} of {len(self._rows)} steps" if wrong else "\npassed")
        return NO_ANSWER if self._is_silent else exit_code(False, wrong)


def _direction(x: float, y: float) -> str:
    """Return the name of a direction given in the body frame."""
    names = ("ahead", "to the left", "back", "to the right")
    quarter = math.atan2(y, x) / (0.5 * math.pi)
    if abs(quarter - round(quarter)) < 0.1:
        return names[round(quarter) % 4]
    return f"at {math.degrees(math.atan2(y, x)):.0f}° to the left of ahead"


_FRAMES, _NOISE = 100_000, 10_000_000
_MAX_COUNT = 10**12
_MAX_GROWTH = 16 * 1024.0  # [kB] allocators release memory late; a leak is far larger


def add_fuzz_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj link fuzz`."""
    parser.add_argument(
        "--frames",
        metavar="N",
        type=whole_number(1, _MAX_COUNT),
        default=_FRAMES,
        help=f"number of frames (default {_FRAMES})",
    )
    parser.add_argument(
        "--noise",
        metavar="BYTES",
        type=whole_number(0, _MAX_COUNT),
        default=_NOISE,
        help=f"bytes of noise among them (default {_NOISE})",
    )
    add_seed(parser, "seed of frames, damage and noise")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run_fuzz(arguments: Any) -> int:
    """Send frames over a link that damages some; 1 if one is taken wrongly, one is lost, or memory grows."""
    from omnimj.link.check.fuzz import fuzz

    with progress_bar(arguments) as bar:
        report = fuzz(
            arguments.frames,
            arguments.noise,
            arguments.seed,
            lambda done: bar.show(min(done, arguments.frames), arguments.frames),
        )
    passed = report.passed and report.peak_growth <= _MAX_GROWTH
    found = _summarize_fuzz(report, arguments.seed, passed)
    if arguments.json:
        print(json.dumps(found, indent=2))
    else:
        rows = [
            (name.replace("_", " "), _format_count(value)) for name, value in found.items() if name != "drops"
        ]
        rows += [
            (f"dropped: {name.replace('_', ' ')}", _format_count(count))
            for name, count in found["drops"].items()
        ]
        print(format_table(("what", "found"), rows))
    return 0 if passed else 1


def _summarize_fuzz(report: FuzzReport, seed: int, passed: bool) -> dict[str, Any]:
    from omnimj.link.codec.layout import DropReason

    return {
        "frames": report.frames,
        "noise_bytes": report.noise,
        "seed": seed,
        "came_whole": report.whole,
        "accepted": report.accepted,
        "accepted_wrongly": report.wrong,
        "memory_growth_kb": report.peak_growth,
        "blocks_growth": report.blocks_growth,
        "seconds": report.seconds,
        "passed": passed,
        "drops": {drop.name.lower(): report.drops[drop] for drop in DropReason},
    }


def _format_count(value: float) -> str:
    if isinstance(value, bool):
        return "yes" if value else "NO"
    return f"{value:,}" if isinstance(value, int) else f"{value:,.1f}"


CHECK = Command(
    "check",
    "check a robot before its first drive: link, watchdog, stop, and sign and gain of every channel",
    """examples:
  omnimj link check --plant serial:/dev/ttyACM0?baud=921600
  omnimj link check --plant udp:127.0.0.1:9750 --on-floor --yes

With the wheels off the floor you are asked which way each wheel turns, since no channel distinguishes a
reversed motor from a reversed sensor. With --on-floor the body's motion shows it: leave half a metre.""",
    add_check_arguments,
    run_check,
)


FUZZ = Command(
    "fuzz",
    "send frames with flips, drops, inserts, duplicates and noise, and count what is accepted",
    """examples:
  omnimj link fuzz
  omnimj link fuzz --frames 1000000 --noise 100000000 --seed 1 --json""",
    add_fuzz_arguments,
    run_fuzz,
)


def _add_link_arguments(parser: argparse.ArgumentParser) -> None:
    commands = parser.add_subparsers(dest="link_command", metavar="COMMAND", required=True)
    for command in (CHECK, FUZZ):
        command.add_to(commands, "link_run")


def _run_link(arguments: Any) -> int:
    return arguments.link_run(arguments)


_EXAMPLES = (
    line for one in (CHECK, FUZZ) for line in one.epilog.splitlines() if line.startswith("  omnimj ")
)
LINK = Command(
    "link", "test the link to a robot", "\n".join(("examples:", *_EXAMPLES)), _add_link_arguments, _run_link
)
