"""`omnimj wheel`, `omnimj robot`: omni and mecanum wheels and robots on them as files for plain MuJoCo."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import Command, command_line, positive_number, require_writable, whole_number
from omnimj.cli.terminal import format_json, format_table
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.wheels import RollerWheel, SolverContact, WheeledRobot

_KINDS = ("omni", "mecanum")


def _add_wheel(parser: argparse.ArgumentParser, mass_option: str) -> None:
    length = positive_number(20.0)
    parser.add_argument("--radius", metavar="M", type=length, default=0.05, help="radius in m (default 0.05)")
    words = "rollers in a row (default 9, mecanum 20)"
    parser.add_argument("--rollers", metavar="N", type=whole_number(1, 1000), help=words)
    words = "rows of rollers of an omni wheel (default 2)"
    parser.add_argument("--rows", metavar="N", type=whole_number(1, 1000), help=words)
    words = "largest radius of a roller in m (default 0.18 of the wheel's, mecanum 0.1)"
    parser.add_argument("--roller-radius", metavar="M", type=length, help=words)
    words = "distance between rows in m (default 2.44 roller radii)"
    parser.add_argument("--row-spacing", metavar="M", type=length, help=words)
    words = (
        "angle between roller axis and axle of a mecanum wheel in degrees, as seen from above (default 45)"
    )
    parser.add_argument("--roller-angle", metavar="DEG", type=positive_number(180.0), help=words)
    words = "mass of a wheel with rollers in kg (default 0.35 at a radius of 0.05 m)"
    parser.add_argument(mass_option, metavar="KG", type=positive_number(1e6), dest="wheel_mass", help=words)


def _add_contact(parser: argparse.ArgumentParser, step: float) -> None:
    words = "friction coefficient of roller and floor (default 0.8)"
    parser.add_argument("--friction", metavar="MU", type=positive_number(100.0), default=0.8, help=words)
    words = f"step in s, at most 0.002 (default {step:g})"
    parser.add_argument("--timestep", metavar="S", type=positive_number(1.0), default=step, help=words)


def _add_output(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", metavar="FILE", type=Path, required=True, help="MJCF file to write")
    parser.add_argument("--force", action="store_true", help="replace an existing file")
    words = "print geometry, drop at hand-over, masses and contact as JSON"
    parser.add_argument("--json", action="store_true", help=words)


def add_wheel_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj wheel`."""
    parser.add_argument("kind", metavar="KIND", choices=_KINDS, help="omni or mecanum")
    _add_wheel(parser, "--mass")
    words = "mass on the axle in the file, without the wheel, in kg (default 3)"
    parser.add_argument("--load", metavar="KG", type=positive_number(1e6), default=3.0, help=words)
    _add_contact(parser, 0.002)
    _add_output(parser)


