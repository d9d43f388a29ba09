"""Laws of one wheel on the floor: traction against its closed form, roller passing against geometry."""

import math

import mujoco
import numpy as np
import pytest
from driven import axle, run, without_friction
from nightly import representative

from omnimj.parameters import read_floors
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.twin import RigTwin, RobotTwin

FLOORS = list(read_floors())
SLIPS = (-1.2, -0.6, -0.2, -0.05, 0.01, 0.1, 0.4, 1.2)


def closed_form(floor, slip, time):
    """F/F_N of a wheel that slips at a constant speed from time 0 on, at the floor's reference load."""
    ceiling = floor.numbers.get("mu_cap", math.inf)
    return max(-ceiling, min(uncapped(floor, slip, time), ceiling))


def uncapped(floor, slip, time):
    """The same without a ceiling, written afresh from Eqs. 3.17-3.43 and the brush model."""
    n = floor.numbers
    if floor.law == "creep_ratio":
        full = 3.0 * n["mu"] / n["creep_stiffness"]
        rate = abs(slip) * max(1.0, 1.0 / full) / n["relaxation_length"]
        decay = math.exp(-rate * time)
        calming = n["damping_time"] * decay / (1.0 + n["damping_time"] * rate)
        creep = slip * ((1.0 - decay) / rate + calming) / n["relaxation_length"]
        return math.copysign(n["mu"] * (1.0 - max(1.0 - abs(creep) / full, 0.0) ** 3), slip)
    if floor.law == "magic_formula":
        relaxation = abs(slip) / n["relaxation_length"]
        z = slip / relaxation * (1.0 - math.exp(-relaxation * time))
        s = n["B"] * (z + n["damping_time"] * slip * math.exp(-relaxation * time)) / n["relaxation_length"]
        return n["D"] * math.sin(n["C"] * math.atan(s - n["E"] * (s - math.atan(s))))
    g = n["mu_c"] + (n["mu_s"] - n["mu_c"]) * math.exp(-math.sqrt(abs(slip / n["V_s"])))
    decay = math.exp(-n["sigma_0"] * abs(slip) / g * time)
    z = math.copysign(g / n["sigma_0"], slip) * (1.0 - decay)
    a = g / abs(slip)  # beyond this bound on the damping LuGre would make energy
    damping = min(n["sigma_1"], 2.0 * (a + math.sqrt(a * (a + n["sigma_2"]))))
    return n["sigma_0"] * z + damping * slip * decay + n["sigma_2"] * slip


def loaded(floor, normal):
    """(F_N/F_ref)^(p−1), shape of `normal`."""
    exponent = floor.numbers.get("load_exponent", 1.0)
    return (normal / floor.numbers.get("reference_load", 1.0)) ** (exponent - 1.0)


def settled_bristle(floor, slip):
    """Deflection of a bristle that has slipped at this speed for long, the wheel's hub at rest [m]."""
    n = floor.numbers
    if floor.law == "magic_formula":
        return n["relaxation_length"] * math.copysign(1.0, slip)
    if floor.law == "creep_ratio":
        full = 3.0 * n["mu"] / n["creep_stiffness"]
        return n["relaxation_length"] * math.copysign(min(1.0, full), slip)
    g = n["mu_c"] + (n["mu_s"] - n["mu_c"]) * math.exp(-math.sqrt(abs(slip / n["V_s"])))
    return math.copysign(g / n["sigma_0"], slip)


@pytest.mark.slow
@pytest.mark.parametrize("name", FLOORS)
def test_a_clamped_carriage_shows_the_closed_form_of_its_floor(rig, floors, name, measured):
    twin = RigTwin(rig, floors[name], ideal_sensors=True)
    m = twin.mj_model
    for slip in SLIPS:
        twin.reset()
        speeds = {axle(m): slip / rig.wheel.radius, int(m.joint("rail").dofadr[0]): 0.0}
        _, _, felt = run(twin, speeds, 400)
        block = int(m.sensor("wheel_1_contact").adr[0])
        normal, traction = felt[:, block + 1], felt[:, block + 2]
        expected = np.array([closed_form(floors[name], slip, k * 1e-3) for k in range(400)])
        steady = closed_form(floors[name], slip, math.inf)
        scaled = traction / (normal * loaded(floors[name], normal))
        transient = np.abs(scaled - expected).max() / abs(steady)
        measured("traction at a fixed slip, bristle transient [1]", transient, 0.02)
        assert transient < 0.02
        if abs(expected[-1] / steady - 1.0) < 1e-3:
            assert scaled[-50:].mean() == pytest.approx(steady, rel=0.01)


@pytest.mark.parametrize("name", FLOORS)
def test_a_settled_bristle_gives_the_steady_curve(rig, floors, name, measured):
    twin = RigTwin(rig, floors[name], ideal_sensors=True)
    m, d = twin.mj_model, twin.mj_data
    for slip in SLIPS:
        twin.reset()
        floor = floors[name]
        d.act[slots.BRISTLE] = settled_bristle(floor, slip)
        speeds = {axle(m): slip / rig.wheel.radius, int(m.joint("rail").dofadr[0]): 0.0}
        _, _, felt = run(twin, speeds, 150)
        block = int(m.sensor("wheel_1_contact").adr[0])
        normal, traction = felt[50:, block + 1], felt[50:, block + 2]
        ratio = traction.sum() / (normal * loaded(floor, normal)).sum()
        off = abs(ratio / closed_form(floor, slip, math.inf) - 1.0)
        measured("traction at a fixed slip against the closed form [1]", off, 0.01)
        assert off <= 0.01


