"""A scenario on a robot behind a wire: which one, and how it is driven."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.errors import InputError, UnknownNameError
from omnimj.link.host.link import LinkMode, open_link
from omnimj.link.host.plant import HardwarePlant
from omnimj.link.transport.address import parse_address
from omnimj.parameters import Rig, Robot
from omnimj.plant.faults import Fault
from omnimj.plant.interface import Plant
from omnimj.simulate.loop import Controller, drive
from omnimj.simulate.scenario.drive import Drive
from omnimj.simulate.scenario.scenario import RigInput, Scenario
from omnimj.simulate.suites.missions import mission

_LINK_SCHEMES = ("serial:", "udp:")
_WARM_UP_TIME = 4.0  # [s]


def is_link_address(plant: str | None) -> bool:
    """Whether a plant's name is an address."""
    return plant is not None and plant.startswith(_LINK_SCHEMES)


@dataclass(frozen=True)
class LinkOptions:
    """How a link is to be used."""

    key_file: Path | None = None
    lock_step: bool = False
    """As opposed to real time."""
    mode: LinkMode = LinkMode.DRIVE
    reset_fault: bool = False
    """Whether a fault that the device has latched has been seen and may be reset."""
    log_to: Path | None = None
    """New file for every frame."""


def check_link_scenario(scenario: Scenario, address: str) -> None:
    """Whether a scenario can be driven over a wire.

    Raises:
      InputError: The address is none, or the scenario is not one of the robot with forces.
    """
    parse_address(address, "--plant")
    if not isinstance(scenario.constants, Robot) or scenario.level == "kinematic":
        rule = f"{scenario.name} is not driven by currents of the robot"
        raise InputError("--plant", f"found {address!r}", rule)


def make_hardware_plant(scenario: Scenario, address: str, wire: LinkOptions) -> HardwarePlant:
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
    reference = mission(np.random.default_rng(0), _WARM_UP_TIME, scenario.period)
    faults = (
        Fault("motor", 0.3 * _WARM_UP_TIME, wheel=1, numbers={"loss": 0.7}),
        Fault("slip", 0.6 * _WARM_UP_TIME, wheel=2, numbers={"grip": 0.1}),
    )
    plant = PlanarRobot(robot, scenario.floor, faults=faults, floors=scenario.floors)
    try:
        trace = drive(plant, controller, reference)
    finally:
        plant.close()
    if trace.about["interrupted"] and not trace.about["failure"]:
        raise KeyboardInterrupt


# Which plant a scenario runs on.

PLANT_NAMES = ("twin", "planar")
KINEMATIC = "kinematic"
_ADDRESS_FORMS = ("serial:DEVICE?baud=N", "udp:HOST:PORT")


def plant_name(scenario: Scenario, asked: str | None) -> str:
    """The plant to run on: `twin` unless asked otherwise, `kinematic` for a kinematic scenario.

    Raises:
      InputError: An address that is none, or a plant with forces for a scenario without any.
      UnknownNameError: No such plant.
    """
    if asked is not None and is_link_address(asked):
        check_link_scenario(scenario, asked)
        return asked
    if asked is not None and asked not in PLANT_NAMES:
        raise UnknownNameError("--plant", "plant", asked, (*PLANT_NAMES, *_ADDRESS_FORMS))
    if scenario.level == "kinematic":
        if asked is not None:
            rule = f"{scenario.name} is at the kinematic level, leave --plant out"
            raise InputError("--plant", f"found {asked!r}", rule)
        return KINEMATIC
    return asked or "twin"


def make_plant(scenario: Scenario, name: str, seed: int, wire: LinkOptions | None = None) -> Plant:
    """The plant of a scenario at the physics level, with its floor, faults and patches.

    A robot behind a wire has what it has: floor, faults and patches are then what the scenario hopes for.

    Args:
      scenario: Its constants come from its model file.
      name: `twin`, `planar`, or the address of a device.
      seed: Of the sensors' noise.
      wire: How an address is used; as usual when None.

    Raises:
      UnknownNameError: No such plant.
    """
    if is_link_address(name):
        return make_hardware_plant(scenario, name, wire or LinkOptions())
    if name not in PLANT_NAMES:
        raise UnknownNameError("plant", "plant", name, PLANT_NAMES)
    if name == "twin" and scenario.equations != "corrected":
        rule = "the printed form is for --plant planar"
        raise InputError(f"{scenario.name}: equations", f"found {scenario.equations!r}", rule)
    return (
        _make_rig(scenario, name, seed)
        if isinstance(scenario.constants, Rig)
        else _make_robot(scenario, name, seed)
    )


def _make_rig(scenario: Scenario, name: str, seed: int) -> Plant:
    rig, drive = scenario.constants, scenario.drive
    assert isinstance(rig, Rig)
    assert isinstance(drive, RigInput)
    asked: dict[str, Any] = {"mass": drive.mass, "lateral_speed": drive.lateral_speed}
    asked |= {"faults": scenario.faults, "seed": seed, "floors": scenario.floors}
    if name == "planar":
        from omnimj.plant.planar import PlanarRig

        return PlanarRig(rig, scenario.floor, published=scenario.equations == "published", **asked)
    from omnimj.plant.mujoco.twin import RigTwin  # MuJoCo is loaded for the twin only

    return RigTwin(rig, scenario.floors[scenario.floor], **asked)


def _make_robot(scenario: Scenario, name: str, seed: int) -> Plant:
    robot, drive = scenario.constants, scenario.drive
    assert isinstance(robot, Robot)
    assert isinstance(drive, Drive)
    asked: dict[str, Any] = {"faults": scenario.faults, "patches": scenario.patches}
    asked |= {"seed": seed, "start": drive.start, "floors": scenario.floors}
    if name == "planar":
        if scenario.scene is not None:
            found = f"found {scenario.scene.name!r}"
            raise InputError(f"{scenario.name}: scene", found, "the planar plant knows a flat floor only")
        from omnimj.plant.planar import PlanarRobot

        return PlanarRobot(robot, scenario.floor, published=scenario.equations == "published", **asked)
    from omnimj.plant.mujoco.twin import RobotTwin

    return RobotTwin(robot, floor=scenario.floors[scenario.floor], scene=scenario.scene, **asked)
