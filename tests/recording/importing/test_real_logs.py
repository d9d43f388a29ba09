"""Logs of real machines, imported: a second route through the camera and the motors' own speeds agrees."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from measured_logs import unpack

import omnimj
from omnimj.recording.dataset import MJCF
from omnimj.recording.importing.mapping import read_mapping
from omnimj.recording.importing.propose import propose
from omnimj.recording.importing.quality import pose_misfit, suspicious_wheels
from omnimj.recording.importing.source import read_source
from omnimj.recording.importing.workflow import ImportConfig, plan_import, write_import
from omnimj.recording.read_dataset import read_dataset

WHEELS = np.deg2rad([60.0, 180.0, 300.0])
LAYOUT = np.stack([-np.sin(WHEELS), np.cos(WHEELS), np.full(3, 0.125)], axis=1) / 0.04
"""Wheel speed per speed of the body [rad/s per m/s and rad/s], by the drawing of the robot."""


@pytest.fixture(scope="module")
def robotino(tmp_path_factory):
    return unpack("robotino", tmp_path_factory.mktemp("logs"))


@pytest.fixture(scope="module")
def plan(robotino):
    files = tuple(sorted(robotino.glob("*/*.csv")))
    return plan_import(ImportConfig(files, robotino / "robotino.mapping.toml"))


@pytest.fixture(scope="module")
def runs(plan, tmp_path_factory):
    out = tmp_path_factory.mktemp("set") / "robotino"
    write_import(plan, out)
    return {run.name: run for run in read_dataset(out, ("table", "gray", "green_table")).runs}


def travelled(run, seconds=1.0):
    """Change of the pose in the frame of the body, and turns of the wheels, in windows of a second."""
    c = run.columns
    heading = 0.5 * (c["heading"][1:] + c["heading"][:-1])
    x, y = np.diff(c["x"]), np.diff(c["y"])
    ahead, left = np.cos(heading) * x + np.sin(heading) * y, np.cos(heading) * y - np.sin(heading) * x
    turns = [c[f"wheel_speed_{k}"][1:] * np.diff(run.time) for k in (1, 2, 3)]
    rows = np.stack([ahead, left, np.diff(c["heading"]), *turns], axis=1)
    size = round(seconds / float(np.median(np.diff(run.time))))
    whole = rows[: len(rows) // size * size].reshape(-1, size, 6).sum(axis=1)
    return whole[:, :3], whole[:, 3:]


def test_wheels_by_their_ticks_and_the_body_by_the_camera_follow_the_drawing_of_the_robot(runs, measured):
    """Ticks, signs, gear, pixels, heading and the turn of the pose at once, over headings from 129° to 359°.

    The rollers slip on the smooth floor: wheels turn by up to 15 % more than the body moves.
    """
    on_table = [travelled(runs[name]) for name in ("exp00", "exp12", "exp24", "exp36", "exp48", "exp60")]
    twist, turns = (np.concatenate(part) for part in zip(*on_table, strict=True))
    law = np.linalg.lstsq(twist, turns, rcond=None)[0].T
    for k in range(3):
        mine, drawn = law[k, :2], LAYOUT[k, :2]
        angle = np.arccos(mine @ drawn / np.linalg.norm(mine) / np.linalg.norm(drawn))
        measured(f"direction of wheel {k + 1} by camera and drawing [rad]", angle, 0.06)
        assert angle < 0.06
        slip = np.linalg.norm(mine) / np.linalg.norm(drawn) - 1.0
        measured("slip of a wheel on the smooth floor", slip, 0.15)
        assert 0.0 < slip < 0.15
    left = turns - twist @ law.T
    share = float(np.sqrt(np.mean(left**2) / np.mean(turns**2)))
    measured("wheels not explained by the camera", share, 0.05)
    assert share < 0.05


def test_speeds_by_ticks_are_those_of_the_motors_which_read_1_percent_high(robotino, runs):
    table = read_source(robotino / "table" / "exp12.csv").columns
    time = table["t"].values / 1000.0
    for k in (1, 2, 3):
        logged = np.sum(table[f"m{k}vel"].values[1:] * np.diff(time)) / 16.0
        run = runs["exp12"]
        turned = np.sum(run.columns[f"wheel_speed_{k}"][1:] * np.diff(run.time))
        if abs(turned) > 5.0:
            assert logged / turned == pytest.approx(1.0135, abs=0.01)


def test_currents_have_the_sign_of_their_wheel(runs):
    for run in runs.values():
        for k in (1, 2, 3):
            assert np.mean(run.columns[f"current_{k}"] * run.columns[f"wheel_speed_{k}"] < 0.0) < 0.01


def test_gaps_and_stale_rows_are_masked_and_packets_reported(plan, runs):
    assert any(note.startswith("m1pos arrives in packets") for note in plan.notes)
    assert any("run exp30: 15 stale rows, for up to 0.219 s" in note for note in plan.notes)
    stale = runs["exp30"].masked
    assert set(stale) == {f"{kind}_{k}" for kind in ("current", "wheel_speed") for k in (1, 2, 3)}
    assert stale["wheel_speed_1"].sum() >= 15 and plan.quality["exp122"].longest_gap > 0.23
    assert runs["exp122"].masked["x"].sum() == 2


def test_the_pose_explains_the_wheels_and_a_wrong_sign_shows_where_the_robot_turns(plan):
    table = [run for run in plan.runs if run.conditions["floor"] == "table"]
    assert max(pose_misfit(table).values()) < 0.05
    mixed = [
        type(run)(run.name, {**run.columns, "wheel_speed_2": -run.columns["wheel_speed_2"]}, {}, {})
        if k % 2
        else run
        for k, run in enumerate(table)
    ]
    assert suspicious_wheels(pose_misfit(mixed)) == [2]


def test_floors_follow_from_the_folders_and_the_number_of_wheels_from_the_columns(plan, runs):
    assert runs["exp122"].conditions["floor"] == "gray" and runs["exp30"].conditions["floor"] == "green_table"
    assert "wheel_speed_3" in runs["exp00"].columns and "wheel_speed_4" not in runs["exp00"].columns


def test_the_proposal_for_the_robot_finds_wheels_signs_pose_and_stale_rows(robotino):
    tables = [read_source(file) for file in sorted(robotino.glob("table/*.csv"))]
    found = propose(tables)
    columns = found.mapping.columns
    assert found.mapping.plant == "uto_robot" and found.mapping.defaults == {"pose_measured": True}
    assert [columns[f"current_{k}"].sign_of for k in (1, 2, 3)] == ["m1vel", "m2vel", "m3vel"]
    assert (columns["x"].source, columns["y"].source, columns["heading"].source) == ("xpos", "ypos", "ang")
    assert found.unclear == ("x", "y") and found.missing == ("[defaults] floor",)
    assert found.mapping.stale is not None and found.mapping.stale.unchanged == ("m1pos", "m2pos", "m3pos")


def test_the_mapping_in_the_documentation_is_that_of_the_archive(robotino, tmp_path):
    guide = (Path(omnimj.__file__).parent / "docs" / "own_robot.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```toml\n(plant.*?)```", guide, flags=re.DOTALL)
    (tmp_path / "shown.toml").write_text(shown)
    mine, whole = read_mapping(tmp_path / "shown.toml"), read_mapping(robotino / "robotino.mapping.toml")
    assert (mine.defaults, mine.stale) == (whole.defaults, whole.stale)
    for name, rule in mine.columns.items():
        other = whole.columns[name]
        assert (rule.source, rule.unit, rule.sign_of) == (other.source, other.unit, other.sign_of)
        assert (rule.scale or 1.0, rule.offset) == pytest.approx((other.scale or 1.0, other.offset), rel=1e-6)


def test_a_servo_becomes_a_dataset_of_any_machine_whose_load_has_its_sign_back(tmp_path):
    (file,) = unpack("xl330", tmp_path).glob("*.json")
    found = plan_import(ImportConfig((file,)))
    assert found.proposal.is_complete and found.proposal.mapping.plant == MJCF
    assert {"time", "position:joint", "velocity:joint", "control:motor"} <= set(found.runs[0].columns)
    load = found.runs[0].columns["sensor:load"]
    assert -2000.0 < load.min() < 0.0 < load.max() < 2000.0
    assert found.quality[file.stem].rate == pytest.approx(188.6, abs=0.5)
    write_import(found, tmp_path / "set", table_format="csv")
    assert (
        (tmp_path / "set" / f"{file.stem}.csv").read_text().startswith("time,position:joint,velocity:joint")
    )
    assert 'plant = "mjcf"' in (tmp_path / "set" / "dataset.toml").read_text()
