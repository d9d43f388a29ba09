"""`omnimj teleop`: drive by keyboard or gamepad, through the same controller as in a run."""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import (
    ROBOT_MODEL,
    Command,
    add_floors,
    add_key,
    add_reset_fault,
    add_seed,
    exit_code,
    has_out,
    whole_number,
)
from omnimj.cli.terminal import announce_compilation, format_json, note_compiled
from omnimj.errors import InputError, SimulationError, UnknownNameError

if TYPE_CHECKING:
    from omnimj.plant.interface import Plant
    from omnimj.signals import Diagnosis
    from omnimj.simulate.scenario.scenario import Scenario
    from omnimj.simulate.teleop.devices import Gamepad, Terminal
    from omnimj.simulate.teleop.driving import RealTimePacer, RowBuffer, TeleopResult
    from omnimj.simulate.teleop.steering import SteeringLimits
    from omnimj.view.rerun.live import LiveDrive

_MINUTES, _MOST_MINUTES = 5, 30
_WARMING, _CREEP = 200, 0.1  # steps of the drive that triggers compilation, and its speed [m/s]
_SLOW = 0.98  # × real time below which a simulation is reported as too slow


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj teleop`."""
    words = "twin (default), planar, udp:HOST:PORT or serial:DEVICE?baud=N"
    parser.add_argument("--plant", metavar="P", default="twin", help=words)
    words = "fault detection: robust (default), published or off"
    parser.add_argument("--method", metavar="M", default="robust", help=words)
    parser.add_argument("--floor", metavar="NAME", help="floor of a simulation (default natural_stone)")
    add_floors(parser)
    parser.add_argument("--model", metavar="FILE", type=Path, help=ROBOT_MODEL)
    for option, unit, words in (
        ("--speed", "M/S", "largest speed, ahead and sideways (default 0.3, at most 1)"),
        ("--turn", "RAD/S", "largest yaw rate (default 0.6, at most 2)"),
        ("--acceleration", "M/S²", "largest acceleration (default 0.5, at most 1)"),
        ("--hold", "S", "how long a key counts as held after its last event (default 0.3, at most 1)"),
    ):
        parser.add_argument(option, metavar=unit, type=_number, help=words)
    words = "device file of a gamepad, or none (default /dev/input/js0 if it exists)"
    parser.add_argument("--gamepad", metavar="FILE", help=words)
    add_seed(parser, "seed of the sensors' noise")
    add_key(parser)
    add_reset_fault(parser)
    parser.add_argument("--view", action="store_true", help="watch the drive in the Rerun viewer")
    parser.add_argument("--out", metavar="DIR", type=Path, help="write trace.parquet here")
    parser.add_argument("--force", action="store_true", help="write into --out although it is not empty")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.add_argument(
        "--keep",
        metavar="MINUTES",
        type=whole_number(1, _MOST_MINUTES),
        default=_MINUTES,
        help=f"minutes kept in the trace, the newest ones (default {_MINUTES}, at most {_MOST_MINUTES})",
    )


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"found {text[:40]!r}; a number is needed") from None


def run(arguments: Any) -> int:
    """Drive until a key, a signal or the plant ends the drive, then write the trace."""
    from omnimj.recording.folder import check_folder
    from omnimj.simulate.detectors import require_known_method
    from omnimj.simulate.teleop.devices import Terminal
    from omnimj.simulate.teleop.driving import DEFAULT_FLOOR, free_drive

    limits = _limits(arguments)
    require_known_method(arguments.method)
    if has_out(arguments):
        check_folder(arguments.out, arguments.force)
    scenario = free_drive(arguments.floor or DEFAULT_FLOOR, arguments.model, arguments.floors)
    terminal = Terminal()
    with contextlib.ExitStack() as open_things:
        plant = _plant(arguments, scenario)
        open_things.callback(plant.close)
        pad = _gamepad(arguments.gamepad)
        if pad is not None:
            open_things.callback(pad.close)
        return _Session(arguments, scenario, limits, plant).drive(terminal, pad)


def _limits(arguments: Any) -> SteeringLimits:
    from omnimj.simulate.teleop.steering import SteeringLimits

    names = ("speed", "turn", "acceleration", "hold")
    given = {name: getattr(arguments, name) for name in names}
    return SteeringLimits(**{name: value for name, value in given.items() if value is not None})


def _plant(arguments: Any, scenario: Scenario) -> Plant:
    from omnimj.cli.arguments import ADDRESS
    from omnimj.simulate.plants import (
        PLANT_NAMES,
        LinkOptions,
        check_link_scenario,
        is_link_address,
        make_hardware_plant,
        make_plant,
    )

    name = arguments.plant
    if is_link_address(name):
        if arguments.floor is not None:
            raise InputError("--floor", f"the plant is {name!r}", "a real robot brings its own")
        check_link_scenario(scenario, name)
        return make_hardware_plant(
            scenario, name, LinkOptions(arguments.key_file, reset_fault=arguments.reset_fault)
        )
    if arguments.key_file is not None or arguments.reset_fault:
        given = "--reset-fault" if arguments.reset_fault else "--key-file"
        raise InputError(given, "there is no wire", f"it belongs to --plant {ADDRESS}")
    if name not in PLANT_NAMES:
        raise UnknownNameError("--plant", "plant", name, (*PLANT_NAMES, "serial:…", "udp:…"))
    announce_compilation(name, scenario.plant, quiet=arguments.quiet)
    return make_plant(scenario, name, arguments.seed)


def _gamepad(given: str | None) -> Gamepad | None:
    """Open the given gamepad, or else the first readable one; return None without any."""
    from omnimj.simulate.teleop.devices import FIRST_GAMEPAD, Gamepad

    if given == "none" or (given is None and not FIRST_GAMEPAD.exists()):
        return None
    try:
        return Gamepad(FIRST_GAMEPAD if given is None else Path(given))
    except InputError as error:
        if given is not None:
            raise
        print(f"omnimj: {error}; the keyboard drives alone", file=sys.stderr)
        return None


def _drive_warm_up(plant: Plant, controller: Any) -> None:
    import numpy as np

    from omnimj.signals import Target

    measurement: Any = plant.reset()
    state = controller.start(measurement)
    for k in range(_WARMING):
        speed = _CREEP if k < _WARMING // 2 else 0.0
        command, state = controller.step(state, measurement, Target(np.array((speed, 0.0)), 0.0, 0.0))
        plant.truth()
        measurement = plant.step(command)


class _Session:
    """One drive with its observers, its printed summary and its files."""

    def __init__(self, arguments: Any, scenario: Scenario, limits: SteeringLimits, plant: Plant):
        from omnimj.simulate.plants import is_link_address
        from omnimj.simulate.teleop.driving import RealTimePacer, RowBuffer

        self._arguments, self._scenario, self._limits, self._plant = arguments, scenario, limits, plant
        kept = round(60.0 * arguments.keep / plant.period) if arguments.out is not None else 0
        self._recent: RowBuffer = RowBuffer(kept)
        simulated = not is_link_address(arguments.plant)
        self._clock: RealTimePacer | None = RealTimePacer(plant.period) if simulated else None
        self._diagnosed = ""
        self._about = {"scenario": scenario.name, "plant": arguments.plant, "method": arguments.method}
        self._about |= {"seed": arguments.seed, "floor": scenario.floor}

    def drive(self, terminal: Terminal, pad: Gamepad | None) -> int:
        from omnimj.simulate.detectors import make_detector
        from omnimj.simulate.run import make_diagnosing_controller
        from omnimj.simulate.teleop import devices
        from omnimj.simulate.teleop.devices import Operator
        from omnimj.simulate.teleop.driving import TeleopCallbacks, drive_by_hand
        from omnimj.simulate.teleop.steering import KEYS_HELP as KEYS
        from omnimj.simulate.teleop.steering import Steering

        controller = make_diagnosing_controller(
            self._scenario, make_detector(self._arguments.method, self._scenario)
        )
        live = self._open_view()
        shown = () if live is None else (live.rows,)
        watch = TeleopCallbacks(
            rows=(self._recent.add, *shown),
            snapshot=None if live is None else live.snapshot,
            before_step=None if self._clock is None else self._clock.wait,
            diagnosed=self._note_diagnoses,
        )
        print(f"keys: {KEYS}", file=sys.stderr)
        if pad is not None:
            print(f"gamepad: {devices.GAMEPAD_HELP}", file=sys.stderr)
        with terminal:
            self._warm_up(controller)
            terminal.drain()
            steering = Steering(self._limits)
            operator = Operator(steering, self._plant.period, terminal, pad, status=self._status)
            driven = drive_by_hand(self._plant, controller, operator.target, watch)
        self._plant.close()  # stop the robot before writing anything
        return self._end(driven, live)

    def _warm_up(self, controller: Any) -> None:
        """Compile before keys are read, without moving a real robot."""
        from omnimj.simulate.run import warm_up

        warm_up(self._scenario, controller)
        if self._clock is not None:
            _drive_warm_up(self._plant, controller)
            note_compiled(self._arguments.plant, self._scenario.plant)

    def _open_view(self) -> LiveDrive | None:
        if not self._arguments.view:
            return None
        from omnimj.view.rerun.live import LiveDrive
        from omnimj.view.rerun.viewer import open_viewer

        live = LiveDrive(self._scenario, self._about, open_viewer(("--memory-limit", "1GB")))
        live.start()
        return live

    def _note_diagnoses(self, diagnoses: tuple[Diagnosis, ...]) -> None:
        standing = [d for d in diagnoses if d.cleared is None]
        self._diagnosed = ", ".join(" ".join((d.kind, d.channel, *map(str, d.wheels))) for d in standing)

    def _status(self) -> str:
        pace = "" if self._clock is None else f"{self._clock.factor:.2f} × real time  "
        return f"{pace}{self._diagnosed}"

    def _end(self, driven: TeleopResult, live: LiveDrive | None) -> int:
        seconds = driven.steps * self._plant.period
        factor = None if self._clock is None else self._clock.factor
        words = f"{seconds:.1f} s driven by hand, plant {self._arguments.plant}"
        if self._clock is not None:
            words += f", {self._clock.factor:.2f} × real time"
            if self._clock.factor < _SLOW:
                words += ": this machine cannot keep up"
        written = self._write(driven)
        if self._arguments.json:
            plant = self._arguments.plant
            kept = None if not written else str(self._arguments.out / "trace.parquet")
            found = {"seconds": seconds, "plant": plant, "realtime_factor": factor, "trace": kept}
            print(format_json({**found, "interrupted": driven.interrupted, "failure": driven.failure}))
        else:
            print(f"{words}{written}")
        if live is not None:
            if live.missed:
                print(f"the viewer was too slow for {live.missed / 10:.1f} s of it", file=sys.stderr)
            live.finish()
        if driven.failure is not None:
            raise SimulationError(f"{driven.failure}{written}")
        return exit_code(driven.interrupted)

    def _write(self, driven: TeleopResult) -> str:
        """Write the trace and return a phrase with its location."""
        folder = self._arguments.out
        if folder is None or self._recent.rows == 0:
            return ""
        import dataclasses

        from omnimj.recording.folder import make_folder
        from omnimj.recording.traces import write_trace

        make_folder(folder, self._arguments.force)
        about = {**self._about, "interrupted": driven.interrupted, "failure": driven.failure}
        about["realtime_factor"] = 1.0 if self._clock is None else self._clock.factor
        about["diagnoses"] = [dataclasses.asdict(d) for d in driven.diagnoses]
        write_trace(folder / "trace.parquet", self._recent.trace(about))
        kept = self._recent.rows * self._plant.period
        return f"; the last {kept:.1f} s of it are in {folder / 'trace.parquet'}"


TELEOP = Command(
    "teleop",
    "drive the robot by keyboard or gamepad",
    """examples:
  omnimj teleop
  omnimj teleop --plant planar --floor pvc --speed 0.5 --out out/by_hand
  omnimj teleop --view""",
    add_arguments,
    run,
)
