"""`before_after.rrd` is read back: machines, signals and timelines are those of the finding."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_findings import FINDINGS, linear_axis, rig_named, robot
from test_rerun import ReadBack

from omnimj.estimate.gap.records import worst_run
from omnimj.parameters import read_rig, read_robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.view.rerun.before_after import shown_runs, write_before_after
from omnimj.view.rerun.dead_reckoning import axis_motion, filled, rig_motion, robot_motion


class RunsBack(ReadBack):
    """Columns of one run's timeline."""

    def on(self, run: str, entity: str, component: str) -> tuple[np.ndarray, np.ndarray]:
        times, values = [], []
        for chunk in self.chunks:
            batch = chunk.to_record_batch()
            if chunk.entity_path == entity and {run, component} <= set(batch.schema.names):
                times += [t.total_seconds() for t in batch.column(run).to_pylist()]
                values += batch.column(component).to_pylist()
        assert values, f"{entity} has no {component} on {run}"
        return np.array(times), np.array(values, float)


def written(folder: Path, name: str) -> RunsBack:
    write_before_after(folder / "before_after.rrd", FINDINGS[name]())
    return RunsBack(folder / "before_after.rrd")


@pytest.fixture(scope="module")
def rig_back(tmp_path_factory) -> RunsBack:
    return written(tmp_path_factory.mktemp("rig"), "named")


def test_every_channel_is_there_measured_before_and_after(rig_back):
    finding = rig_named()
    run = worst_run(finding)
    (overlay,) = [o for o in finding.overlays if o.run == run]
    for c, channel in enumerate(finding.channels):
        time, values = rig_back.on(overlay.run, f"/plots/{channel}", "Scalars:scalars")
        np.testing.assert_allclose(time, overlay.time, atol=1e-9)
        expected = np.stack([overlay.measured[:, c], overlay.before[:, c], overlay.after[:, c]], axis=1)
        np.testing.assert_allclose(values, expected)


def test_each_held_out_run_has_a_timeline_and_no_other_run_has(rig_back):
    moving = {name for chunk in rig_back.chunks if not chunk.is_static for name in chunk.timeline_names}
    assert moving == set(rig_named().heldout_runs)


def test_three_rigs_stand_side_by_side_and_move_by_their_speeds(rig_back):
    finding = rig_named()
    run = worst_run(finding)
    (overlay,) = [o for o in finding.overlays if o.run == run]
    start = read_rig().rig.start_position
    aside = []
    for kind in ("before", "measured", "after"):
        entity = f"/world/{kind}"
        aside.append(rig_back.array(entity, "Transform3D:translation")[0].ravel()[1])
        _, place = rig_back.on(overlay.run, f"{entity}/carriage", "Transform3D:translation")
        driven = np.trapezoid(getattr(overlay, kind)[:, 1], overlay.time)
        assert place[-1].ravel()[0] - start == pytest.approx(driven, abs=1e-4)
    assert aside[0] > aside[1] > aside[2]


def test_the_recording_arranges_itself(rig_back):
    assert len(rig_back.reader.blueprints()) == 1
    assert {"/about", "/plots/mismatch", "/world/before/wheel_1/rollers"} <= rig_back.entities


def test_without_a_second_model_there_is_no_after(tmp_path):
    back = written(tmp_path, "unexplained")
    assert not any(entity.startswith("/world/after") for entity in back.entities)
    assert "/world/before/carriage" in back.entities


@pytest.mark.slow
def test_the_robots_recording_has_paths_and_the_axis_a_carriage(tmp_path):
    back = written(tmp_path, "robot")
    assert {"/world/after/path", "/world/measured/chassis", "/plots/yaw_rate"} <= back.entities
    (tmp_path / "axis").mkdir()
    axis = written(tmp_path / "axis", "linear_axis")
    run = str(worst_run(linear_axis()))
    (overlay,) = [o for o in linear_axis().overlays if o.run == run]
    _, place = axis.on(run, "/world/after/carriage", "Transform3D:translation")
    np.testing.assert_allclose(place.reshape(-1, 3)[:, 0], overlay.after[:, 0], atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", FINDINGS)
def test_every_finding_has_a_recording_of_modest_size(tmp_path, name):
    write_before_after(tmp_path / "a.rrd", FINDINGS[name]())
    assert 1e4 < (tmp_path / "a.rrd").stat().st_size < 5e6


def test_held_out_runs_are_shown_the_worst_first():
    finding = rig_named()
    shown = list(shown_runs(finding))
    assert shown[0] == worst_run(finding) and set(shown) == set(finding.heldout_runs)
    none = replace(finding, overlays=tuple(replace(o, heldout=False) for o in finding.overlays))
    assert len(shown_runs(none)) > 1


def test_both_simulations_begin_every_window_where_the_measurement_is():
    finding, machine = robot(), read_robot()
    windows = [o for o in finding.overlays if o.run == "mission_3"]
    motion = robot_motion(machine, windows, list(finding.channels))
    first = np.cumsum([0, *(len(o.time) for o in windows[:-1])])
    for row in first:
        np.testing.assert_allclose(motion.coordinates["before"][row], motion.coordinates["measured"][row])
    end = motion.coordinates
    assert np.linalg.norm(end["before"][99, :2] - end["measured"][99, :2]) > 0.01


def test_a_robot_that_rolls_straight_goes_as_far_as_its_wheels_roll():
    machine = read_robot()
    speed = rolling_matrix(machine.wheel_positions, machine.drive_directions) @ [0.4, 0.0, 0.0]
    overlay = robot().overlays[0]
    channels = list(robot().channels)
    values = np.zeros_like(overlay.measured)
    values[:, :4] = speed / machine.wheel.radius
    straight = replace(overlay, measured=values, before=values, after=values)
    motion = robot_motion(machine, [straight], channels)
    span = overlay.time[-1] - overlay.time[0]
    np.testing.assert_allclose(motion.coordinates["after"][-1, :3], [0.4 * span, 0.0, 0.0], atol=1e-9)


def test_a_rig_goes_sideways_with_its_gantry():
    finding = rig_named()
    overlay = finding.overlays[0]
    motion = rig_motion(read_rig(), [overlay], list(finding.channels))
    span = overlay.time[-1] - overlay.time[0]
    assert motion.coordinates["measured"][-1, 1] == pytest.approx(0.2 * span)


def test_an_axis_without_a_position_is_driven_by_its_speed():
    overlay = linear_axis().overlays[0]
    columns = {kind: getattr(overlay, kind)[:, 1:] for kind in ("measured", "before", "after")}
    motion = axis_motion([replace(overlay, **columns)], ["velocity"])
    expected = np.trapezoid(overlay.after[:, 1], overlay.time)
    assert motion.coordinates["after"][-1, 0] == pytest.approx(expected)


def test_what_is_masked_is_bridged_by_a_line():
    values = np.array([np.nan, 1.0, np.nan, np.nan, 4.0, np.nan])
    np.testing.assert_allclose(filled(values), [1.0, 1.0, 2.0, 3.0, 4.0, 4.0])
    np.testing.assert_allclose(filled(np.full(3, np.nan)), 0.0)
