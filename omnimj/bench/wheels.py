"""Free rolling of robots on omni and mecanum wheels in plain MuJoCo, by shape of roller and by contact."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import mujoco
import numpy as np

from omnimj.bench.twin import wall_time
from omnimj.parameters import read_floors, read_robot
from omnimj.plant.mujoco.assembly import robot_model
from omnimj.plant.mujoco.callback import install
from omnimj.signals import Array
from omnimj.wheels import LAYOUTS, RollerWheel, SolverContact, WheeledRobot, robot_file, wheeled_robot

SPEED = 0.5
"""Speed of the body [m/s]."""
_SETTLE, _MEASURED = 1.0, 2.0  # [s] speeding up and settling, then the measured drive
_CHUNK = 60  # steps that are timed together
_CURRENTS = (0.3, -0.8, 0.1, 0.7)  # [A] that move the twin while it is timed


@dataclass(frozen=True)
class Rolling:
    """Free rolling in one direction, or the worst of several."""

    speed_error: float
    """Mean speed along the commanded direction over the commanded one, less 1."""
    direction_error: float
    """Mean speed at right angles to the commanded direction over the commanded one."""
    yaw_rate_mean: float
    """Mean yaw rate [rad/s]; none is commanded."""
    yaw_rate_peak: float
    """Largest absolute yaw rate [rad/s]."""
    ripple: float
    """Range of the hub's height [m]."""


def worst(found: list[Rolling]) -> Rolling:
    """Return the largest deviation of each kind, with its sign."""
    names = Rolling.__dataclass_fields__
    return Rolling(*(max((getattr(one, name) for one in found), key=abs) for name in names))


def roll(mj_model: mujoco.MjModel, robot: WheeledRobot, direction: float, seed: int) -> Rolling:
    """Drive a robot in one direction by constant wheel speeds, wheels at random angles at first.

    Args:
      mj_model: Compiled file of the robot.
      robot: Gives the kinematics.
      direction: Direction of the commanded velocity in the body's frame [rad].
      seed: Seed of the wheels' angles.
    """
    ahead = np.array([math.cos(direction), math.sin(direction)])
    command = robot.wheel_speeds(np.array([*(SPEED * ahead), 0.0]))
    mj_data, step = mujoco.MjData(mj_model), mj_model.opt.timestep
    angles = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, len(command))
    for i, angle in enumerate(angles, start=1):
        mj_data.joint(f"wheel_{i}_axle").qpos[0] = angle
    for k in range(round(_SETTLE / step)):
        mj_data.ctrl[:] = min(1.0, 2.0 * k * step / _SETTLE) * command
        mujoco.mj_step(mj_model, mj_data)
    rows = np.empty((round(_MEASURED / step), 5))
    for row in rows:
        mujoco.mj_step(mj_model, mj_data)
        row[:2], row[2], row[3] = mj_data.qvel[:2], mj_data.qvel[5], mj_data.qpos[2]
        row[4] = 2.0 * math.atan2(mj_data.qpos[6], mj_data.qpos[3])
    turn = np.exp(-1j * rows[:, 4]) * (rows[:, 0] + 1j * rows[:, 1])  # velocity in the body's frame
    mean = complex(turn.mean()) * complex(ahead[0], -ahead[1]) / SPEED
    return Rolling(
        mean.real - 1.0,
        mean.imag,
        float(rows[:, 2].mean()),
        float(np.abs(rows[:, 2]).max()),
        float(np.ptp(rows[:, 3])),
    )


def roll_around(mj_model: mujoco.MjModel, robot: WheeledRobot, directions: int, seed: int) -> Rolling:
    """Return the worst of free rolling in equally spaced directions, each with other wheel angles."""
    return worst([roll(mj_model, robot, 2.0 * math.pi * k / directions, seed + k) for k in range(directions)])


def _size_of(shape: str, wheel: RollerWheel) -> list[float]:
    """Size of a roller's geom in the order of MuJoCo; as long as the roller as built."""
    b, cut = wheel.roller_radius, wheel.roller_half_length
    return {
        "ellipsoid": [wheel.half_length, b, b],
        "sphere": [b, 0.0, 0.0],
        "cylinder": [b, cut, 0.0],
        "capsule": [b, max(cut - b, 0.1 * b), 0.0],
    }[shape]


SHAPES = ("ellipsoid", "sphere", "cylinder", "capsule")
"""Shapes of rollers that are compared."""
Change = Callable[["mujoco.MjSpec"], None]


def _with(**options: float) -> Change:
    def change(spec: mujoco.MjSpec) -> None:
        for name, value in options.items():
            setattr(spec.option, name, value)

    return change


def _default_contact(spec: mujoco.MjSpec) -> None:
    for pair in spec.pairs:
        pair.solref, pair.solimp = [0.02, 1.0], [0.9, 0.95, 0.001, 0.5, 2.0]


def _nothing(spec: mujoco.MjSpec) -> None:
    pass


@dataclass(frozen=True)
class Variant:
    """Contact that is compared with the one as written."""

    contact: SolverContact = field(default_factory=SolverContact)
    change: Change = _nothing
    """Applied to the parsed file."""
    touch: str = "floor"


