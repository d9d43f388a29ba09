"""Made-up runs for the view: smooth motions with the columns and metrics that a real run has."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from browser import chromium
from diagnosed_runs import LONG, diagnosis_record, with_robust
from PIL import Image

from omnimj.control.detection.detector import DetectorOptions
from omnimj.parameters import Rig, Robot, read_rig, read_robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.plant.ground import Patch
from omnimj.resources import models_folder
from omnimj.signals import Trace
from omnimj.view.picture import Picture
from omnimj.view.poses import Poses, poses_from_trace
from omnimj.view.report.run import write_report


@pytest.fixture(scope="session")
def browser() -> str:
    found = chromium()
    if found is None:
        pytest.skip("no Chromium on this machine: pages are not looked at")
    return found


@dataclass(frozen=True)
class MadeScenario:
    """What the view reads of a scenario."""

    description: str
    constants: Robot | Rig
    floor: str
    patches: tuple[Patch, ...] = ()
    overrides: tuple[str, ...] = ()
    diagnosis: DetectorOptions = field(default_factory=DetectorOptions)
    scene: Path | None = None

    @property
    def metric_units(self) -> dict[str, str]:
        return {
            "max_yaw_excursion": "rad",
            "path_error_max": "m",
            "path_error_rms": "m",
            "final_speed": "m/s",
        }

    @property
    def plant(self) -> str:
        return self.constants.plant

    @property
    def is_rig(self) -> bool:
        return self.plant == Rig.plant

    @property
    def rig(self) -> Robot | Rig:
        return self.constants

    robot = rig


def made_robot_trace(duration: float = 10.0, seed: int = 1) -> Trace:
    """A robot on a gentle curve at 1 kHz, with slip of wheel 2 from 3 to 5 s."""
    rng = np.random.default_rng(seed)
    robot = read_robot()
    k = round(duration * 1000) + 1
    time = np.arange(k) * 1e-3
    rise = np.clip(time / 1.0, 0.0, 1.0) * np.clip((duration - time) / 1.0, 0.0, 1.0)
    heading = 0.02 * np.exp(-(((time - 4.0) / 0.8) ** 2)) + 1e-3 * np.sin(3 * time)
    speed = 0.5 * rise
    course = 0.4 + 0.35 * np.sin(0.6 * time)
    world = np.stack([speed * np.cos(course), speed * np.sin(course)], axis=1)
    place = np.cumsum(world, axis=0, dtype=float) * 1e-3
    c, s = np.cos(heading), np.sin(heading)
    body = np.stack([c * world[:, 0] + s * world[:, 1], -s * world[:, 0] + c * world[:, 1]], axis=1)
    twist = np.column_stack([body, np.gradient(heading, time)])
    rolling = twist @ rolling_matrix(robot.wheel_positions, robot.drive_directions).T
    slipping = ((time > 3.0) & (time < 5.0))[:, None] * np.array([0.0, 1.0, 0.0, 0.0])
    slip = 0.02 * rolling / 0.5 + 0.25 * slipping * np.sign(rolling)
    speeds = (rolling + slip) / robot.wheel.radius
    traction = 39.0 * (0.12 * np.tanh(slip / 0.01) + 2.4 * slip * (1 - 0.8 * slipping))
    columns: dict[str, Any] = {"time": time, "x": place[:, 0], "y": place[:, 1], "heading": heading}
    columns |= {"twist_x": body[:, 0], "twist_y": body[:, 1], "twist_yaw": twist[:, 2]}
    columns |= {"target_x": 1.004 * place[:, 0], "target_y": 0.99 * place[:, 1], "target_heading": 0.0 * time}
    for i in range(4):
        columns[f"wheel_speed_{i + 1}"] = speeds[:, i] + 0.05 * rng.standard_normal(k)
        columns[f"target_wheel_speed_{i + 1}"] = rolling[:, i] / robot.wheel.radius
        columns[f"current_{i + 1}"] = 0.2 * np.tanh(speeds[:, i]) + 0.01 * rng.standard_normal(k)
        columns[f"current_target_{i + 1}"] = 0.2 * np.tanh(speeds[:, i])
        columns[f"slip_velocity_{i + 1}"] = slip[:, i]
        columns[f"normal_force_{i + 1}"] = 38.84 + 0.4 * rng.standard_normal(k)
        columns[f"traction_force_{i + 1}"] = traction[:, i]
    return Trace(columns, {"realtime_factor": 12.0})


def made_rig_trace(duration: float = 2.0) -> Trace:
    """A rig run at 1 kHz: the wheel spins up, the carriage follows."""
    rng = np.random.default_rng(2)
    time = np.arange(round(duration * 1000) + 1) * 1e-3
    carriage = 1.3 * (1 - np.exp(-time / 0.4))
    slip = 0.06 * np.exp(-time / 0.4)
    noise = rng.standard_normal(len(time))
    columns: dict[str, Any] = {
        "time": time,
        "current": 1.35 * np.exp(-time / 0.6) + 0.2 + 0.01 * noise,
        "current_target": np.full_like(time, 1.35),
        "wheel_speed": (carriage + slip) / 0.05 + 0.05 * noise,
        "carriage_speed": carriage,
        "carriage_acceleration": np.gradient(carriage, time) + 0.1 * noise,
        "lateral_speed": np.full_like(time, 0.2),
        "slip_velocity_1": slip,
        "normal_force_1": 38.84 + 0.2 * noise,
        "traction_force_1": 16.0 * np.exp(-time / 0.4),
        "lateral_force_1": np.full_like(time, -1.1),
    }
    return Trace(columns)


@pytest.fixture(scope="session")
def robot_trace() -> Trace:
    return made_robot_trace()


@pytest.fixture(scope="session")
def rig_trace() -> Trace:
    return made_rig_trace()


@pytest.fixture(scope="session")
def robot_path(robot_trace) -> Trace:
    """Place of the robot and speeds of its wheels alone: a report of it has few plots."""
    speeds = [f"wheel_speed_{i}" for i in range(1, 5)]
    return Trace({name: robot_trace[name] for name in ("time", "x", "y", "heading", *speeds)})


@pytest.fixture(scope="session")
def robot_scenario() -> MadeScenario:
    patch = Patch("nylon", (1.6, 0.7), (0.6, 0.5), 0.3)
    words = 'wheel 2 crosses <nylon> & "slips"'
    return MadeScenario(words, read_robot(), "natural_stone", (patch,), ("floor=pvc",))


@pytest.fixture(scope="session")
def rig_scenario() -> MadeScenario:
    return MadeScenario("one wheel at a constant current", read_rig(), "pvc")


@pytest.fixture(scope="session")
def robot_metrics() -> dict[str, Any]:
    return {
        "scenario": "nylon_patch",
        "plant": "uto_robot",
        "method": "robust",
        "seed": 3,
        "floor": "natural_stone",
        "duration": 10.0,
        "realtime_factor": 11.3,
        "passed": False,
        "faults": [
            {"kind": "slip", "wheel": 2, "onset": 3.0, "end": 5.0, "floor": "nylon"},
            {"kind": "motor", "wheel": 3, "onset": 6.5, "end": None, "loss": 0.57},
        ],
        "diagnoses": [
            {
                "time": 3.1,
                "kind": "slip",
                "wheels": [2],
                "confidence": 0.97,
                "ambiguous_with": [],
                "cleared": 5.05,
            },
            {"time": 6.9, "kind": "motor", "wheels": [3], "confidence": 0.9, "ambiguous_with": ["slip"]},
        ],
        "detection_delay": 0.1,
        "isolated": True,
        "false_alarms": 0,
        "max_yaw_excursion": 0.0211,
        "path_error_max": 0.013,
        "path_error_rms": 0.004,
        "checks": [
            {"name": "max_yaw_excursion", "value": 0.0211, "limit": 0.03, "ok": True},
            {"name": "path_error_max", "value": 0.013, "limit": 0.01, "ok": False},
        ],
    }


@pytest.fixture(scope="session")
def rig_metrics() -> dict[str, Any]:
    return {
        "scenario": "rig_constant_current",
        "plant": "quarter_rig",
        "method": "off",
        "seed": 1,
        "floor": "pvc",
        "duration": 2.0,
        "realtime_factor": 20.0,
        "passed": True,
        "faults": [],
        "diagnoses": [],
        "checks": [{"name": "final_speed", "value": 1.29, "limit": 1.0, "bound": "min", "ok": True}],
    }


@pytest.fixture(scope="session")
def robot_model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(models_folder() / "uto_robot" / "scene.xml"))


@pytest.fixture(scope="session")
def rig_model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(models_folder() / "quarter_rig" / "scene.xml"))


@pytest.fixture(scope="session")
def robot_poses(robot_model: mujoco.MjModel, robot_trace: Trace) -> Poses:
    poses = poses_from_trace(robot_model, robot_trace, rate=100.0)
    rollers = [j for j in range(robot_model.njnt) if "roller" in robot_model.joint(j).name]
    turning = poses.qpos.copy()
    for j in rollers:
        turning[:, robot_model.jnt_qposadr[j]] = 3.0 * poses.time + j
    return Poses(robot_model, poses.time, turning)


@pytest.fixture(scope="session")
def rig_poses(rig_model: mujoco.MjModel, rig_trace: Trace) -> Poses:
    time = rig_trace["time"][::20]
    qpos = np.tile(rig_model.qpos0, (len(time), 1))
    qpos[:, rig_model.joint("rail").qposadr[0]] = 0.6 * time
    qpos[:, rig_model.joint("wheel_1_axle").qposadr[0]] = 12.0 * time
    return Poses(rig_model, time, qpos)


@pytest.fixture(scope="session")
def robot_file(tmp_path_factory, robot_trace, robot_scenario, robot_metrics) -> Path:
    """Report of a run of the robot with its picture."""
    folder = tmp_path_factory.mktemp("robot")
    Image.new("RGB", (8, 8)).save(folder / "picture.png")
    picture = Picture(folder / "picture.png", "osmesa", "the robot & its path")
    write_report(folder / "report.html", robot_trace, robot_scenario, robot_metrics, picture)
    return folder / "report.html"


@pytest.fixture(scope="session")
def compared_file(tmp_path_factory, robot_trace, robot_scenario, robot_metrics) -> Path:
    """Report of a diagnosed run of the robot beside the same run with another method."""
    path = tmp_path_factory.mktemp("compared") / "report.html"
    metrics = {**robot_metrics, "command": f"omnimj run nylon_patch --out {LONG} --force"}
    metrics["diagnoses"] = [
        diagnosis_record(3.1, "slip", 2),
        diagnosis_record(6.9, "motor", 3, ambiguous_with=["slip 3", "motor 1"]),
    ]
    metrics["compared"] = {"published": {**robot_metrics, "method": "published"}}
    trace = with_robust(robot_trace)
    write_report(path, trace, robot_scenario, metrics, others={"published": robot_trace})
    return path


@pytest.fixture(scope="session")
def rig_file(tmp_path_factory, rig_trace, rig_scenario, rig_metrics) -> Path:
    """Report of a run of the rig."""
    path = tmp_path_factory.mktemp("rig") / "report.html"
    write_report(path, rig_trace, rig_scenario, rig_metrics)
    return path


@pytest.fixture
def page_path(tmp_path: Path) -> Path:
    return tmp_path / "report.html"
