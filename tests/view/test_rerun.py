"""The recording is read back from the file and held against MuJoCo, the trace and the metrics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import rerun as rr
from diagnosed_runs import diagnosis_record, with_published, with_robust
from rerun.chunk import RrdReader

from omnimj.signals import Trace
from omnimj.view.poses import Poses, identical_bodies, thin, wheel_bodies
from omnimj.view.rerun.recording import write_recording
from omnimj.view.rerun.scene import log_floor
from omnimj.view.rerun.signals import eventful_lanes, lane_states, plots_of
from omnimj.view.wording import Span, fault_spans


class ReadBack:
    """Columns of a recording by entity."""

    def __init__(self, path: Path):
        self.reader = RrdReader(path)
        self.chunks = self.reader.stream().to_chunks()
        self.entities = {chunk.entity_path for chunk in self.chunks}

    def column(self, entity: str, component: str) -> list[Any]:
        found = []
        for chunk in self.chunks:
            batch = chunk.to_record_batch()
            if chunk.entity_path == entity and component in batch.schema.names:
                found += batch.column(component).to_pylist()
        assert found, f"{entity} has no {component}"
        return found

    def array(self, entity: str, component: str) -> np.ndarray:
        return np.array(self.column(entity, component), float)

    def time(self, entity: str) -> np.ndarray:
        return np.array([t.total_seconds() for t in self.column(entity, "time")])


@pytest.fixture(scope="module")
def robot_file(tmp_path_factory, robot_trace, robot_scenario, robot_metrics, robot_poses) -> Path:
    path = tmp_path_factory.mktemp("rerun") / "run.rrd"
    write_recording(path, robot_trace, robot_scenario, robot_metrics, robot_poses)
    return path


@pytest.fixture(scope="module")
def robot_back(robot_file: Path) -> ReadBack:
    return ReadBack(robot_file)


def kinematics_at(poses: Poses, time: float) -> mujoco.MjData:
    mj_data = mujoco.MjData(poses.mj_model)
    mj_data.qpos[:] = poses.qpos[np.argmin(np.abs(poses.time - time))]
    mujoco.mj_kinematics(poses.mj_model, mj_data)
    return mj_data


def matrix(xyzw: np.ndarray) -> np.ndarray:
    result = np.empty(9)
    mujoco.mju_quat2Mat(result, np.array([xyzw[3], *xyzw[:3]], float))
    return result.reshape(3, 3)


@pytest.mark.parametrize("moment", [0.0, 4.0, 10.0])
@pytest.mark.parametrize(
    "entity, body", [("chassis", "chassis"), ("wheel_2", "wheel_2_wheel"), ("corner_4", "corner_4")]
)
def test_bodies_stand_where_mj_kinematics_puts_them(robot_back, robot_poses, entity, body, moment):
    path = f"/world/machine/{entity}"
    row = int(np.argmin(np.abs(robot_back.time(path) - moment)))
    mj_data = kinematics_at(robot_poses, robot_back.time(path)[row])
    position = robot_back.array(path, "Transform3D:translation")[row].ravel()
    rotation = matrix(robot_back.array(path, "Transform3D:quaternion")[row].ravel())
    np.testing.assert_allclose(position, mj_data.body(body).xpos, atol=1e-5)
    np.testing.assert_allclose(rotation, mj_data.body(body).xmat.reshape(3, 3), atol=1e-5)


def test_rollers_composed_with_their_wheel_stand_where_mj_kinematics_puts_them(robot_back, robot_poses):
    mj_model = robot_poses.mj_model
    wheel, rollers = "/world/machine/wheel_3", "/world/machine/wheel_3/rollers"
    row = 211
    mj_data = kinematics_at(robot_poses, robot_back.time(rollers)[row])
    place = robot_back.array(wheel, "Transform3D:translation")[row].ravel()
    turn = matrix(robot_back.array(wheel, "Transform3D:quaternion")[row].ravel())
    local = robot_back.array(rollers, "InstancePoses3D:translations")[row]
    spin = robot_back.array(rollers, "InstancePoses3D:quaternions")[row]
    bodies = [b for b in range(mj_model.nbody) if mj_model.body(b).name.startswith("wheel_3_roller")]
    assert len(bodies) == len(local) == 18
    for k, body in enumerate(bodies):
        np.testing.assert_allclose(place + turn @ local[k], mj_data.xpos[body], atol=1e-5)
        np.testing.assert_allclose(turn @ matrix(spin[k]), mj_data.xmat[body].reshape(3, 3), atol=1e-5)


def test_traction_arrows_push_along_the_driving_direction(robot_back, robot_trace, robot_scenario):
    entity, row = "/world/forces/traction", 200
    time = robot_back.time(entity)[row]
    arrows = robot_back.array(entity, "Arrows3D:vectors")[row]
    k = int(np.argmin(np.abs(robot_trace["time"] - time)))
    heading = robot_trace["heading"][k]
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    ahead = robot_scenario.constants.drive_directions @ turn.T
    force = robot_trace.wheels("traction_force")[k]
    scale = np.linalg.norm(arrows[0]) / abs(force[0])
    np.testing.assert_allclose(arrows[:, :2], scale * force[:, None] * ahead, atol=1e-4)


def test_signals_are_those_of_the_trace(robot_back, robot_trace):
    entity = "/plots/slip_velocity"
    time, values = robot_back.time(entity), robot_back.array(entity, "Scalars:scalars")
    assert values.shape[1] == 4
    for i in range(4):
        expected = np.interp(time, robot_trace["time"], robot_trace[f"slip_velocity_{i + 1}"])
        np.testing.assert_allclose(values[:, i], expected, atol=1e-9)


def test_everything_covers_the_whole_run_on_one_timeline(robot_back, robot_trace):
    moving = [chunk for chunk in robot_back.chunks if not chunk.is_static]
    assert {name for chunk in moving for name in chunk.timeline_names} == {"time"}
    for entity in (
        "/world/machine/chassis",
        "/world/machine/wheel_1/rollers",
        "/plots/current",
        "/plots/wheel_speed",
    ):
        time = robot_back.time(entity)
        assert time[0] == 0.0
        assert time[-1] == pytest.approx(robot_trace["time"][-1])


def test_fault_states_change_at_onset_and_end(robot_back):
    lane = "/fault/wheel_2"
    states = [row[0] for row in robot_back.column(lane, "StateChange:state")]
    assert states == ["healthy", "slip", "healthy"]
    np.testing.assert_allclose(robot_back.time(lane), [0.0, 3.0, 5.0])
    assert "/diagnosis/wheel_3" in robot_back.entities


def test_paths_patches_and_a_blueprint_are_in_the_recording(robot_back):
    wanted = {"/world/path/planned", "/world/path/driven", "/world/floor/patch_1_nylon", "/about"}
    assert wanted <= robot_back.entities
    assert len(robot_back.reader.blueprints()) == 1


def test_ten_seconds_take_at_most_five_megabytes(robot_file):
    assert robot_file.stat().st_size <= 5e6


def test_a_long_run_grows_no_faster_than_its_length(tmp_path, robot_trace, robot_scenario, robot_metrics):
    sizes = []
    for repeats in (1, 4):
        columns = {name: np.tile(values, repeats) for name, values in robot_trace.columns.items()}
        columns["time"] = np.arange(len(columns["x"])) * 1e-3
        path = tmp_path / f"{repeats}.rrd"
        write_recording(path, Trace(columns), robot_scenario, robot_metrics)
        sizes.append(path.stat().st_size)
    assert sizes[1] < 4.2 * sizes[0]


def test_the_rig_shows_gantry_carriage_and_one_wheel(
    tmp_path, rig_trace, rig_scenario, rig_metrics, rig_poses
):
    path = tmp_path / "rig.rrd"
    write_recording(path, rig_trace, rig_scenario, rig_metrics, rig_poses)
    back = ReadBack(path)
    machine = {f"/world/machine/{name}" for name in ("gantry", "carriage", "wheel_1", "wheel_1/rollers")}
    assert machine <= back.entities
    speed = back.array("/plots/speed", "Scalars:scalars")
    rim = rig_scenario.constants.wheel.radius * rig_trace["wheel_speed"]
    np.testing.assert_allclose(speed[-1], [rim[-1], rig_trace["carriage_speed"][-1]])


def test_a_run_without_poses_still_has_plots_and_paths(tmp_path, robot_trace, robot_scenario, robot_metrics):
    path = tmp_path / "planar.rrd"
    write_recording(path, robot_trace, robot_scenario, robot_metrics, None)
    back = ReadBack(path)
    assert {"/plots/wheel_speed", "/world/path/driven", "/fault/wheel_2"} <= back.entities
    assert not any(entity.startswith("/world/machine") for entity in back.entities)


def test_faults_that_hold_at_once_share_their_lane():
    spans = [Span("", "wheel_1", "slip", 1.0, 3.0), Span("", "wheel_1", "motor loss", 2.0, 4.0)]
    times, states = lane_states(spans)
    np.testing.assert_allclose(times, [0, 1, 2, 3, 4])
    assert states == ["healthy", "slip", "slip + motor loss", "motor loss", "healthy"]


def test_a_fault_without_end_lasts_to_the_end_of_the_run(robot_metrics):
    assert [(s.start, s.end) for s in fault_spans(robot_metrics, 10.0)] == [(3.0, 5.0), (6.5, 10.0)]


@pytest.mark.parametrize("rate", [10.0, 50.0, 200.0, 1e6])
def test_thinning_keeps_both_ends_and_never_repeats(rate):
    time = np.linspace(0.0, 2.0, 2001)
    kept = thin(time, rate)
    assert (kept[0], kept[-1]) == (0, 2000)
    assert np.all(np.diff(kept) > 0)
    assert len(kept) <= 2.0 * rate + 2


def test_wheels_are_found_in_their_order_with_eighteen_rollers_each(robot_model):
    names = [robot_model.body(body).name for body in wheel_bodies(robot_model)]
    assert names == [f"wheel_{i}_wheel" for i in range(1, 5)]
    assert [len(group) for group in identical_bodies(robot_model)] == [18] * 4


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory, robot_trace, robot_scenario, robot_metrics) -> tuple[ReadBack, Trace]:
    path, trace = tmp_path_factory.mktemp("diagnosed") / "run.rrd", with_robust(robot_trace)
    write_recording(path, trace, robot_scenario, robot_metrics)
    return ReadBack(path), trace


def test_residuals_are_recorded_with_their_thresholds_beside_them(diagnosed):
    back, trace = diagnosed
    for family in ("motor", "slip"):
        entity = f"/plots/residual_{family}"
        values, time = back.array(entity, "Scalars:scalars"), back.time(entity)
        assert values.shape == (len(time), 8)
        for i in range(4):
            for column, name in ((i, f"residual_{family}_{i + 1}"), (4 + i, f"threshold_{family}_{i + 1}")):
                expected = np.interp(time, trace["time"], trace[name])
                np.testing.assert_allclose(values[:, column], expected, atol=1e-9)
    (names,) = back.column("/plots/residual_motor", "SeriesLines:names")
    assert names == [*(f"wheel {i}" for i in range(1, 5)), *(f"threshold, wheel {i}" for i in range(1, 5))]
    left = back.array("/plots/effectiveness", "Scalars:scalars")
    np.testing.assert_allclose(left[-1], [1.0, 1.0, 0.43, 1.0])


def test_thresholds_of_both_signs_are_recorded(tmp_path, robot_trace, robot_scenario, robot_metrics):
    metrics = {**robot_metrics, "method": "published"}
    write_recording(tmp_path / "run.rrd", with_published(robot_trace), robot_scenario, metrics)
    values = ReadBack(tmp_path / "run.rrd").array("/plots/residual_wheel_speed", "Scalars:scalars")
    np.testing.assert_allclose(values[0], [0.3] * 4 + [1.85, -1.85] * 4)


def test_diagnosed_faults_and_modes_are_states_over_time(diagnosed):
    back, _ = diagnosed
    lane = "/diagnosis/wheel_2"
    assert [row[0] for row in back.column(lane, "StateChange:state")] == ["healthy", "slip", "healthy"]
    np.testing.assert_allclose(back.time(lane), [0.0, 3.1, 5.05])
    modes = [row[0] for row in back.column("/mode", "StateChange:state")]
    assert modes == ["cannot judge", "healthy", "faulty", "healthy", "suspect", "faulty"]
    np.testing.assert_allclose(back.time("/mode"), [0.0, 0.5, 3.1, 5.05, 6.8, 6.9], atol=1e-9)


def test_a_state_has_one_colour_in_all_lanes(diagnosed):
    back, _ = diagnosed
    seen: dict[str, set[int]] = {}
    for entity in ("/fault/wheel_2", "/diagnosis/wheel_2", "/diagnosis/wheel_3", "/mode"):
        (values,), (colors,) = (
            back.column(entity, f"StateConfiguration:{name}") for name in ("values", "colors")
        )
        for value, color in zip(values, colors, strict=True):
            seen.setdefault(value, set()).add(color)
    assert {"healthy", "slip", "motor loss", "cannot judge"} <= set(seen)
    assert all(len(colors) == 1 for colors in seen.values())
    assert len({color for colors in seen.values() for color in colors}) >= 4


def test_a_method_that_finds_nothing_has_lanes_marked_as_empty(
    tmp_path, robot_trace, robot_scenario, robot_metrics
):
    quiet = {**robot_metrics, "diagnoses": []}
    write_recording(tmp_path / "run.rrd", robot_trace, robot_scenario, quiet)
    back = ReadBack(tmp_path / "run.rrd")
    assert [row[0] for row in back.column("/diagnosis/wheel_1", "StateChange:state")] == ["healthy"]
    write_recording(tmp_path / "off.rrd", robot_trace, robot_scenario, {**quiet, "method": "off"})
    assert not any(entity.startswith("/diagnosis") for entity in ReadBack(tmp_path / "off.rrd").entities)


def test_the_blueprint_shows_every_plot_of_the_method(diagnosed):
    back, _ = diagnosed
    (blueprint,) = back.reader.blueprints()
    origins = set()
    for chunk in back.reader.stream(store=blueprint).to_chunks():
        batch = chunk.to_record_batch()
        if "ViewBlueprint:space_origin" in batch.schema.names:
            origins |= {row[0] for row in batch.column("ViewBlueprint:space_origin").to_pylist() if row}
    wanted = {f"plots/residual_{name}" for name in ("force", "moment", "motor", "slip")}
    assert wanted | {"plots/effectiveness", "plots/wheel_speed"} <= origins


def test_lanes_with_events_alone_are_shown(robot_metrics):
    both = [f"/{entity}/wheel_{wheel}" for entity in ("fault", "diagnosis") for wheel in (2, 3)]
    assert eventful_lanes(robot_metrics, 10.0) == [*both, "/mode", "/recovery"]
    missed = {**robot_metrics, "diagnoses": [diagnosis_record(8.0, "slip", 4)]}
    assert "/fault/wheel_4" not in eventful_lanes(missed, 10.0)
    assert {"/diagnosis/wheel_2", "/diagnosis/wheel_4"} <= set(eventful_lanes(missed, 10.0))
    quiet = {**robot_metrics, "faults": [], "diagnoses": []}
    assert eventful_lanes(quiet, 10.0) == ["/fault/**", "/diagnosis/**", "/mode", "/recovery"]


def test_the_axis_of_effectiveness_always_shows_none_and_all(robot_trace, robot_scenario):
    trace = with_robust(robot_trace)
    plots = {plot.entity: plot for plot in plots_of(robot_scenario, "robust", list(trace.columns))}
    low, high = plots["plots/effectiveness"].range(trace)
    assert low < 0.0 and high > 1.0


@pytest.mark.parametrize(("reach", "tiles"), [(3.0, 0.25), (60.0, 0.25), (1e4, 32.0), (1e10, None)])
def test_a_vast_floor_has_larger_tiles_not_more(tmp_path, reach, tiles):
    stream = rr.RecordingStream("omnimj_test")
    stream.save(tmp_path / "floor.rrd")
    log_floor(stream, np.array([[0.0, 0.0], [reach, 1.0]]), (), "pvc")
    stream.disconnect()
    (strips,) = ReadBack(tmp_path / "floor.rrd").column("/world/floor/tiles", "LineStrips3D:strips")
    along = sorted({strip[0][0] for strip in strips})
    assert len(strips) <= 2 * 513 + 2
    if tiles is not None:
        np.testing.assert_allclose(np.diff(along), tiles)