CONTACTS: Mapping[str, Variant] = MappingProxyType(
    {
        "as written": Variant(),
        "touch everything": Variant(touch="everything"),
        "MuJoCo's default contact": Variant(change=_default_contact),
        "time constant 0.01 s": Variant(SolverContact(time_constant=0.01)),
        "impedance 0.9": Variant(SolverContact(impedance=0.9)),
        "impedance 0.99": Variant(SolverContact(impedance=0.99)),
        "pyramidal cone": Variant(change=_with(cone=0)),
        "impratio 10": Variant(change=_with(impratio=10.0)),
        "3 noslip iterations": Variant(change=_with(noslip_iterations=3)),
        "step 2 ms": Variant(SolverContact(timestep=0.002)),
    }
)
"""Contacts that are compared, by the words of the table."""


def _model(robot: WheeledRobot, variant: Variant, shape: str) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(robot_file(robot, variant.contact, variant.touch))
    for geom in [g for g in spec.geoms if g.type == mujoco.mjtGeom.mjGEOM_ELLIPSOID]:
        geom.type, geom.size = (
            getattr(mujoco.mjtGeom, f"mjGEOM_{shape.upper()}"),
            _size_of(shape, robot.wheel),
        )
        if shape in ("cylinder", "capsule"):  # their axis is z
            geom.quat = [math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0]
    variant.change(spec)
    return spec.compile()


@dataclass(frozen=True)
class Case:
    """One line of the tables: a robot, the shape of its rollers, their contact."""

    layout: str
    shape: str
    contact: str

    @property
    def robot(self) -> WheeledRobot:
        """The robot of the layout, otherwise as by default."""
        return wheeled_robot(self.layout)

    def model(self) -> mujoco.MjModel:
        """Compile the robot's file, changed as the case states."""
        return _model(self.robot, CONTACTS[self.contact], self.shape)


def cases() -> Iterator[Case]:
    """Yield every layout with every shape, then one of omni and mecanum wheels with every contact."""
    for layout in LAYOUTS:
        for shape in SHAPES:
            yield Case(layout, shape, "as written")
    for layout in ("omni4", "mecanum4"):
        for contact in list(CONTACTS)[1:]:
            yield Case(layout, "ellipsoid", contact)


@dataclass(frozen=True)
class Measured:
    """Measurements of one case."""

    case: Case
    rolling: Rolling
    step_us: float
    """Shortest time of a step [µs]."""
    ratio: float
    """That time over a step of omnimj's own robot with its native contact."""


def measure_wheels(
    directions: int = 24, seed: int = 1, rounds: int = 100, report: Callable[[int, int], None] | None = None
) -> list[Measured]:
    """Measure every case.

    Args:
      directions: Directions of the drives.
      seed: Seed of the wheels' angles.
      rounds: Interleaved rounds of timing; the shortest time counts.
      report: Called with the number of cases that are done, and of all.
    """
    chosen, rollings = list(cases()), []
    models = [case.model() for case in chosen]
    for k, (case, model) in enumerate(zip(chosen, models, strict=True)):
        rollings.append(roll_around(model, case.robot, directions, seed))
        if report is not None:
            report(k + 1, len(chosen))
    own, *times = _step_times(chosen, models, rounds)
    return [
        Measured(case, rolling, time, time / own)
        for case, rolling, time in zip(chosen, rollings, times, strict=True)
    ]


def _step_times(chosen: list[Case], models: list[mujoco.MjModel], rounds: int) -> Array:
    """Shortest times of a step, that of omnimj's own robot first, shape (1 + cases,) [µs]."""

    install()
    own = robot_model(read_robot(), read_floors()["natural_stone"], lean=True)
    moving = [mujoco.MjData(model) for model in (own, *models)]
    controls = [np.array(_CURRENTS), *(case.robot.wheel_speeds(np.array([0.3, 0.2, 0.0])) for case in chosen)]
    for model, data, control in zip((own, *models), moving, controls, strict=True):
        data.ctrl[:] = control
        mujoco.mj_step(model, data, 10 * _CHUNK)

    def step(k: int) -> float:
        return wall_time(lambda: mujoco.mj_step((own, *models)[k], moving[k], _CHUNK))

    times = np.array([[step(k) for k in range(len(moving))] for _ in range(rounds)])
    return 1e6 * times.min(axis=0) / _CHUNK


HEADINGS = (
    "robot",
    "rollers",
    "contact",
    "speed error",
    "direction error",
    "yaw rate, mean",
    "yaw rate, peak",
    "hub ripple",
    "step",
    "/ own contact",
)
"""Headings of `rows`."""


def rows(found: list[Measured]) -> list[tuple[str, ...]]:
    """Return the table's rows as text."""
    return [
        (
            one.case.layout,
            one.case.shape,
            one.case.contact,
            f"{100.0 * one.rolling.speed_error:+.2f} %",
            f"{100.0 * one.rolling.direction_error:+.2f} %",
            f"{one.rolling.yaw_rate_mean:+.4f} rad/s",
            f"{one.rolling.yaw_rate_peak:.4f} rad/s",
            f"{1e6 * one.rolling.ripple:.0f} µm",
            f"{one.step_us:.1f} µs",
            f"{one.ratio:.2f}",
        )
        for one in found
    ]
