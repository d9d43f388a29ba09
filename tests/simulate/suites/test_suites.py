"""Test plans as recorded datasets: what is driven, what a logger gets to know, and what it does not."""

from __future__ import annotations

import dataclasses
import itertools
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from omnimj.errors import InputError, SimulationError, UnknownNameError
from omnimj.parameters import read_floors, read_rig
from omnimj.plant.interface import RIG_CHANNELS, robot_channels
from omnimj.plant.mujoco.twin import RigTwin
from omnimj.recording.read_dataset import read_dataset
from omnimj.resources import models_folder
from omnimj.simulate.driving import drive_rig
from omnimj.simulate.suites.catalogue import SUITES, find_suite
from omnimj.simulate.suites.missions import mission
from omnimj.simulate.suites.recording import RecordingConfig, RecordingResult, record_suite
from omnimj.simulate.suites.rig import RAIL_MARGIN, samples_on_rail
from omnimj.simulate.suites.suite import planned_runs

CONSTANT = ("rig_currents", "rig_validation", "rig_lateral")


def recorded(folder: Path, suite: str, *names: str, **order) -> RecordingResult:
    """Some runs of a suite, on the quick plant."""
    wanted = RecordingConfig(folder, **{"plant": "planar", **order})

    def some(runs):
        return [run for run in runs if run.name in names] or runs[:2]

    return record_suite(find_suite(suite), wanted, choose=some)


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.fixture(scope="module")
def rig():
    return read_rig()


@pytest.fixture(scope="module")
def plans():
    """Every suite's conditions."""
    servo = models_folder() / "servo_arm" / "servo_arm.xml"
    files = {"machine_moves": servo}
    return {name: suite.plan(suite.read_machine(files.get(name)), 0) for name, suite in SUITES.items()}


def planned(name, plans):
    """A suite that need not find out its conditions once more."""
    return dataclasses.replace(find_suite(name), plan=lambda machine, seed: plans[name])


# -- the plans -----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_identification_drives_every_current_on_every_floor(plans):
    conditions = {(c.conditions["floor"], round(c.drive.current.max(), 2)) for c in plans["rig_currents"]}
    floors = ("natural_stone", "pvc", "paperboard")
    assert conditions == set(itertools.product(floors, [round(0.15 * k, 2) for k in range(1, 11)]))
    assert len(plans["rig_currents"]) == 30
    assert {c.conditions["mass"] for c in plans["rig_currents"]} == {3.9593}


@pytest.mark.slow
def test_validation_drives_the_72_cases_of_table_4_2(plans):
    conditions = {
        (c.conditions["floor"], c.conditions["mass"], round(c.drive.current.max(), 2))
        for c in plans["rig_validation"]
    }
    currents = [round(0.45 + 0.15 * k, 2) for k in range(8)]
    floors = ("natural_stone", "pvc", "paperboard")
    assert conditions == set(itertools.product(floors, (3.9593, 2.9593, 1.9593), currents))
    assert len(plans["rig_validation"]) == 72


@pytest.mark.slow
def test_sideways_motion_drives_the_32_cases_of_table_4_3(plans):
    conditions = {(c.drive.lateral_speed, round(c.drive.current.max(), 2)) for c in plans["rig_lateral"]}
    speeds = [s * v for s in (1, -1) for v in (0.20, 0.35, 0.50, 0.65)]
    assert conditions == set(itertools.product(speeds, (0.6, 0.9, 1.2, 1.5)))
    assert len(plans["rig_lateral"]) == 32


def test_the_mixed_suite_has_24_runs_six_of_them_repeats(plans, rig):
    runs = planned_runs(planned("rig_mixed", plans), rig, 0)
    assert len(runs) == 24
    assert sum(run.repeat_of is not None for run in runs) == 12
    assert len({run.repeat_of for run in runs} - {None}) == 6


