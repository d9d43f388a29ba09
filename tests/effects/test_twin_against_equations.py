"""An effect changes the twin as it changes the equations.

Compared is the change that an effect makes, so that what separates twin and equations without it drops out;
what is left of that (rollers under the wheel, stick and slip at reversals) sets the floor of each bound.
"""

import dataclasses

import numpy as np
import pytest
from driven_plants import RIG, ROBOT, plain, rig_run, rms, robot_run

from omnimj.effects import effects_of, with_effects

RIG_SHARE, ROBOT_SHARE = 0.05, 0.12
RIG_FLOOR, ROBOT_FLOOR, YAW_FLOOR = 1.0e-3, 2.5e-3, 0.025  # m/s, m/s, rad/s
STEPS = 800
CARRIAGE = slice(2, 3)

RIG_EFFECTS = {
    "lateral_coupling": {},
    "rail_coulomb": {},
    "rail_viscous": {},
    "rail_stribeck": {},
    "rail_position": {"position": 0.3},
    "rolling_resistance": {},
    "bearing_friction": {},
    "floor_traction": {},
    "floor_patch": {"start": 0.1, "end": 0.4},
    "payload": {},
    "grade": {},
    "cable_drag": {"stiffness": 4.0},
    "air_drag": {},
    "torque_constant": {},
    "gear_loss": {},
    "supply_sag": {},
    "winding_heating": {},
    "wheel_radius": {},
    "back_driving": {"efficiency": 0.7},
}
BRAKING = {"back_driving"}
"""Effects that show where the carriage drives the motor."""