def add_robot_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj robot`."""
    words = "omni3, omni4 or mecanum4 (default omni4)"
    parser.add_argument("--layout", metavar="L", default="omni4", help=words)
    length = positive_number(1000.0)
    words = "mass with wheels in kg (default 15 at a wheel radius of 0.05 m)"
    parser.add_argument("--mass", metavar="KG", type=positive_number(1e6), help=words)
    words = "distance of omni wheels from the centre in m (default 5 wheel radii)"
    parser.add_argument("--arm", metavar="M", type=length, help=words)
    words = "distance from front to rear mecanum wheels in m (default 8 wheel radii)"
    parser.add_argument("--wheelbase", metavar="M", type=length, help=words)
    words = "distance from left to right mecanum wheels in m (default 8 wheel radii)"
    parser.add_argument("--track", metavar="M", type=length, help=words)
    words = "velocity (speed of a wheel, default) or motor (its torque)"
    parser.add_argument("--actuators", metavar="A", help=words)
    words = "limit of a wheel's commanded speed at the rim in m/s (default 2)"
    parser.add_argument("--top-speed", metavar="V", type=length, help=words)
    words = "what rollers touch: floor (default, fast), or everything, such as ramps and other objects"
    parser.add_argument("--touch", metavar="T", default="floor", help=words)
    words = "write a model file of the same robot here, which omnimj run --model drives"
    parser.add_argument("--model", metavar="FILE", type=Path, help=words)
    parser.add_argument("--bare", action="store_true", help="leave out what is only seen: faster steps")
    _add_wheel(parser, "--wheel-mass")
    _add_contact(parser, 0.001)
    _add_output(parser)


def run_wheel(arguments: Any) -> int:
    """Write the file of one wheel, and print what it is."""
    from omnimj.wheels import mecanum_wheel, omni_wheel, wheel_file

    require_writable(arguments.out, arguments.force)
    wheel = _wheel(arguments, omni_wheel if arguments.kind == "omni" else mecanum_wheel)
    contact = _contact(arguments)
    text = wheel_file(wheel, contact, arguments.load, command_line(arguments))
    _write(arguments, text, {"kind": arguments.kind} | _content(wheel, contact))
    return 0


def run_robot(arguments: Any) -> int:
    """Write the file of a robot, and print what it is."""
    from omnimj.wheels import model_text, robot_file, wheeled_robot
    from omnimj.wheels.robot import wheel_of_layout

    require_writable(arguments.out, arguments.force)
    if arguments.model is not None:
        require_writable(arguments.model, arguments.force, "--model")
        if arguments.model.resolve() == arguments.out.resolve():
            raise InputError(f"--model {arguments.model}", "is the file of --out", "choose another one")
    wheel = _wheel(arguments, wheel_of_layout(arguments.layout))
    names = ("mass", "arm", "wheelbase", "track", "actuators", "top_speed")
    given = {name: getattr(arguments, name) for name in names if getattr(arguments, name) is not None}
    slanted = arguments.layout == "mecanum4"
    for name in ("arm",) if slanted else ("wheelbase", "track"):
        if name in given:
            rule = "mecanum wheels have --wheelbase and --track, omni wheels --arm"
            raise InputError(f"--{name}", f"is not of {arguments.layout}", rule)
    robot, contact = wheeled_robot(arguments.layout, wheel, **given), _contact(arguments)
    text = robot_file(robot, contact, arguments.touch, arguments.bare, command_line(arguments))
    if arguments.model is not None:
        _write_text(arguments.model, model_text(robot))
    _write(arguments, text, _robot_content(robot) | _content(wheel, contact))
    return 0


def _wheel(arguments: Any, make: Any) -> RollerWheel:
    from omnimj.wheels import mecanum_wheel

    names = {"radius": "radius", "rollers": "rollers", "roller_radius": "roller_radius", "wheel_mass": "mass"}
    given = {
        to: getattr(arguments, name) for name, to in names.items() if getattr(arguments, name) is not None
    }
    slanted = make is mecanum_wheel
    for name, belongs in (("rows", not slanted), ("row_spacing", not slanted), ("roller_angle", slanted)):
        value = getattr(arguments, name)
        if value is None:
            continue
        if not belongs:
            kind, other = ("mecanum", "omni") if slanted else ("omni", "mecanum")
            raise InputError(
                f"--{name.replace('_', '-')}", f"is of {other} wheels only", f"these are {kind} wheels"
            )
        given[name] = math.radians(value) if name == "roller_angle" else value
    return make(**given)


def _contact(arguments: Any) -> SolverContact:
    from omnimj.wheels import solver_contact

    return solver_contact(arguments.radius, arguments.friction, arguments.timestep)


def _content(wheel: RollerWheel, contact: SolverContact) -> dict[str, Any]:
    import dataclasses

    return {
        "wheel": dataclasses.asdict(wheel)
        | {
            "drop": wheel.drop,
            "roller_semi_axes": [wheel.half_length, wheel.roller_radius, wheel.roller_radius],
            "roller_half_length": wheel.roller_half_length,
            "mounted_angle": wheel.mounted_angle,
            "width": wheel.width,
            "roller_mass": wheel.roller_mass,
            "roller_inertia": list(wheel.roller_inertia),
            "inertia": wheel.inertia,
        },
        "contact": dataclasses.asdict(contact),
    }


def _robot_content(robot: WheeledRobot) -> dict[str, Any]:
    return {
        "layout": robot.layout,
        "mass": robot.mass,
        "actuators": robot.actuators,
        "mounts": [
            {"position": list(mount.position), "yaw": mount.yaw, "is_mirrored": mount.is_mirrored}
            for mount in robot.mounts
        ],
        "kinematics": robot.kinematics.tolist(),
    }


def _write_text(path: Path, text: str) -> None:
    from omnimj.recording.folder import make_parents
    from omnimj.recording.json_files import write_text

    make_parents(path, path)
    write_text(path, text)


def _write(arguments: Any, text: str, content: dict[str, Any]) -> None:
    _write_text(arguments.out, text)
    if arguments.json:
        print(format_json(content | {"file": str(arguments.out), "command": command_line(arguments)}))
        return
    wheel = content["wheel"]
    long, b, _ = (f"{1e3 * axis:.4g}" for axis in wheel["roller_semi_axes"])
    rows = [
        ("drop of the hub at hand-over", f"{1e6 * wheel['drop']:.3g} µm"),
        ("rollers", f"{wheel['rows']} × {wheel['rollers']}, ellipsoids of {long}, {b}, {b} mm"),
        ("width over the rollers", f"{1e3 * wheel['width']:.4g} mm"),
        ("mass of a wheel, of a roller", f"{wheel['mass']:.4g} kg, {1e3 * wheel['roller_mass']:.3g} g"),
    ]
    if wheel["mounted_angle"] != wheel["roller_angle"]:
        built, seen = math.degrees(wheel["mounted_angle"]), math.degrees(wheel["roller_angle"])
        rows.append(
            ("angle of rollers to the axle", f"{built:.4g}° as built, {seen:.4g}° as seen from above")
        )
    print(f"{format_table(('quantity', 'value'), rows)}\n\nwritten to {arguments.out}")


_NOTES = """The file opens in plain MuJoCo: python -m mujoco.viewer --mjcf=FILE"""

WHEEL = Command(
    "wheel",
    "write an omni or mecanum wheel as a file for plain MuJoCo",
    f"""examples:
  omnimj wheel omni --radius 0.05 --rollers 9 --rows 2 --out omni.xml
  omnimj wheel mecanum --radius 0.1 --rollers 15 --roller-radius 0.012 --out mecanum.xml

{_NOTES}""",
    add_wheel_arguments,
    run_wheel,
)
ROBOT = Command(
    "robot",
    "write a drivable robot on omni or mecanum wheels as a file for plain MuJoCo",
    f"""examples:
  omnimj robot --layout omni3 --out robot.xml
  omnimj robot --layout mecanum4 --mass 30 --wheelbase 0.5 --track 0.45 --out robot.xml

{_NOTES}""",
    add_robot_arguments,
    run_robot,
)
