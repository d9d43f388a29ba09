"""Constants of robot, rig and floors as frozen dataclasses, read from `models/*.toml` and checked once.

`robot` and `rig` are the machines, `parts` the parts common to robot and rig, `floor` the floors and
their traction laws, `hardware` the wiring. `reading` checks TOML tables of quantities and records the source
of each number; `model_file` joins the file of a machine with that of the shared parts.
"""

from omnimj.parameters.floor import Floor, read_floors
from omnimj.parameters.hardware import Hardware, HardwareInput, HardwareLimits, HardwareOutput, read_hardware
from omnimj.parameters.parts import Bearing, Contact, Motor, Sensors, Wheel
from omnimj.parameters.rig import Rig, RigBody, read_rig
from omnimj.parameters.robot import Control, Robot, RobotBody, WheelMount, read_robot

__all__ = [
    "Bearing",
    "Contact",
    "Control",
    "Floor",
    "Hardware",
    "HardwareInput",
    "HardwareLimits",
    "HardwareOutput",
    "Motor",
    "Rig",
    "RigBody",
    "Robot",
    "RobotBody",
    "Sensors",
    "Wheel",
    "WheelMount",
    "read_floors",
    "read_hardware",
    "read_rig",
    "read_robot",
]