@pytest.mark.parametrize("name", SUITES)
def test_runs_have_distinct_names_and_seeds(plans, name):
    suite = planned(name, plans)
    runs = planned_runs(suite, None, 5, repeats=3)
    assert len({run.name for run in runs}) == len({run.seed for run in runs}) == len(runs)
    assert all(re.fullmatch(r"[a-z0-9_]+_[abc]", run.name) for run in runs)
    assert all(run.name.startswith(f"{run.repeat_of}_") for run in runs)


def test_a_single_drive_is_no_repeat(rig):
    runs = planned_runs(find_suite("rig_currents"), rig, 0, repeats=1)
    assert all(run.repeat_of is None for run in runs) and runs[0].name == "stone_015"


@pytest.mark.parametrize("name", CONSTANT)
def test_a_constant_current_follows_a_rest(plans, name):
    for condition in plans[name]:
        current = condition.drive.current
        begin = int(np.argmax(current > 0.0))
        assert begin >= 50 and (current[begin:] == current[-1]).all()


@pytest.mark.slow
def test_the_mixed_suite_reverses_coasts_and_brakes_and_stays_on_the_rail(plans, rig):
    """On the twin of the nominal rig; cut short are only runs whose sideways travel ends."""
    for condition in plans["rig_mixed"]:
        drive, floor = condition.drive, read_floors()[condition.conditions["floor"]]
        twin = RigTwin(rig, floor, mass=condition.conditions["mass"], lateral_speed=drive.lateral_speed)
        trace = drive_rig(twin, drive.current)
        rows = samples_on_rail(rig, trace["carriage_position"], trace["lateral_position"])
        assert rows == len(drive.current) or drive.lateral_speed
        speed, current = trace["true_carriage_speed"][:rows], trace["current_target"][:rows]
        assert (speed.max() > 0.3 and speed.min() < -0.3) or drive.lateral_speed
        assert ((current == 0.0) & (np.abs(speed) > 0.1)).any()  # coasting
        assert (current * speed < -0.01).any()  # braking
        assert len(drive.current) < 8000


def test_a_run_ends_before_carriage_or_gantry_do(rig):
    position, side = np.linspace(0.0, 2.0, 2001), np.linspace(0.0, 1.0, 2001)
    rows = samples_on_rail(rig, position, 0.0 * side)
    assert position[rows] + rig.rig.start_position == pytest.approx(
        rig.rig.rail_length - RAIL_MARGIN, abs=2e-3
    )
    rows = samples_on_rail(rig, 0.0 * position, -side)
    assert side[rows] == pytest.approx(rig.rig.lateral_travel - RAIL_MARGIN, abs=1e-3)
    rows = samples_on_rail(rig, -position, 0.0 * side)
    assert position[rows] == pytest.approx(rig.rig.start_position - RAIL_MARGIN, abs=2e-3)
    assert samples_on_rail(rig, 0.0 * position, 0.0 * side) == 2001


@pytest.mark.parametrize("seed", range(5))
def test_a_mission_keeps_its_bounds_and_stands_at_both_ends(seed):
    period = 0.001
    reference = mission(np.random.default_rng(seed), 20.0, period)
    speed = np.hypot(*reference.velocity.T)
    assert len(reference.time) == 20_001
    assert 0.2 <= speed.max() <= 1.0 + 1e-9
    assert np.hypot(*np.diff(reference.velocity, axis=0).T).max() <= 1.0 * period + 1e-12
    assert np.abs(np.diff(reference.yaw_rate)).max() <= 2.0 * period + 1e-12
    for end in (slice(0, 400), slice(-200, None)):
        assert not speed[end].any() and not reference.yaw_rate[end].any()
    np.testing.assert_allclose(
        np.diff(reference.position, axis=0), reference.velocity[:-1] * period, atol=1e-12
    )
    np.testing.assert_allclose(np.diff(reference.heading), reference.yaw_rate[:-1] * period, atol=1e-12)


