"""A scenario on a robot behind a wire: which one, and how it is driven."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnimj.errors import InputError
from omnimj.hardware.address import parse_address
from omnimj.hardware.link_mode import Mode
from omnimj.hardware.opening import open_link
from omnimj.hardware.plant import HardwarePlant
from omnimj.loop import Controller, drive
from omnimj.parameters import Robot
from omnimj.plant.conditions import Fault
from omnimj.scenario.scenario import Scenario
from omnimj.scenario.suites.missions import mission

_WIRES = ("serial:", "udp:")
_WARMING_UP = 4.0  # [s]


def is_wire(plant: str | None) -> bool:
    """Whether a plant's name is an address."""
    return plant is not None and plant.startswith(_WIRES)


@dataclass(frozen=True)
class Wire:
    """How a link is to be used."""

    key_file: Path | None = None
    lock_step: bool = False
    """As opposed to real time."""
    mode: Mode = Mode.DRIVE
    reset_fault: bool = False
    """Whether a fault that the device has latched has been seen and may be reset."""
    log_to: Path | None = None
    """New file for every frame."""


def check_wire(scenario: Scenario, address: str) -> None:
    """Whether a scenario can be driven over a wire.

    Raises:
      InputError: The address is none, or the scenario is not one of the robot with forces.
    """
    parse_address(address, "--plant")
    if not isinstance(scenario.constants, Robot) or scenario.level == "kinematic":
        rule = f"{scenario.name} is not driven by currents of the robot"
        raise InputError("--plant", f"found {address!r}", rule)


def make_wired(scenario: Scenario, address: str, wire: Wire) -> HardwarePlant:
    """The robot at an address, wired as the scenario's model file says; nothing is sent yet.

    Raises:
      InputError: No [hardware] in the model file, a wrong key file, or a wire that cannot be opened.
    """
    robot = scenario.constants
    assert isinstance(robot, Robot)
    link = open_link(
        address,
        robot,
        key_file=wire.key_file,
        lock_step=wire.lock_step,
        mode=wire.mode,
        log_to=wire.log_to,
        about={"scenario": scenario.name, "floor": scenario.floor, "robot": str(robot.file)},
    )
    assert robot.hardware is not None
    with contextlib.ExitStack() as otherwise:
        otherwise.callback(link.close)
        plant = HardwarePlant(link, robot.hardware, reset_fault=wire.reset_fault)
        otherwise.pop_all()
    return plant


def warm_up(scenario: Scenario, controller: Controller) -> None:
    """Lets a controller meet two faults in a quick simulation, so that all its native code is there by then.

    To load a kernel takes as long as many periods, and a robot that is driven in real time does not wait. A
    controller has no state of its own, so that nothing of this is left in it.
    """
    from omnimj.plant.planar import PlanarRobot  # who does not drive over a wire loads no plant for it

    robot = scenario.constants
    assert isinstance(robot, Robot)
    reference = mission(np.random.default_rng(0), _WARMING_UP, scenario.period)
    faults = (
        Fault("motor", 0.3 * _WARMING_UP, wheel=1, numbers={"loss": 0.7}),
        Fault("slip", 0.6 * _WARMING_UP, wheel=2, numbers={"grip": 0.1}),
    )
    plant = PlanarRobot(robot, scenario.floor, faults=faults, floors=scenario.floors)
    try:
        trace = drive(plant, controller, reference)
    finally:
        plant.close()
    if trace.about["interrupted"] and not trace.about["failure"]:
        raise KeyboardInterrupt
