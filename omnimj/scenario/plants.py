"""Which plant a scenario runs on."""

from __future__ import annotations

from typing import Any

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Rig, Robot
from omnimj.plant.interface import Plant
from omnimj.scenario.drive import Drive
from omnimj.scenario.scenario import RigDrive, Scenario
from omnimj.scenario.wires import Wire, check_wire, is_wire, make_wired

PLANT_NAMES = ("twin", "planar")
KINEMATIC = "kinematic"
_WIRES = ("serial:DEVICE?baud=N", "udp:HOST:PORT")


def plant_name(scenario: Scenario, asked: str | None) -> str:
    """The plant to run on: `twin` unless asked otherwise, `kinematic` for a kinematic scenario.

    Raises:
      InputError: An address that is none, or a plant with forces for a scenario without any.
      UnknownNameError: No such plant.
    """
    if asked is not None and is_wire(asked):
        check_wire(scenario, asked)
        return asked
    if asked is not None and asked not in PLANT_NAMES:
        raise UnknownNameError("--plant", "plant", asked, (*PLANT_NAMES, *_WIRES))
    if scenario.level == "kinematic":
        if asked is not None:
            rule = f"{scenario.name} is at the kinematic level, leave --plant out"
            raise InputError("--plant", f"found {asked!r}", rule)
        return KINEMATIC
    return asked or "twin"


def make_plant(scenario: Scenario, name: str, seed: int, wire: Wire | None = None) -> Plant:
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
    if is_wire(name):
        return make_wired(scenario, name, wire or Wire())
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
    assert isinstance(drive, RigDrive)
    asked: dict[str, Any] = {"mass": drive.mass, "lateral_speed": drive.lateral_speed}
    asked |= {"faults": scenario.faults, "seed": seed, "floors": scenario.floors}
    if name == "planar":
        from omnimj.plant.planar_rig import PlanarRig

        return PlanarRig(rig, scenario.floor, published=scenario.equations == "published", **asked)
    from omnimj.twin.twin import RigTwin  # MuJoCo is loaded for the twin only

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
    from omnimj.twin.twin import RobotTwin

    return RobotTwin(robot, floor=scenario.floors[scenario.floor], scene=scenario.scene, **asked)
