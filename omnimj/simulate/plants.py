"""Plants of a scenario: the twin, the planar model, the kinematic level, or a robot over a link."""

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
from omnimj.plant.faults import Fault
from omnimj.plant.interface import Plant
from omnimj.simulate.kinematic import KinematicPlant
from omnimj.simulate.loop import Controller, drive
from omnimj.simulate.scenario.scenario import Scenario
from omnimj.simulate.suites.missions import mission

PLANT_NAMES = ("twin", "planar")
KINEMATIC = "kinematic"
_ADDRESS_FORMS = ("serial:DEVICE?baud=N", "udp:HOST:PORT")
_LINK_SCHEMES = ("serial:", "udp:")
_WARM_UP_TIME = 4.0  # [s]


def plant_name(scenario: Scenario, choice: str | None) -> str:
    """Name of the plant to run on: `twin` by default, `kinematic` for a kinematic scenario.

    Args:
      scenario: What is to be driven.
      choice: Name of the plant that the user chose, if any.

    Raises:
      InputError: An invalid address, or a plant with forces for a scenario at the kinematic level.
      UnknownNameError: No such plant.
    """
    if choice is not None and is_link_address(choice):
        check_link_scenario(scenario, choice)
        return choice
    if choice is not None and choice not in PLANT_NAMES:
        raise UnknownNameError("--plant", "plant", choice, (*PLANT_NAMES, *_ADDRESS_FORMS))
    if scenario.level == "kinematic":
        if choice is not None:
            rule = f"{scenario.name} is at the kinematic level, leave --plant out"
            raise InputError("--plant", f"found {choice!r}", rule)
        return KINEMATIC
    return choice or "twin"


def make_plant(scenario: Scenario, name: str, seed: int, link: LinkOptions | None = None) -> Plant:
    """Makes the plant of a scenario at the physics level, with its floor, faults and patches.

    On hardware, floor, faults and patches are those of the real robot, whatever the scenario says.

    Args:
      scenario: Its constants come from its model file.
      name: `twin`, `planar`, or the address of a device.
      seed: Seed of the sensor noise.
      link: Options of a link to a device; the defaults when None.

    Raises:
      InputError: A plant that cannot run the scenario, or a link that cannot be opened.
      UnknownNameError: No such plant.
    """
    if is_link_address(name):
        return make_hardware_plant(scenario, name, link or LinkOptions())
    if name not in PLANT_NAMES:
        raise UnknownNameError("plant", "plant", name, PLANT_NAMES)
    if name == "twin" and scenario.equations != "corrected":
        rule = "the printed form is for --plant planar"
        raise InputError(f"{scenario.name}: equations", f"found {scenario.equations!r}", rule)
    return _make_rig(scenario, name, seed) if scenario.is_rig else _make_robot(scenario, name, seed)


def make_kinematic_plant(scenario: Scenario) -> KinematicPlant:
    """Plant of a robot scenario at the kinematic level, at the first sample of its reference."""
    robot, drive = scenario.robot, scenario.robot_drive
    assert scenario.kinematics is not None
    start = (*drive.reference.position[0].tolist(), float(drive.reference.heading[0]))
    gain = robot.control.yaw_rate_proportional if drive.yaw_loop else 0.0
    return KinematicPlant(robot, scenario.kinematics, scenario.period, start, gain)


def _make_rig(scenario: Scenario, name: str, seed: int) -> Plant:
    rig, drive = scenario.rig, scenario.rig_input
    options: dict[str, Any] = {"mass": drive.mass, "lateral_speed": drive.lateral_speed}
    options |= {"faults": scenario.faults, "seed": seed, "floors": scenario.floors}
    if name == "planar":
        from omnimj.plant.planar import PlanarRig

        return PlanarRig(rig, scenario.floor, published=scenario.equations == "published", **options)
    from omnimj.plant.mujoco.twin import RigTwin  # MuJoCo is loaded for the twin only

    return RigTwin(rig, scenario.floors[scenario.floor], **options)


def _make_robot(scenario: Scenario, name: str, seed: int) -> Plant:
    robot, drive = scenario.robot, scenario.robot_drive
    options: dict[str, Any] = {"faults": scenario.faults, "patches": scenario.patches}
    options |= {"seed": seed, "start": drive.start, "floors": scenario.floors}
    if name == "planar":
        if scenario.scene is not None:
            found = f"found {scenario.scene.name!r}"
            raise InputError(f"{scenario.name}: scene", found, "the planar plant has a flat floor only")
        from omnimj.plant.planar import PlanarRobot

        return PlanarRobot(robot, scenario.floor, published=scenario.equations == "published", **options)
    from omnimj.plant.mujoco.twin import RobotTwin

    return RobotTwin(robot, floor=scenario.floors[scenario.floor], scene=scenario.scene, **options)


def is_link_address(plant: str | None) -> bool:
    """True if the name of a plant is the address of a device."""
    return plant is not None and plant.startswith(_LINK_SCHEMES)


@dataclass(frozen=True)
class LinkOptions:
    """Options of a link to a device."""

    key_file: Path | None = None
    """Key that authenticates the frames."""
    lock_step: bool = False
    """Lock step: the device waits for each command, as opposed to real time."""
    mode: LinkMode = LinkMode.DRIVE
    reset_fault: bool = False
    """Acknowledges and resets a fault that the device has latched."""
    log_to: Path | None = None
    """New file to which every frame is written."""


def check_link_scenario(scenario: Scenario, address: str) -> None:
    """Checks that a scenario can be driven over a link.

    Raises:
      InputError: An invalid address, or a scenario without a robot that is driven by currents.
    """
    parse_address(address, "--plant")
    if scenario.is_rig or scenario.level == "kinematic":
        rule = f"{scenario.name} is not driven by currents of the robot"
        raise InputError("--plant", f"found {address!r}", rule)


def make_hardware_plant(scenario: Scenario, address: str, options: LinkOptions) -> HardwarePlant:
    """Opens the link to the robot at an address; nothing is sent yet.

    Args:
      scenario: Its model file says how the robot is wired.
      address: `serial:…` or `udp:…`.
      options: Of the link.

    Raises:
      InputError: No [hardware] in the model file, a wrong key file, or a port that cannot be opened.
    """
    robot = scenario.robot
    link = open_link(
        address,
        robot,
        key_file=options.key_file,
        lock_step=options.lock_step,
        mode=options.mode,
        log_to=options.log_to,
        about={"scenario": scenario.name, "floor": scenario.floor, "robot": str(robot.file)},
    )
    assert robot.hardware is not None
    with contextlib.ExitStack() as on_failure:
        on_failure.callback(link.close)
        plant = HardwarePlant(link, robot.hardware, reset_fault=options.reset_fault)
        on_failure.pop_all()
    return plant


def warm_up(scenario: Scenario, controller: Controller) -> None:
    """Runs a controller through two faults in a quick simulation, which loads all its compiled code.

    Loading a kernel takes many control periods, and a robot driven in real time does not wait. A controller
    keeps no state, so that the simulation leaves none behind.

    Args:
      scenario: A robot scenario.
      controller: Made for it.

    Raises:
      KeyboardInterrupt: Ctrl-C ended the simulation.
    """
    from omnimj.plant.planar import PlanarRobot  # needed for hardware only

    robot = scenario.robot
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
