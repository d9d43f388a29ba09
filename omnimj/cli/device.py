"""`omnimj device`: an emulated robot at the far end of a link, which behaves as its firmware would."""

from __future__ import annotations

import argparse
import functools
import math
import secrets
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import (
    INTERRUPTED,
    ROBOT_MODEL,
    Command,
    add_clock,
    add_floors,
    add_key,
    add_overrides,
    add_seed,
)
from omnimj.cli.terminal import announce_compilation, format_json, note_compiled
from omnimj.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from omnimj.link.codec.key import Key
    from omnimj.link.device.emulated import EmulatedDevice, WiringDefect
    from omnimj.link.device.server import DeviceServer
    from omnimj.link.transport.interface import Listener, Peer
    from omnimj.plant.interface import Plant
    from omnimj.simulate.scenario.scenario import Scenario

DEFAULT = "circle_8m"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj device`."""
    where = parser.add_mutually_exclusive_group(required=True)
    words = "address to listen at; 127.0.0.1 if only a port is given; other hosts need a key"
    where.add_argument("--udp", metavar="HOST:PORT", help=words)
    words = "port to listen at; append ?baud=N where it has a baud rate"
    where.add_argument("--serial", metavar="DEVICE", help=words)
    words = "address that gets a copy of all that is sent to the host, for run --readonly; with --udp"
    parser.add_argument("--monitor", metavar="HOST:PORT", help=words)
    add_key(parser)
    add_clock(parser)
    words = f"scenario with the floor, patches and faults (default {DEFAULT}, which has no faults)"
    parser.add_argument("--scenario", metavar="S", default=DEFAULT, help=words)
    parser.add_argument("--plant", metavar="P", default="twin", help="twin (default) or planar")
    parser.add_argument("--floor", metavar="NAME", help="the same as --set floor=NAME")
    add_overrides(parser, "faults.0.wheel=3")
    words = f"{ROBOT_MODEL}; its [hardware] is the wiring of the device"
    parser.add_argument("--model", metavar="FILE", type=Path, help=words)
    add_floors(parser)
    add_seed(parser, "seed of the sensors' noise")
    words = "a wiring error: sign, gain or dead, of a channel or a motor; repeatable"
    parser.add_argument("--defect", metavar="KIND:PLACE[:VALUE]", action="append", default=[], help=words)
    parser.add_argument("--json", action="store_true", help="print the counts at the end as JSON")


def run(arguments: Any) -> int:
    """Serve until Ctrl-C or SIGTERM, which alone end the emulation with exit code 130."""
    from omnimj.link.codec.key import read_key
    from omnimj.link.device.server import DeviceServer
    from omnimj.simulate.plants import make_plant
    from omnimj.simulate.scenario.scenario import read_scenario

    overrides = [*([f"floor={arguments.floor}"] if arguments.floor else []), *arguments.overrides]
    scenario = read_scenario(arguments.scenario, overrides, arguments.model, arguments.floors)
    _require_robot(scenario, arguments.plant)
    defects = [_defect(text) for text in arguments.defect]
    key = None if arguments.key_file is None else read_key(arguments.key_file)
    monitor = _monitor(arguments, key)
    listener = _listener(arguments, key)
    plant = None
    try:
        announce_compilation(arguments.plant, scenario.plant, quiet=arguments.quiet)
        plant = make_plant(scenario, arguments.plant, arguments.seed)
        emulated = _emulated(plant, scenario, arguments.lock_step, key, defects)
        _warm_up(plant)
        note_compiled(arguments.plant, scenario.plant)
        report = functools.partial(_report, as_json=arguments.json)
        server = DeviceServer(emulated, listener, key=key, report=report, monitor=monitor)
        _serve(arguments, server, key is not None, scenario.name)
    finally:
        listener.close()
        if plant is not None:
            plant.close()
    return INTERRUPTED


def _require_robot(scenario: Scenario, plant: str) -> None:
    from omnimj.link.calibration import require_hardware
    from omnimj.parameters import Robot
    from omnimj.simulate.plants import PLANT_NAMES

    if plant not in PLANT_NAMES:
        raise UnknownNameError("--plant", "plant", plant, PLANT_NAMES)
    if not isinstance(scenario.constants, Robot) or scenario.level == "kinematic":
        rule = "a scenario of the robot with forces is needed"
        raise InputError("--scenario", f"found {scenario.name!r}", rule)
    require_hardware(scenario.constants)


def _defect(text: str) -> WiringDefect:
    """Parse `KIND:PLACE` or `gain:PLACE:VALUE`; names are checked by the device."""
    from omnimj.link.device.emulated import DEFECT_KINDS, WiringDefect

    kind, _, rest = text.partition(":")
    place, colon, value = rest.partition(":")
    if kind not in DEFECT_KINDS:
        raise UnknownNameError("--defect", "kind", kind, DEFECT_KINDS)
    if not place or bool(colon) != (kind == "gain"):
        raise InputError("--defect", f"found {text!r}", "must be sign:PLACE, dead:PLACE or gain:PLACE:VALUE")
    try:
        factor = float(value) if colon else 1.0
    except ValueError:
        factor = math.nan
    if not math.isfinite(factor):
        raise InputError("--defect", f"found {text!r}", "the value must be a finite number")
    return WiringDefect(kind, place, factor)


def _monitor(arguments: Any, key: Key | None) -> Peer:
    """Address of the monitor; None without one."""
    from omnimj.link.transport.address import SerialAddress, parse_address
    from omnimj.link.transport.udp import resolve

    if arguments.monitor is None:
        return None
    if arguments.udp is None:
        raise InputError("--monitor", "found with --serial", "there a listener is wired to the line itself")
    address = parse_address(f"udp:{arguments.monitor}", "--monitor")
    assert not isinstance(address, SerialAddress)
    return resolve(address, key is not None, passive=False)[1]


def _listener(arguments: Any, key: Key | None) -> Listener:
    from omnimj.link.transport.address import SerialAddress, parse_address
    from omnimj.link.transport.interface import SinglePeerListener
    from omnimj.link.transport.serial_port import SerialTransport
    from omnimj.link.transport.udp import UdpListener

    if arguments.serial is not None:
        address = parse_address(f"serial:{arguments.serial}", "--serial")
        assert isinstance(address, SerialAddress)
        return SinglePeerListener(SerialTransport(address))
    address = parse_address(f"udp:{arguments.udp}", "--udp")
    assert not isinstance(address, SerialAddress)
    return UdpListener(address, key is not None)


def _emulated(
    plant: Plant, scenario: Scenario, lock_step: bool, key: Key | None, defects: list[WiringDefect]
) -> EmulatedDevice:
    from omnimj.link.calibration import require_hardware
    from omnimj.link.device.emulated import EmulatedDevice
    from omnimj.parameters import Robot

    robot = scenario.constants
    assert isinstance(robot, Robot)

    def drawn() -> int:
        return secrets.randbits(32)

    keyed = key is not None
    return EmulatedDevice(
        plant, require_hardware(robot), drawn, lock_step=lock_step, keyed=keyed, defects=defects
    )


def _warm_up(plant: Plant) -> None:
    """Compile the plant's step in advance; a connected host would time out meanwhile."""
    import numpy as np

    from omnimj.signals import CurrentCommand, Measurement

    first = plant.reset()
    assert isinstance(first, Measurement)
    for _ in range(3):
        plant.step(CurrentCommand(np.zeros(len(first.current))))
    plant.reset()


def _report(line: str, as_json: bool = False) -> None:
    """Print a line; with `--json` standard output holds JSON only."""
    print(line, file=sys.stderr if as_json else sys.stdout, flush=True)


def _serve(arguments: Any, server: DeviceServer, keyed: bool, scenario: str) -> None:
    period = server.emulated.device.config.period
    mode = "lock-step" if arguments.lock_step else f"real time, {1e3 * period:g} ms"
    where = f"udp:{arguments.udp}" if arguments.udp is not None else f"serial:{arguments.serial}"
    words = f"device ready at {where}, {scenario} on the {arguments.plant}, {mode}"
    _report(words + (", keyed" if keyed else ""), arguments.json)
    try:
        server.run(lambda: True)
    except KeyboardInterrupt:
        pass
    finally:
        served = _served(server, arguments.lock_step)
        text = format_json(served) if arguments.json else _format_served(server, arguments.lock_step)
        print(text, flush=True)


def _served(server: DeviceServer, lock_step: bool) -> dict[str, Any]:
    """Counts of frames, and the timing of a device in real time, as JSON types."""
    device, timing = server.emulated.device, server.timing
    found = {
        "frames": server.frames,
        "dropped": device.dropped,
        "refused": device.refused,
        "fault": device.fault.name.lower() if device.fault else None,
    }
    if lock_step:
        return found
    periods = {"periods": timing.periods, "missed": timing.missed, "skipped": timing.skipped}
    return {**found, **periods, "late_seconds": dict(timing.late.as_record())}


def _format_served(server: DeviceServer, lock_step: bool) -> str:
    device = server.emulated.device
    fault = f", fault {device.fault.name.lower().replace('_', ' ')} latched" if device.fault else ""
    words = f"{server.frames} frames, {device.dropped} dropped, {device.refused} refused{fault}"
    if server.drops.total:
        words += f"; no frames: {server.drops}"
    return words if lock_step else f"{words}\n{server.timing}"


DEVICE = Command(
    "device",
    "emulate the robot behind a wire, with the rules of a firmware",
    """examples:
  omnimj device --udp 127.0.0.1:9750 --scenario nylon_patch --lock-step
  omnimj run nylon_patch --plant udp:127.0.0.1:9750 --lock-step
  omnimj device --serial /dev/ttyGS0 --scenario degraded_motor
  omnimj device --udp 9750 --defect sign:wheel_speed_2 --defect gain:motor_3:0.5

Run the second one in another terminal. Floor, patches and faults belong to the device; a host cannot know
them. Each session puts the robot back to its start; in real time the scenario's clock starts when it is first
armed.""",
    add_arguments,
    run,
)