def test_missions_turn_stop_and_reverse(plans):
    demands = [condition.drive for condition in plans["robot_missions"]]
    assert any(np.abs(d.yaw_rate).max() > 0.2 for d in demands)
    speeds = [np.hypot(*d.velocity.T)[2000:-2500] for d in demands]
    assert any((s < 1e-6).any() for s in speeds)
    ahead = [d.velocity[3000:] @ d.velocity[1500] for d in demands]
    assert any((along < -0.05).any() for along in ahead)


# -- the datasets --------------------------------------------------------------------------------------------


def test_a_rig_dataset_has_what_a_logger_has_and_no_truth(tmp_path):
    recorded(tmp_path, "rig_currents", "stone_150_a", "stone_150_b", plant="twin")
    dataset = read_dataset(tmp_path)
    assert dataset.plant == "quarter_rig" and not dataset.notes
    for run in dataset.runs:
        assert set(run.columns) == {"time", *RIG_CHANNELS, "current_target"}
        assert dict(run.conditions) == {"floor": "natural_stone", "mass": 3.9593}
        assert run.repeat_of == "stone_150"
        distance = np.sum(run.columns["carriage_speed"]) * 0.001
        assert distance == pytest.approx(1.57, abs=0.01)  # it goes all along the rail


def test_repeats_differ_in_their_noise_and_in_nothing_else(tmp_path):
    recorded(tmp_path, "rig_currents", "stone_150_a", "stone_150_b")
    first, second = (run.columns for run in read_dataset(tmp_path).runs)
    assert (first["current_target"] == second["current_target"]).all()
    assert (first["current"] != second["current"]).mean() > 0.5
    assert np.abs(first["carriage_speed"] - second["carriage_speed"]).max() < 0.05


def test_a_robot_dataset_has_ground_truth_of_the_pose_and_no_other(tmp_path, monkeypatch):
    monkeypatch.setattr("omnimj.simulate.suites.missions.DURATION", 4.0)
    recorded(tmp_path, "robot_missions", "mission_2", plant="twin")
    dataset = read_dataset(tmp_path)
    run = dataset.runs[0]
    targets = {f"current_target_{i}" for i in range(1, 5)}
    assert set(run.columns) == {"time", *robot_channels(4), *targets, "x", "y", "heading"}
    assert dict(run.conditions) == {"floor": "pvc"} and not dataset.notes
    assert np.ptp(run.columns["x"]) + np.ptp(run.columns["y"]) > 0.05


@pytest.mark.parametrize("table_format", ["parquet", "csv"])
def test_the_same_seed_gives_the_same_bytes_and_another_other_noise(tmp_path, table_format):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        recorded(tmp_path / name, "rig_lateral", seed=seed, table_format=table_format)
    a, b, c = (contents(tmp_path / name) for name in "abc")
    assert a == b and a.keys() == c.keys()
    assert all(a[file] != c[file] for file in a if file != "dataset.toml")
    assert a["dataset.toml"] == c["dataset.toml"]


def test_another_seed_drives_other_missions(tmp_path, monkeypatch):
    monkeypatch.setattr("omnimj.simulate.suites.missions.DURATION", 4.0)
    ends = []
    for seed in (0, 1):
        recorded(tmp_path / str(seed), "robot_missions", "mission_1", seed=seed)
        run = read_dataset(tmp_path / str(seed)).runs[0]
        ends.append((run.columns["x"][-1], run.columns["y"][-1]))
    assert np.hypot(*np.subtract(*ends)) > 0.05


@pytest.mark.slow
def test_an_axis_dataset_declares_the_mass_that_was_put_on(tmp_path):
    recorded(tmp_path, "axis_moves", "slow_a", "with_payload_a")
    slow, loaded = read_dataset(tmp_path).runs
    assert set(slow.columns) == {"time", "force", "position"}
    assert (
        not slow.conditions and float(loaded.conditions["mass"]) > 0.0 and loaded.repeat_of == "with_payload"
    )
    assert np.ptp(slow.columns["position"]) > 0.05


