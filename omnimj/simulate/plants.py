"""Plants of a scenario: the twin, the planar model, the kinematic level, or a robot over a link."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnimj.errors import InputError, UnknownNameError
from omnimj.link.host.link import LinkMode, open_link
from omnimj.link.host.plant import HardwarePlant
from omnimj.link.transport.address import parse_address
from omnimj.parameters import Floor, Rig, Robot
from omnimj.plant.interface import Plant
from omnimj.simulate.kinematic import KinematicPlant
from omnimj.simulate.scenario.scenario import Scenario

PLANT_NAMES = ("twin", "planar")
KINEMATIC = "kinematic"
_ADDRESS_FORMS = ("serial:DEVICE?baud=N", "udp:HOST:PORT")
_LINK_SCHEMES = ("serial:", "udp:")


def plant_name(scenario: Scenario, choice: str | None) -> str:
    """Name of the plant to run on: `twin` by default, `kinematic` for a kinematic scenario.

    Args:
      scenario: Scenario to drive.
      choice: Name of the plant that the user chose; None for the default.

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
    """Make the plant of a scenario at the physics level, with its floor, faults and patches.

    On hardware, floor, faults and patches are those of the real robot, not those of the scenario.

    Args:
      scenario: Scenario, with the constants of its model file.
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
    """Make the kinematic plant of a robot scenario, at the first sample of its reference."""
    robot, drive = scenario.robot, scenario.robot_drive
    assert scenario.kinematics is not None
    start = (*drive.reference.position[0].tolist(), float(drive.reference.heading[0]))
    gain = robot.control.yaw_rate_proportional if drive.yaw_loop else 0.0
    return KinematicPlant(robot, scenario.kinematics, scenario.period, start, gain)


def _make_rig(scenario: Scenario, name: str, seed: int) -> Plant:
    drive = scenario.rig_input
    options: dict[str, Any] = {"mass": drive.mass, "lateral_speed": drive.lateral_speed}
    options |= {"faults": scenario.faults, "seed": seed}
    if name == "planar":
        options["published"] = scenario.equations == "published"
    return make_simulated(name, scenario.rig, scenario.floor, scenario.floors, **options)


def _make_robot(scenario: Scenario, name: str, seed: int) -> Plant:
    options: dict[str, Any] = {"faults": scenario.faults, "patches": scenario.patches}
    options |= {"seed": seed, "start": scenario.robot_drive.start}
    if name == "planar":
        if scenario.scene is not None:
            found = f"found {scenario.scene.name!r}"
            raise InputError(f"{scenario.name}: scene", found, "the planar plant has a flat floor only")
        options["published"] = scenario.equations == "published"
    else:
        options["scene"] = scenario.scene
    return make_simulated(name, scenario.robot, scenario.floor, scenario.floors, **options)


def make_simulated(
    kind: str, machine: Robot | Rig, floor: str, floors: Mapping[str, Floor], **options: Any
) -> Plant:
    """Make a simulated robot or rig; MuJoCo is loaded for the twin only.

    Args:
      kind: `twin` or `planar`.
      machine: True constants, with effects.
      floor: Name in `floors`.
      floors: All floors by name.
      options: Further arguments of the twin or planar model.
    """
    is_rig = isinstance(machine, Rig)
    if kind == "planar":
        from omnimj.plant.planar import PlanarRobot
        from omnimj.plant.planar_rig import PlanarRig

        planar: Any = PlanarRig if is_rig else PlanarRobot
        return planar(machine, floor, floors=floors, **options)
    from omnimj.plant.mujoco.twin import RigTwin, RobotTwin

    twin: Any = RigTwin if is_rig else RobotTwin
    return twin(machine, floors[floor], floors=floors, **options)


def is_link_address(plant: str | None) -> bool:
    """True if the name of a plant is the address of a device."""
    return plant is not None and plant.startswith(_LINK_SCHEMES)


@dataclass(frozen=True)
class LinkOptions:
    """Options of a link to a device."""

    key_file: Path | None = None
    """File with the key that authenticates the frames; None for a link without a key."""
    lock_step: bool = False
    """True if the device waits for each command (lock step); False for real time."""
    mode: LinkMode = LinkMode.DRIVE
    reset_fault: bool = False
    """True to reset a fault that the device has latched."""
    log_to: Path | None = None
    """New file for the log of all frames; None for no log."""


def check_link_scenario(scenario: Scenario, address: str) -> None:
    """Check that a scenario can be driven over a link.

    Raises:
      InputError: An invalid address, or a scenario without a robot that is driven by currents.
    """
    parse_address(address, "--plant")
    if scenario.is_rig or scenario.level == "kinematic":
        rule = f"{scenario.name} is not driven by currents of the robot"
        raise InputError("--plant", f"found {address!r}", rule)


def make_hardware_plant(scenario: Scenario, address: str, options: LinkOptions) -> HardwarePlant:
    """Open the link to the robot at an address; nothing is sent yet.

    Args:
      scenario: Scenario whose model file describes the wiring of the robot.
      address: `serial:…` or `udp:…`.
      options: Options of the link.

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
