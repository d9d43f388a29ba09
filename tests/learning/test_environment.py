"""The environment: its interface, and that it does what the loop of `omnimj run` does."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from nightly import representative

import omnimj
import omnimj.learning.simulation
from omnimj.control.cascade.controller import Controller
from omnimj.errors import InputError, UnknownNameError
from omnimj.learning import ENVIRONMENT
from omnimj.learning.environment import OmniDrive
from omnimj.learning.observation import entries
from omnimj.learning.options import draw_plan, read_task
from omnimj.parameters import read_floors, read_robot
from omnimj.simulate.driving import drive
from omnimj.simulate.plants import make_simulated
from omnimj.simulate.scenario.drive import read_drive
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.simulate.suites.missions import mission

ROOT = Path(omnimj.__file__).parent.parent
ROBOT = read_robot()
PLANTS = representative("planar", "twin")
LINE = {"kind": "profile", "speed": 0.6, "acceleration": 1.0, "direction": 0.7, "yaw_rate": 0.5}
SHORT = {"drive": LINE, "duration": 0.6, "energy_weight": 0.0}
LATE_SLIP = {"kind": "slip", "wheel": 2, "onset": 0.3, "grip": 0.3}


def environment(**options) -> Any:
    return gymnasium.make(ENVIRONMENT, disable_env_checker=True, **options).unwrapped


def played(made: Any, seed, actions=None, decisions=1000) -> Any:
    """Observations, rewards, poses of an episode, and its end."""
    draws = np.random.default_rng(5)
    seen, info = made.reset(seed=seed)
    rows, terminated, truncated = [(seen, 0.0, info["pose"])], False, False
    for _ in range(decisions):
        action = draws.uniform(-1, 1, made.action_space.shape) if actions is None else actions
        seen, reward, terminated, truncated, info = made.step(action)
        rows.append((seen, reward, info["pose"]))
        if terminated or truncated:
            break
    observations, rewards, poses = (np.array(column) for column in zip(*rows, strict=True))
    return observations, rewards, poses, terminated, truncated


def driven(plant, seed, faults=()):
    """The trace of the loop of scenarios, with the sensor noise of an episode."""
    reference = read_drive(LINE, "drive", 0.6, 1e-3).reference
    noise = int(gymnasium.utils.seeding.np_random(seed)[0].integers(2**31))
    robot = make_simulated(plant, ROBOT, "natural_stone", read_floors(), seed=noise, faults=faults)
    return drive(robot, Controller(ROBOT, period=1e-3), reference)


@pytest.mark.slow
@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("action", ["twist", "currents"])
def test_gymnasium_accepts_it_without_a_warning(plant, action):
    made = environment(plant=plant, action=action, render_mode="rgb_array", duration=3.0)
    made.spec = gymnasium.spec(ENVIRONMENT)
    made.spec.kwargs = {"plant": plant}
    check_env(made)


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("action", ["twist", "wheel_speeds"])
def test_an_action_of_zero_leaves_the_cascade_as_it_is_bit_for_bit(plant, action):
    _, rewards, poses, terminated, truncated = played(
        environment(plant=plant, action=action, **SHORT), 3, np.zeros(3 if action == "twist" else 4)
    )
    trace = driven(plant, 3)
    expected = np.column_stack([trace[name] for name in ("x", "y", "heading")])[::20]
    assert truncated and not terminated and len(poses) == 31
    np.testing.assert_array_equal(poses, expected)
    error = np.hypot(trace["x"] - trace["target_x"], trace["y"] - trace["target_y"])
    turned = np.abs(trace["heading"] - trace["target_heading"])
    by_trace = -1e-3 * np.add.reduceat((error + turned)[1:], np.arange(0, 600, 20)) / 0.1
    np.testing.assert_allclose(rewards[1:], by_trace, rtol=1e-12)


def test_the_observation_is_measurement_and_target_over_their_scales():
    observations = played(environment(plant="planar", **SHORT), 3, np.zeros(3))[0]
    trace = driven("planar", 3)
    rows, ahead = np.arange(0, 601, 20), np.minimum(np.arange(0, 601, 20) + 100, 600)
    seen = {e.name: e.scale * observations[:, k] for k, e in enumerate(entries(ROBOT))}
    for name in ("wheel_speed_3", "current_2", "acceleration_x", "acceleration_y"):
        np.testing.assert_allclose(seen[name], trace[name][rows], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(
        seen["yaw_rate"][1:], (trace["yaw_rate"] - trace["gyro_bias"])[rows[1:]], rtol=1e-5, atol=1e-6
    )
    # the cascade's estimate of the period before
    heading = trace["heading_estimate"][np.maximum(rows - 1, 0)][1:]
    np.testing.assert_allclose(
        seen["heading_error"][1:], (trace["target_heading"][rows[1:]] - heading), rtol=1e-5, atol=1e-6
    )
    for name, at in (("target", rows), ("ahead", ahead)):
        x, y = trace["target_velocity_x"][at[1:]], trace["target_velocity_y"][at[1:]]
        along = np.cos(heading) * x + np.sin(heading) * y
        np.testing.assert_allclose(seen[f"{name}_velocity_x"][1:], along, rtol=1e-5, atol=1e-6)
    rolled = 0.25 * ROBOT.wheel.radius * trace.wheels("wheel_speed") @ ROBOT.drive_directions * 2.0
    estimate = trace["heading_estimate"][:-1]
    x = np.cos(estimate) * rolled[1:, 0] - np.sin(estimate) * rolled[1:, 1]
    y = np.sin(estimate) * rolled[1:, 0] + np.cos(estimate) * rolled[1:, 1]
    away_x = trace["target_x"][rows[1:]] - np.cumsum(x)[rows[1:] - 1] * 1e-3
    away_y = trace["target_y"][rows[1:]] - np.cumsum(y)[rows[1:] - 1] * 1e-3
    by_trace = np.cos(heading) * away_x + np.sin(heading) * away_y
    np.testing.assert_allclose(seen["behind_x"][1:], by_trace, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("plant", PLANTS)
def test_a_seed_determines_the_episode_bit_for_bit(plant):
    made = environment(plant=plant, duration=3.0)
    first, again, other = (played(made, seed, decisions=60) for seed in (4, 4, 5))
    for one, same, different in zip(first[:3], again[:3], other[:3], strict=True):
        np.testing.assert_array_equal(one, same)
        assert not np.array_equal(one, different)


def test_the_observation_knows_nothing_of_a_fault_before_it_acts():
    healthy = played(environment(plant="planar", **SHORT), 1, np.zeros(3))
    faulty = played(environment(plant="planar", faults=[LATE_SLIP], **SHORT), 1, np.zeros(3))
    np.testing.assert_array_equal(healthy[0][:16], faulty[0][:16])
    assert not np.array_equal(healthy[0][16:], faulty[0][16:])
    made = environment(plant="planar", faults=[LATE_SLIP], **SHORT)
    made.reset(seed=1)
    active = [made.step(np.zeros(3))[4]["fault_active"] for _ in range(30)]
    assert active == [False] * 14 + [True] * 16


def test_leaving_the_plan_ends_the_episode_and_is_not_rewarded():
    made = environment(plant="planar", largest_error=0.05, **SHORT)
    _, rewards, poses, terminated, truncated = played(made, 1, np.array([-1.0, -1.0, 0.0]))
    assert terminated and not truncated and len(poses) < 31
    left = 0.6 - 0.02 * (len(poses) - 1)
    assert rewards[-1] < -left * 0.05 / 0.1
    assert rewards.sum() < played(made, 1, np.zeros(3))[1].sum()


def test_a_broken_simulation_ends_the_episode_with_finite_numbers(monkeypatch):
    monkeypatch.setattr(omnimj.learning.simulation, "LARGEST_TRUTH", 1.0)
    made = environment(plant="planar", **SHORT)
    made.reset(seed=0)
    seen, reward, terminated, truncated, _ = made.step(np.zeros(3))
    assert terminated and not truncated and np.isfinite(reward) and seen in made.observation_space


def test_currents_drive_the_robot_along_x_and_cost_energy():
    made = environment(
        plant="planar", action="currents", duration=0.5, drive={"kind": "hold"}, energy_weight=1.0
    )
    made.reset(seed=0)
    still = [made.step(np.zeros(4))[4] for _ in range(5)][-1]
    assert np.abs(still["pose"]).max() < 1e-4 and still["energy"] < 1e-3
    for _ in range(10):
        _, reward, _, _, info = made.step(np.array([0.0, -0.3, 0.0, 0.3]))
    assert info["pose"][0] > 1e-3 and abs(info["pose"][1]) < 1e-3
    away = info["tracking_error"] + info["heading_error"]
    assert reward == pytest.approx(-info["energy"] - 0.02 * away / 0.1)


def test_the_energy_is_that_of_currents_and_back_emf():
    made = environment(plant="planar", **SHORT | {"energy_weight": 1.0})
    made.reset(seed=3)
    energy = sum(made.step(np.zeros(3))[4]["energy"] for _ in range(30))
    trace, motor = driven("planar", 3), ROBOT.motor
    current, speed = trace.wheels("current"), trace.wheels("wheel_speed")
    power = (current * (motor.resistance * current + motor.torque_constant * motor.gear_ratio * speed)).sum(
        axis=1
    )
    assert energy == pytest.approx(1e-3 * np.maximum(power, 0.0).sum(), rel=0.05)


def test_random_motions_are_those_of_the_missions():
    for seed in range(5):
        plan = draw_plan(np.random.default_rng(seed), 12.0, 1e-3)
        by_loop = mission(np.random.default_rng(seed), 12.0, 1e-3)
        columns = np.column_stack([by_loop.position, by_loop.heading, by_loop.velocity])
        np.testing.assert_allclose(plan.columns, columns, atol=1e-9)
        np.testing.assert_allclose(plan.yaw_rate, by_loop.yaw_rate, atol=1e-9)


def test_a_scenario_gives_drive_floor_and_faults_and_options_replace_them():
    task = read_task(scenario="degraded_motor", plant="planar", floor="pvc", duration=3.0)
    assert task.faults and task.floor == "pvc"
    assert task.plan is not None and len(task.plan.yaw_rate) == 3001
    assert read_task(scenario="degraded_motor", faults=[]).faults == ()
    read = read_scenario("circle_8m", ["duration=2"])
    assert len(read_task(scenario=read).draw_plan(np.random.default_rng(0)).yaw_rate) == 2001
    with pytest.raises(InputError, match=r"duration: found 3\.0; circle_8m has been read"):
        read_task(scenario=read, duration=3.0)
    assert read_task(scenario="three_wheel_circle").robot.wheel_count == 3
    made = environment(scenario="three_wheel_circle", plant="planar", action="wheel_speeds", duration=0.2)
    assert made.observation_space.shape == (18,) and made.action_space.shape == (3,)
    assert played(made, 0)[4]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"flor": "pvc"}, "unknown option 'flor'; did you mean 'floor'"),
        ({"floor": "pcv"}, "floor: unknown floor 'pcv'; did you mean 'pvc'"),
        ({"plant": "real"}, "plant: unknown plant 'real'; choices: planar, twin"),
        ({"action": "torque"}, "action: unknown action 'torque'; choices: currents"),
        ({"scenario": "rig_slip"}, "a scenario of a robot with forces is needed"),
        ({"scenario": "mission"}, "unknown scenario 'mission'; did you mean 'missions'"),
        ({"scenario": 3}, "found 3"),
        ({"faults": "slip"}, "faults: found 'slip'; a list of tables is needed"),
        ({"faults": [{"kind": "slipp"}]}, "faults.0.kind: unknown kind 'slipp'"),
        ({"drive": {"kind": "loop"}}, "drive.kind: unknown drive 'loop'"),
        ({"decision_period": 0.0015}, "must be a multiple of the control period, 0.001 s"),
        ({"duration": float("nan")}, "duration: found nan"),
        ({"duration": 1.0}, "duration: found 1.0; must be at least 3"),
        ({"largest_error": 0}, "largest_error: found 0; must be above 0"),
        ({"energy_weight": "much"}, "energy_weight: found 'much'"),
        ({"render_mode": "ascii"}, "render_mode: unknown mode 'ascii'; choices: rgb_array"),
        ({"scenario": "ramp", "plant": "planar"}, "this scenario's scene is for the twin only"),
    ],
)
def test_a_bad_option_is_one_clear_line(options, message):
    with pytest.raises(InputError) as caught:
        OmniDrive(**options)
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_a_bad_action_is_one_clear_line():
    made = environment(plant="planar", **SHORT)
    made.reset(seed=0)
    for action, words in ((np.zeros(4), "shape (3,)"), ([0, np.nan, 0], "finite"), ("left", "numbers")):
        with pytest.raises(InputError, match="action: ") as caught:
            made.step(action)
        assert words in str(caught.value)
    with pytest.raises(UnknownNameError):
        gymnasium.make_vec(ENVIRONMENT, num_envs=2, autoreset_mode="Never")


def test_the_picture_shows_robot_and_path():
    made = environment(plant="planar", render_mode="rgb_array", **SHORT)
    made.reset(seed=0)
    first = made.render()
    for _ in range(20):
        made.step(np.zeros(3))
    later = made.render()
    assert first.shape == (480, 480, 3) and first.dtype == np.uint8 and (first != later).sum() > 100
    assert environment(plant="planar", **SHORT).render() is None


def fresh(script):
    done = subprocess.run(
        [sys.executable, "-P", "-W", "error", "-c", script],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.slow
def test_gymnasium_finds_it_by_the_module_before_the_colon():
    script = f"""
import gymnasium
made = gymnasium.make("omnimj.learning:{ENVIRONMENT}", plant="planar", floor="pvc")
print(made.unwrapped.task.floor, made.spec.id)
import omnimj.learning
omnimj.learning.register_environments()
"""
    assert fresh(script) == f"pvc {ENVIRONMENT}"


def test_without_gymnasium_the_message_says_what_to_install():
    script = """
import sys
sys.modules["gymnasium"] = None
try:
    import omnimj.learning
except ImportError as error:
    print(error)
"""
    assert fresh(script) == "omnimj.learning: Gymnasium is not installed; pip install 'omnimj[gym]'"
