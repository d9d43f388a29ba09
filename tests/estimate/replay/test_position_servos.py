"""Replay of joints driven by position servos: a small following error stands for the force."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from omnimj.estimate.gap.check.machine import machine_suspicions
from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.dataset import Dataset, Run

STIFFNESS, BRAKE, VISCOUS, INERTIA = 400.0, 20.0, 0.5, 0.02
SERVO = f"""<mujoco><worldbody><body name="arm"><joint name="elbow" type="hinge" axis="0 1 0"/>
  <inertial pos="0 0 -.2" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/></body></worldbody>
  <actuator><position name="drive" joint="elbow" kp="{STIFFNESS}" kv="{BRAKE}"/></actuator></mujoco>"""
NOISE = 2e-5


@pytest.fixture(scope="module")
def servo(tmp_path_factory):
    file = tmp_path_factory.mktemp("servo") / "servo.xml"
    file.write_text(SERVO)
    return read_machine_file(file)


def logs(servo, viscous=0.0):
    """Logs of an arm that follows two sines under the commands that the closed form asks for."""
    runs = []
    for seed, pace in enumerate((1.0, 1.3)):
        random = np.random.default_rng(seed)
        time = np.arange(0.0, 6.0, 0.005)
        waves = [(0.5, 3.0 * pace, 0.3), (0.1, 9.0 * pace, 1.0)]
        angle = sum(a * np.sin(w * time + p) for a, w, p in waves)
        rate = sum(a * w * np.cos(w * time + p) for a, w, p in waves)
        bend = sum(-a * w * w * np.sin(w * time + p) for a, w, p in waves)
        force = (INERTIA + 0.2**2) * bend + 9.81 * 0.2 * np.sin(angle) + viscous * rate
        command = angle + (force + BRAKE * rate) / STIFFNESS
        measured = angle + NOISE * random.standard_normal(len(time))
        columns = {"time": time, "position:elbow": measured, "control:drive": command}
        runs.append(Run(f"run_{seed}", MappingProxyType(columns), MappingProxyType({}), MappingProxyType({})))
    return Dataset(servo.file, "mjcf", tuple(runs))


def with_commands(dataset, change):
    runs = []
    for run in dataset.runs:
        columns = {**run.columns, "control:drive": change(run.columns["control:drive"])}
        runs.append(replace(run, columns=MappingProxyType(columns)))
    return replace(dataset, runs=tuple(runs))


def test_sound_logs_raise_no_suspicion_and_a_flipped_or_scaled_command_does(servo):
    sound = logs(servo, VISCOUS)
    assert not [s for s in machine_suspicions(sound, servo) if s.is_sure]
    for factor, kind in ((-1.0, "sign"), (180.0 / np.pi, "unit"), (0.001, "unit")):
        found = machine_suspicions(with_commands(sound, lambda u, k=factor: k * u), servo)
        assert ("control:drive", kind) in [(s.channel, s.kind) for s in found if s.is_sure]


def test_the_force_of_a_missing_effect_shows_over_the_stiffness_and_its_noise_is_that_of_forces(servo):
    replay = MachineReplay(logs(servo, VISCOUS), servo)
    nominal = np.array([b.nominal for b in replay.base])
    plain, true = replay.simulate(
        [Setting(nominal), Setting(nominal, {"viscous (elbow)": np.array([VISCOUS])})]
    )
    column = [c.name for c in replay.channels].index("control:drive")
    lacking = (replay.measured - plain)[:, column]
    speed = replay.regimes()["speed"][1]
    inside = np.isfinite(lacking)
    slope = float(lacking[inside] @ speed[inside]) / float(speed[inside] @ speed[inside])
    assert slope == pytest.approx(VISCOUS / STIFFNESS, rel=0.02)
    left = np.sqrt(np.nanmean((replay.measured - true)[:, column] ** 2))
    assert left < 0.05 * np.sqrt(np.nanmean(lacking**2))
    assert replay.channels[column].equation_error < 0.1 * np.sqrt(np.nanmean(lacking**2))
