"""Which free windows are compared, and in which steps: against closed forms of a pendulum."""

import mujoco
import numpy as np
import pytest

from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.estimate.replay.mjcf.rigid import RigidBodies
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.dataset import Dataset, Run

LENGTH, GRAVITY, MASS = 0.05, 9.81, 0.5
RATE = np.sqrt(GRAVITY / LENGTH)
PENDULUM = f"""<mujoco><option timestep="0.01" gravity="0 0 {-GRAVITY}"/><worldbody><body name="rod">
  <joint name="pivot" type="hinge" axis="0 1 0"/><inertial pos="0 0 SIDE" mass="{MASS}"
  diaginertia="1e-7 1e-7 1e-7"/></body></worldbody><actuator><motor name="drive" joint="pivot"/></actuator>
  </mujoco>"""
NOISE = 1e-4


@pytest.fixture(params=["closed form", "MuJoCo"])
def route(request, monkeypatch):
    """Both ways to simulate a window of a machine with a single joint."""
    if request.param == "MuJoCo":
        monkeypatch.setattr(RigidBodies, "one_joint", lambda *_: None)


def replay_of_pendulum(tmp_path, side, noise):
    """Replay of a pendulum that swings as 0.05 sin 8 t; side: 1 stands, −1 hangs."""
    file = tmp_path / "pendulum.xml"
    file.write_text(PENDULUM.replace("SIDE", str(side * LENGTH)))
    time = np.arange(0.0, 4.0, 0.01)
    angle = 0.05 * np.sin(8.0 * time)
    torque = -MASS * LENGTH**2 * 64.0 * angle - side * MASS * GRAVITY * LENGTH * np.sin(angle)
    wrong = noise * np.random.default_rng(0).standard_normal(len(time))
    columns = {"time": time, "position:pivot": angle + wrong, "control:drive": torque}
    return MachineReplay(Dataset(file, "mjcf", (Run("a", columns, {}, {}),)), read_machine_file(file))


@pytest.mark.usefixtures("route")
def test_a_window_counts_until_the_error_of_its_start_is_three_times_that_of_a_free_body(tmp_path):
    standing = replay_of_pendulum(tmp_path, 1, NOISE)
    log = standing.log
    after = (np.arange(len(log.times)) + 0.5) * log.size * log.period
    by_speed = log.speed_noise * np.sinh(RATE * after) / RATE
    grown = np.hypot(log.position_noise * np.cosh(RATE * after), by_speed)
    free = np.hypot(log.position_noise, log.speed_noise * after)
    lasts = int(np.argmax(grown > 3.0 * free))
    column = [c.name for c in standing.channels].index("position:pivot")
    for segment in standing.segments:
        used = np.isfinite(standing.measured[segment.first : segment.last, column])
        assert used[: lasts - 1].all() and not used[lasts + 1 :].any()
    hanging = replay_of_pendulum(tmp_path, -1, NOISE)
    assert np.isfinite(hanging.measured[:, column]).all()
    noted, other = (any("windows is left out" in note for note in r.notes) for r in (standing, hanging))
    assert noted and not other


LINKS = """<mujoco><option timestep="0.01"/><worldbody><body name="upper"><joint name="top" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/><body name="lower" pos="0 0 -.3">
  <joint name="middle" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/></body></body>
  </worldbody><actuator><motor name="drive" joint="top"/></actuator></mujoco>"""


def replay_of_free_links(tmp_path, noise):
    """Replay of two links that swing freely from level, after MuJoCo's own Runge-Kutta steps of 0.1 ms."""
    file = tmp_path / "links.xml"
    file.write_text(LINKS)
    model = mujoco.MjModel.from_xml_path(str(file))
    model.opt.timestep, model.opt.integrator = 1e-4, mujoco.mjtIntegrator.mjINT_RK4
    data, angles = mujoco.MjData(model), []
    data.qpos[:] = 0.5 * np.pi, 0.2
    for _ in range(400):
        angles.append(data.qpos.copy())
        mujoco.mj_step(model, data, 100)
    measured = np.array(angles) + noise * np.random.default_rng(0).standard_normal((400, 2))
    columns = {"time": 0.01 * np.arange(400.0), "control:drive": np.zeros(400)}
    columns |= {"position:top": measured[:, 0], "position:middle": measured[:, 1]}
    return MachineReplay(Dataset(file, "mjcf", (Run("a", columns, {}, {}),)), read_machine_file(file))


@pytest.mark.slow
def test_the_steps_of_windows_are_short_enough_for_the_noise_and_shorter_where_there_is_less(tmp_path):
    exact, noisy = (replay_of_free_links(tmp_path, noise) for noise in (1e-4, 3e-2))
    assert exact.substeps > noisy.substeps
    (found,) = exact.simulate([Setting(np.array([b.nominal for b in exact.base]))])
    for column, channel in enumerate(exact.channels):
        if channel.name.startswith("position"):
            wrong = (exact.measured - found)[:, column]
            assert np.sqrt(np.nanmean(wrong**2)) < 2.0 * channel.equation_error


@pytest.mark.slow
def test_a_setting_that_no_step_can_follow_gives_numbers_and_no_warning_of_mujoco(
    tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)
    replay = replay_of_free_links(tmp_path, 1e-4)
    (spring,) = (c for c in replay.candidates if c.label == "stiffness (middle)")
    values = np.array([1e5 if s.name == "stiffness" else 0.0 for s in spring.parameters])
    stiff = Setting(np.array([b.nominal for b in replay.base]), {spring.label: values})
    (found,) = replay.simulate([stiff])
    assert np.isfinite(found[np.isfinite(replay.measured)]).all()
    assert "unstable" not in "".join(capfd.readouterr()) and not (tmp_path / "MUJOCO_LOG.TXT").exists()