def test_an_effect_changes_the_numbers_and_is_not_named_in_the_dataset(tmp_path):
    plain, hidden = tmp_path / "plain", tmp_path / "hidden"
    recorded(plain, "rig_currents", "stone_090_a")
    recorded(hidden, "rig_currents", "stone_090_a", effects={"rail_viscous": {"coefficient": 2.0}})
    before, after = (read_dataset(folder).runs[0].columns["carriage_speed"] for folder in (plain, hidden))
    assert np.median((before[:1200] - after[:1200])[800:]) > 0.02
    assert contents(plain)["dataset.toml"] == contents(hidden)["dataset.toml"]
    schemas = [pq.read_schema(folder / "stone_090_a.parquet") for folder in (plain, hidden)]
    assert schemas[0].equals(schemas[1], check_metadata=True) and not schemas[0].metadata


def test_a_model_file_sets_the_masses_that_are_driven(tmp_path):
    text = (models_folder() / "quarter_rig" / "rig.toml").read_text(encoding="utf-8")
    file = tmp_path / "light.toml"
    file.write_text(text.replace("[3.9593, 2.9593, 1.9593]", "[3.5]"), encoding="utf-8")
    recorded(tmp_path / "set", "rig_currents", "pvc_150_a", model_file=file)
    assert read_dataset(tmp_path / "set").runs[0].conditions["mass"] == 3.5


@pytest.mark.parametrize("error", [KeyboardInterrupt, SimulationError])
def test_what_was_finished_is_kept(tmp_path, error):
    suite, count = find_suite("rig_currents"), itertools.count()

    def record(*arguments):
        if next(count) == 2:
            raise error("broken off")
        return suite.record(*arguments)

    order = RecordingConfig(tmp_path, plant="planar")
    broken = dataclasses.replace(suite, record=record)
    if error is SimulationError:
        with pytest.raises(SimulationError):
            record_suite(broken, order)
    else:
        result = record_suite(broken, order)
        assert result.interrupted and result.runs == ("stone_015_a", "stone_015_b") and result.planned == 60
    assert [run.name for run in read_dataset(tmp_path).runs] == ["stone_015_a", "stone_015_b"]
    assert set(contents(tmp_path)) == {"dataset.toml", "stone_015_a.parquet", "stone_015_b.parquet"}


def test_an_interrupt_within_a_run_drops_that_run(tmp_path, monkeypatch):
    from omnimj.plant.planar_rig import PlanarRig

    step, count = PlanarRig.step, itertools.count()

    def interrupted(self, command):
        if next(count) == 4000:
            raise KeyboardInterrupt
        return step(self, command)

    monkeypatch.setattr(PlanarRig, "step", interrupted)
    result = recorded(tmp_path, "rig_currents", "stone_015_a", "stone_015_b")
    assert result.interrupted and [run.name for run in read_dataset(tmp_path).runs] == ["stone_015_a"]


def test_progress_comes_to_its_end(tmp_path):
    seen = []
    order = RecordingConfig(tmp_path, plant="planar")
    suite = find_suite("rig_currents")
    record_suite(suite, order, lambda done, total: seen.append((done, total)), lambda runs: runs[:2])
    assert seen[-1] == (200, 200) and seen == sorted(seen)


def test_what_does_not_exist_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(UnknownNameError, match="unknown suite 'rig_current'; did you mean 'rig_currents'"):
        find_suite("rig_current")
    cases = (
        ({"plant": "robot"}, "--plant: unknown plant of rig_currents 'robot'; choices: planar, twin"),
        ({"repeats": 27}, "--repeats: found 27; must be at least 1 and at most 26"),
        ({"table_format": "xls"}, "unknown format"),
        ({"effects": {"rust": {}}}, "unknown effect"),
    )
    for change, expected in cases:
        with pytest.raises(InputError, match=expected):
            recorded(tmp_path / "new", "rig_currents", **change)
    assert not (tmp_path / "new").exists()