@pytest.mark.parametrize("name", RIG_EFFECTS)
def test_on_the_rig_the_carriage_is_changed_alike(name, measured):
    lateral = 0.3 if name == "lateral_coupling" else 0.0
    machine, currents = with_effects(RIG, {name: RIG_EFFECTS[name]}), np.full(STEPS, 1.2)
    if name in BRAKING:
        currents[STEPS // 2 :] = -0.6
    changes = {}
    for kind in ("twin", "planar"):
        with_it = rig_run(machine, kind, STEPS, lateral, currents)
        changes[kind] = (with_it - rig_run(RIG, kind, STEPS, lateral, currents))[:, CARRIAGE]
    size, apart = rms(changes["planar"]), rms(changes["twin"] - changes["planar"])
    assert size > 2e-3
    limit = RIG_SHARE * size + RIG_FLOOR
    measured(f"rig, change by {name}: twin less equations, carriage speed [m/s]", apart, limit)
    assert apart <= limit


@pytest.mark.parametrize("name", [n for n, e in effects_of("quarter_rig").items() if e.where == "sensors"])
def test_on_the_rig_a_sensor_s_effect_is_the_same_function_of_its_reading(name):
    effect = effects_of("quarter_rig")[name]
    for choice in effect.selectors[0].choices if effect.selectors else (None,):
        values = {} if choice is None else {"channel": choice}
        machine = with_effects(RIG, {name: values})
        for kind in ("twin", "planar"):
            change = rig_run(machine, kind, 300) - plain("rig", kind, 300)
            assert np.count_nonzero(np.abs(change).max(axis=0)) == 1


@pytest.mark.parametrize(
    ("name", "values", "channel"),
    [
        ("motor_cogging", {"poles": 1.0}, 1),
        ("motor_cogging", {"poles": 2.0}, 1),
        ("roller_ripple", {}, 2),
    ],
)
def test_on_the_rig_a_ripple_is_as_large(name, values, channel, measured):
    # angles of the two drift apart by more than a period: the size of the ripple is what they share
    machine, currents = with_effects(RIG, {name: values}), np.full(400, 0.9)
    sizes = [
        rms((rig_run(machine, kind, 400, 0.0, currents) - rig_run(RIG, kind, 400, 0.0, currents))[:, channel])
        for kind in ("twin", "planar")
    ]
    measured(
        f"rig, {name}: size in the twin over size in the equations, less 1",
        abs(sizes[0] / sizes[1] - 1),
        0.15,
    )
    assert sizes[0] == pytest.approx(sizes[1], rel=0.15)


def test_on_the_rig_backlash_takes_the_same_time(measured):
    machine = with_effects(RIG, {"backlash": {"angle": 0.15}})
    currents = np.where(np.arange(500) < 250, 0.8, -0.8)
    late = []
    for kind in ("twin", "planar"):
        with_it, without = rig_run(machine, kind, 500, 0.0, currents), rig_run(RIG, kind, 500, 0.0, currents)
        change = (with_it - without)[:, 2]
        # before the reversal it is a little behind, while the gap is crossed it is not braked
        late.append((change[200], change[270:300].max()))
    measured(
        "rig, backlash: twin less equations, carriage speed [m/s]", np.abs(np.subtract(*late)).max(), 4e-3
    )
    assert late[1][1] - late[1][0] > 8e-3
    assert np.allclose(late[0], late[1], atol=4e-3)


ONE_ROW = dataclasses.replace(ROBOT, wheel=dataclasses.replace(ROBOT.wheel, row_offset=0.0))
ROBOT_EFFECTS = [
    ("roller_friction", {}),
    ("rolling_resistance", {}),
    ("bearing_friction", {}),
    ("floor_traction", {"mu_c": 0.5, "sigma_2": 0.4}),
    ("floor_patch", {"start": 0.05, "end": 0.6}),
    ("payload", {"mass": 3.0, "x": 0.1, "y": 0.05}),
    ("grade", {"direction": 0.4}),
    ("air_drag", {"coefficient": 8.0}),
    ("torque_constant", {"wheel": 1, "scale": 0.7}),
    ("torque_constant", {"wheel": 2, "scale": 0.7}),
    ("gear_loss", {}),
    ("back_driving", {"efficiency": 0.7}),
    ("supply_sag", {"resistance": 6.0}),
    ("winding_heating", {"rate": 0.2}),
    ("wheel_radius", {"wheel": 2, "scale": 0.95}),
    ("wheel_misalignment", {"wheel": 1, "angle": 0.2}),
    ("wheel_misalignment", {"wheel": 4, "angle": -0.2}),
]


@pytest.mark.parametrize(("name", "values"), ROBOT_EFFECTS)
def test_on_the_robot_the_body_is_changed_alike(name, values, measured):
    # a smaller wheel tilts the robot and its load goes to one of the two rows: the planar model has none
    plain_robot = ONE_ROW if name == "wheel_radius" else ROBOT
    machine = with_effects(plain_robot, {name: values})
    changes = {}
    for kind in ("twin", "planar"):
        shared = plain_robot is ROBOT
        without = plain("robot", kind, 1300) if shared else robot_run(plain_robot, kind, 1300)
        changes[kind] = robot_run(machine, kind, 1300) - without
    apart = changes["twin"] - changes["planar"]
    for columns, floor, quantity in (
        (slice(12, 14), ROBOT_FLOOR, "velocity"),
        (slice(10, 11), YAW_FLOOR, "yaw rate"),
    ):
        size, off = rms(changes["planar"][:, columns]), rms(apart[:, columns])
        limit = ROBOT_SHARE * size + floor
        measured(f"robot, change by {name}: twin less equations, {quantity} over its limit", off / limit, 1.0)
        assert off <= limit, quantity
    assert rms(changes["planar"][:, 12:14]) > 5e-3


def test_on_the_robot_ripples_and_backlash_are_as_large(measured):
    currents = np.where(np.arange(500) < 300, 1.0, -1.0)[:, None] * np.array([0.0, -0.9, 0.0, 0.9])
    for name, values in (
        ("motor_cogging", {"poles": 1.0}),
        ("roller_ripple", {}),
        ("backlash", {"angle": 0.1}),
    ):
        machine = with_effects(ROBOT, {name: values})
        sizes = []
        for kind in ("twin", "planar"):
            change = robot_run(machine, kind, 500, currents) - robot_run(ROBOT, kind, 500, currents)
            sizes.append(rms(change[:, [5, 7]]))
        measured(
            f"robot, {name}: size in twin over size in equations, less 1", abs(sizes[0] / sizes[1] - 1), 0.25
        )
        assert sizes[0] == pytest.approx(sizes[1], rel=0.25), name
