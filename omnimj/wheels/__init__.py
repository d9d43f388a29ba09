"""Omni and mecanum wheels as MJCF files that plain MuJoCo rolls, alone or under a drivable body.

`wheel`, `limits`    the wheel: its numbers, and which of them are possible
`ring`, `outline`    rollers around a wheel; closed forms of outline and hand-over
`contact`            contact of the rollers in MuJoCo's own solver
`robot`              layouts of wheels under a body, their kinematics
`wheel_xml`, `robot_xml`   the files
`model_text`         model file of the same robot for omnimj's twin
"""

from omnimj.wheels.contact import SolverContact, solver_contact
from omnimj.wheels.model_text import model_text
from omnimj.wheels.robot import LAYOUTS, WheeledRobot, wheeled_robot
from omnimj.wheels.robot_xml import robot_file
from omnimj.wheels.wheel import RollerWheel, mecanum_wheel, omni_wheel
from omnimj.wheels.wheel_xml import wheel_file

__all__ = [
    "LAYOUTS",
    "RollerWheel",
    "SolverContact",
    "WheeledRobot",
    "mecanum_wheel",
    "model_text",
    "omni_wheel",
    "robot_file",
    "solver_contact",
    "wheel_file",
    "wheeled_robot",
]
