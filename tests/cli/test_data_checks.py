"""Data that a check holds back: one line and exit 2 for every command that takes measured runs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest
from driven_missions import as_run, driven
from made_findings import rig_named
from mentions import mentions
from rig_runs import twin_run

import omnimj
from omnimj.cli.gap import format_finding
from omnimj.cli.main import main
from omnimj.errors import DataFaultError
from omnimj.estimate.gap.files import digest
from omnimj.parameters import read_floors, read_rig
from omnimj.recording.dataset import Dataset
from omnimj.recording.read_dataset import read_dataset
from omnimj.recording.write_dataset import DatasetWriter, write_dataset
from omnimj.simulate.suites.catalogue import find_suite
from omnimj.simulate.suites.recording import RecordingConfig, record_suite

pytestmark = pytest.mark.usefixtures("undrawn")

SCHEMA = json.loads((Path(__file__).parent.parent / "schema" / "gap.json").read_text(encoding="utf-8"))
FLOOR = {"floor": "natural_stone"}


@pytest.fixture(scope="module")
def axis(tmp_path_factory):
    """Three moves of a linear axis."""
    config = RecordingConfig(tmp_path_factory.mktemp("axis") / "runs", repeats=1)
    record_suite(find_suite("axis_moves"), config, choose=lambda planned: planned[:3])
    return read_dataset(config.folder)


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """Two runs of the rig with carriage speeds in mm/s."""
    machine, floor = read_rig(), read_floors()["natural_stone"]
    path = tmp_path_factory.mktemp("rig") / "runs"
    writer = DatasetWriter(path, "quarter_rig", {**FLOOR, "mass": machine.rig.masses[0]})
    for seed, current in enumerate((0.9, 1.5)):
        run = twin_run(machine, floor, current, seed, name=f"run_{seed}")
        writer.add(
            replace(run, columns={**run.columns, "carriage_speed": 1e3 * run.columns["carriage_speed"]})
        )
    return path


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """Two missions of the robot with time in milliseconds."""
    path = tmp_path_factory.mktemp("robot") / "runs"
    runs = [as_run(driven(12.0, seed), f"mission_{seed}") for seed in (5, 6)]
    runs = [replace(run, columns={**run.columns, "time": 1e3 * run.time}) for run in runs]
    write_dataset(path, "uto_robot", FLOOR, runs)
    return path


def damaged(axis: Dataset, path: Path, **scales: float) -> str:
    """The runs of the axis with some columns scaled in their files."""
    factors = dict.fromkeys(axis.runs[0].columns, 1.0) | scales
    runs = [
        replace(run, columns={name: factors[name] * values for name, values in run.columns.items()})
        for run in axis.runs
    ]
    write_dataset(path, "linear_axis", {}, runs)
    return str(path)


@pytest.mark.slow
@pytest.mark.parametrize(
    "scales, words",
    [
        ({"force": -1.0}, ("sign: force",)),
        ({"position": 1e3}, ("unit: position", "1000 times")),
        ({"time": 1e3}, ("time base: ", "milliseconds")),
        ({"time": 10.0, "force": -1.0}, ("2 sure faults", "time base: ", "sign: force")),
    ],
)
def test_a_search_stops_before_it_starts_and_says_what_is_wrong(axis, refused, tmp_path, scales, words):
    line = refused("gap", damaged(axis, tmp_path / "bad", **scales), "--out", "out")
    assert mentions(line, "bad", *words, "[columns]", "--accept")


@pytest.mark.slow
def test_a_scale_in_the_dataset_file_is_the_remedy(axis, tmp_path):
    folder = Path(damaged(axis, tmp_path / "bad", position=1e3))
    with pytest.raises(DataFaultError):
        omnimj.find_gap(folder)
    with (folder / "dataset.toml").open("a", encoding="utf-8") as file:
        file.write('\n[columns]\nposition = { name = "position", scale = 0.001 }\n')
    from omnimj.estimate.gap.check.acceptance import sound_dataset

    sound, check = sound_dataset(omnimj.read_dataset(folder), None)
    assert sound.runs and check.suspicions == ()


@pytest.mark.parametrize("command", ["identify", "validate"])
def test_runs_of_the_rig_in_another_unit_are_held_back(rig, refused, command):
    line = refused(command, str(rig), "--out", "out")
    assert mentions(line, "unit: carriage_speed", "1000 times", "--accept")


@pytest.mark.slow
def test_logs_with_another_time_are_held_back_from_diagnosis_and_calibration(robot, refused):
    line = refused("diagnose", str(robot), "--out", "out")
    assert mentions(line, "time base: ", "milliseconds", "--accept")
    line = refused("calibrate", str(robot), "--false-alarms-per-hour", "10", "--out", "thresholds.toml")
    assert mentions(line, "time base: ", "milliseconds", "--accept")


@pytest.mark.slow
def test_accepted_logs_are_diagnosed_in_seconds(robot, tmp_path, capsys):
    assert main(["diagnose", str(robot), "--accept", "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "milliseconds" in printed and "nothing found" in printed
    content = json.loads((tmp_path / "out" / "diagnoses.json").read_text(encoding="utf-8"))
    assert [one["kind"] for one in content["data_faults"]] == ["time_base"]
    assert all(10.0 < run["judged"] < 13.0 for run in content["runs"].values())


@pytest.mark.slow
def test_accepted_runs_are_identified_in_metres_per_second(rig, tmp_path, capsys):
    assert main(["identify", str(rig), "--accept", "--out", str(tmp_path / "out")]) == 0
    assert "carriage_speed: divided by 1000" in capsys.readouterr().out
    content = json.loads((tmp_path / "out" / "identification.json").read_text(encoding="utf-8"))
    assert content["data_faults"][0]["sure"] is True


def test_findings_of_the_check_stand_above_the_verdict_and_in_gap_json():
    likely = {
        "channel": "carriage_acceleration",
        "kind": "bias",
        "size": 0.2,
        "sure": False,
        "words": "carriage_acceleration is off by +0.200 m/s²",
        "or_channels": [],
        "runs": [],
    }
    short = "the dataset is incomplete: 3 of 9 planned runs were recorded"
    finding = replace(
        rig_named(),
        data_faults=(likely,),
        data_notes=(short, "run a: a gap in time", "position of hip: a part"),
    )
    content = digest(finding, "model.toml")
    text = format_finding(finding)
    assert text.startswith(short) and text.count(short) == 1 and "a gap in time" not in text
    assert text.endswith("position of hip: a part\n1 note on single runs: see the report")
    assert text.index("off by +0.200") < text.index("Named: lateral_coupling")
    assert "likely" in text and content["data_faults"] == [likely]
    jsonschema.validate(json.loads(json.dumps(content)), SCHEMA)


@pytest.mark.slow
def test_the_python_door_raises_and_accepts(rig, robot):
    for call in (
        lambda **more: omnimj.identify(rig, **more),
        lambda **more: omnimj.validate(rig, plants=("planar",), **more),
        lambda **more: omnimj.diagnose(robot, **more),
    ):
        with pytest.raises(omnimj.DataFaultError):
            call()
        assert call(accept=True)
    with pytest.raises(omnimj.DataFaultError):
        omnimj.calibrate(robot, 10.0)