def envelope_drop(wheel, angle):
    """How far the wheel's outline lies below its radius between two rollers, from the ellipsoid alone [m]."""
    b, centre = wheel.roller_radius, wheel.radius - wheel.roller_radius
    reach = np.sqrt((b * np.cos(angle)) ** 2 + wheel.radius * b * np.sin(angle) ** 2)
    return wheel.radius - centre * np.cos(angle) - reach


@pytest.mark.parametrize("turning", representative(5.0, 2.0))
def test_roller_passing_lifts_the_axle_by_the_geometric_drop_18_times_a_turn(
    robot, floors, turning, measured
):
    free = without_friction(robot)
    twin = RobotTwin(free, floors["natural_stone"], ideal_sensors=True)
    twin.reset()
    m = twin.mj_model
    speeds = {axle(m, 2): -turning, axle(m, 4): turning, 0: turning * robot.wheel.radius}
    steps = int(3 * 2.0 * math.pi / turning / 1e-3)
    lifted, angles = np.empty(steps), np.empty(steps)
    wheel, address = m.body("wheel_4_wheel").id, int(m.joint("wheel_4_axle").qposadr[0])
    for k in range(steps):
        run(twin, speeds, 1)
        lifted[k], angles[k] = twin.mj_data.xpos[wheel, 2], twin.mj_data.qpos[address]
    # resample over the angle turned: lines of the spectrum are then multiples of a turn
    grid = np.linspace(2.0 * math.pi, 6.0 * math.pi, 4096, endpoint=False)
    height = np.interp(grid, angles, lifted)
    assert angles[-1] > 5.9 * math.pi
    turns = (grid[-1] - grid[0]) / (2.0 * math.pi)
    lines = np.abs(np.fft.rfft(height - height.mean())) * 2.0 / len(height)
    passing = np.argmax(lines) / (turns * len(height) / (len(height) - 1))
    drop = envelope_drop(robot.wheel, math.radians(10.0))
    measured("roller passing: frequency over turning rate against 18 [1]", abs(passing / 18.0 - 1.0), 0.01)
    measured("roller passing: lift of the axle against geometry [1]", abs(np.ptp(height) / drop - 1.0), 0.15)
    assert passing == pytest.approx(18.0, rel=0.01)
    assert np.ptp(height) == pytest.approx(drop, rel=0.15)
    cycle = -envelope_drop(robot.wheel, np.radians(np.linspace(-10.0, 10.0, 400, endpoint=False)))
    first = 2.0 * np.abs(np.fft.rfft(cycle))[1] / 400
    assert lines.max() == pytest.approx(first, rel=0.15)


@pytest.mark.parametrize(
    ("speed", "degrees"),
    [
        pytest.param(
            speed, degrees, marks=[pytest.mark.slow] * (degrees % 75 > 0 or speed != (0.3, 1.0)[k % 2])
        )
        for k, degrees in enumerate(range(0, 360, 15))
        for speed in (0.3, 1.0)
    ],
)
def test_free_rollers_follow_the_kinematics_in_every_direction(robot, floors, speed, degrees, measured):
    twin = RobotTwin(without_friction(robot), floors["natural_stone"], ideal_sensors=True)
    twin.reset()
    along = math.radians(degrees)
    velocity = speed * np.array([math.cos(along), math.sin(along)])
    wheel_speed = robot.drive_directions @ velocity / robot.wheel.radius
    twin.mj_data.qvel[:2] = velocity
    speeds = {axle(twin.mj_model, i + 1): w for i, w in enumerate(wheel_speed)}
    _, rates, _ = run(twin, speeds, 900)
    mean = rates[300:, :2].mean(axis=0)
    off = np.linalg.norm(mean - velocity) / speed
    measured("free rollers: body velocity against kinematics [1]", off, 0.005)
    measured("free rollers: standard deviation of the yaw rate [rad/s]", np.std(rates[300:, 5]), 0.01)
    assert off < 0.005
    assert np.std(rates[300:, 5]) <= 0.01


def test_a_wheel_feels_a_patch_only_where_it_lies(robot, floors):
    from omnimj.plant.ground import Patch

    patch = Patch("oil", (0.25, 0.0), (0.1, 0.1))
    twin = RobotTwin(robot, floors["natural_stone"], patches=(patch,), ideal_sensors=True)
    twin.reset()
    speeds = {axle(twin.mj_model, i): 0.2 / robot.wheel.radius for i in (1, 2, 3, 4)}
    speeds |= {0: 0.0, 1: 0.0, 5: 0.0}
    _, _, felt = run(twin, speeds, 400)
    block = int(twin.mj_model.sensor("wheel_1_contact").adr[0])
    ratios = felt[-50:, block:].reshape(50, 4, -1).mean(axis=0)
    ratios = ratios[:, 2] / ratios[:, 1]
    assert ratios[0] == pytest.approx(closed_form(floors["oil"], 0.2, math.inf), rel=0.01)
    for ratio in ratios[1:]:
        assert ratio == pytest.approx(closed_form(floors["natural_stone"], 0.2, math.inf), rel=0.01)
    assert mujoco.mj_id2name(twin.mj_model, mujoco.mjtObj.mjOBJ_GEOM, twin.mj_model.geom("patch_1").id)
